"""Draw the boxes and sizes of objects on the images of a scene, as in the teaser of the paper.

A dimension that was used for the scale has the colour of its axis and an interval in metres; others are red. If the
true sizes are known, `E` is the estimate and `G` the true size. The text is in a panel next to each object, and a
legend is below the image.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from estimator.outputs.ground_truth import read_truth
from estimator.outputs.label_placement import place_labels
from estimator.outputs.size_labels import DimensionLabel, dimension_labels
from estimator.projection.cameras import project
from estimator.reconstructions.image_files import image_file, image_folders
from estimator.records.objects import EDGES, Box, MeasuredObject, corners, edge_axis
from estimator.records.result import ObjectReport, Status
from estimator.records.scene import Scene, View
from metric_base.arrays import FloatArray
from metric_base.errors import InputError, Unquoted
from metric_base.escaping import visible
from metric_base.files import OutputNames, whole_folder
from metric_base.images import checked_image, write_image

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont

    from estimator.records.result import SceneEstimate

#: Number of segments of an edge, which may be bent by the lens or partly behind the camera.
_N_SEGMENTS = 24
#: RGB colours of length, width and height, if they were used for the scale.
AXIS_COLOURS = ((64, 224, 255), (255, 210, 64), (128, 255, 128))
#: RGB colours of unused dimensions, of other text, and of panels.
UNUSED, PLAIN, PANEL = (255, 90, 90), (235, 235, 235), (0, 0, 0)
PANEL_OPACITY = 0.74
FONT_PX = 15
_LINE_PX, _PAD_PX = FONT_PX + 3, 5
#: Maximum number of characters of the name of an object in a panel.
MAX_HEADING_CHARS = 40
_FONTS = ("DejaVuSans-Bold.ttf", "DejaVuSans.ttf")
#: Minimum width of an overlay, so that it has space for the text of many objects.
MIN_WIDTH_PX = 1600
#: Image formats that are retained; images in other formats become PNG.
_RETAINED_SUFFIXES = (".png", ".jpg", ".jpeg")


def projected_edges(box: Box, view: View) -> FloatArray:
    """Return pixels (12, k, 2) along the edges of a box, NaN behind the camera and beyond the field of view."""
    ends = corners(box)[EDGES]  # (12, 2, 3)
    steps = np.linspace(0.0, 1.0, _N_SEGMENTS + 1)[None, :, None]
    points = ends[:, None, 0] * (1 - steps) + ends[:, None, 1] * steps
    points_camera = view.to_camera(points.reshape(-1, 3))
    return project(view.camera, points_camera).reshape(len(EDGES), _N_SEGMENTS + 1, 2)


def draw_panels(
    canvas: Any, texts: Sequence[tuple[ObjectReport, tuple[DimensionLabel, ...]]], edges: Sequence[FloatArray]
) -> Any:
    """Return the canvas (h, w, 3) with a panel of text next to each object.

    Parameters
    ----------
    canvas : (h, w, 3) ndarray of uint8
    texts : sequence of (ObjectReport, tuple of DimensionLabel)
    edges : sequence of (12, k, 2) ndarray of float
        Pixels of the box of each object.
    """
    from PIL import Image, ImageDraw

    bold, plain = _fonts()
    height, width = canvas.shape[:2]
    panels = []  # width and height in pixels
    for report, labels in texts:
        widths = [bold.getlength(_heading(report)), *(plain.getlength(label.text) for label in labels)]
        panels.append((math.ceil(max(widths)) + 2 * _PAD_PX, (1 + len(labels)) * _LINE_PX + _PAD_PX))
    sizes = np.array(panels).reshape(-1, 2)
    bounds = np.tile([0.0, 0.0, width, height], (len(edges), 1))  # left, top, right, bottom of the visible part
    for row, lines in enumerate(edges):
        pixels = lines.reshape(-1, 2)
        with np.errstate(invalid="ignore"):
            inside = pixels[((pixels >= 0) & (pixels < (width, height))).all(axis=1)]
        if len(inside):
            bounds[row] = np.concatenate([inside.min(axis=0), inside.max(axis=0)])
    corners_px = np.rint(place_labels(bounds, sizes, (width, height)))
    sheet = Image.fromarray(canvas)
    shade = Image.new("RGBA", sheet.size, (0, 0, 0, 0))
    draw = ImageDraw.Draw(shade)
    for (report, labels), size, (x, y), bound in zip(texts, sizes.tolist(), corners_px.tolist(), bounds, strict=True):
        centre = tuple(((bound[:2] + bound[2:]) / 2).tolist())
        draw.line([(x + size[0] / 2, y + size[1] / 2), centre], fill=(*PLAIN, 170), width=1)
        draw.rectangle([x, y, x + size[0], y + size[1]], fill=(*PANEL, int(255 * PANEL_OPACITY)))
        head = UNUSED if report.verdict != "used" else PLAIN
        draw.text((x + _PAD_PX, y + 2), _heading(report), font=bold, fill=(*head, 255))
        for line, label in enumerate(labels, start=1):
            colour = AXIS_COLOURS[label.axis] if label.is_used else UNUSED
            draw.text((x + _PAD_PX, y + 2 + line * _LINE_PX), label.text, font=plain, fill=(*colour, 255))
    return np.asarray(Image.alpha_composite(sheet.convert("RGBA"), shade).convert("RGB"))


def with_legend(canvas: Any, level: float | None, has_truth: bool, status: Status = "resolved") -> Any:
    """Return the canvas (h, w, 3) with a legend below it, which includes a status other than `resolved`.

    level : probability of the intervals, None without intervals
    """
    from PIL import Image, ImageDraw

    _, plain = _fonts()
    truth = "   E estimate, G true size" if has_truth else ""
    brackets = "metres at the highest mode" if level is None else f"metres   [low, high] {level:.0%} interval"
    warning = [] if status == "resolved" else [(f"SCALE {status.upper()}", UNUSED)]
    parts = [
        *warning,
        ("l length", AXIS_COLOURS[0]), ("w width", AXIS_COLOURS[1]), ("h height", AXIS_COLOURS[2]),
        ("red: not used for the scale", UNUSED),
        (f"{brackets}   > at least (truncated){truth}", PLAIN),
    ]  # fmt: skip
    strip = Image.new("RGB", (canvas.shape[1], _LINE_PX + 2 * _PAD_PX), PANEL)
    draw, x = ImageDraw.Draw(strip), float(_PAD_PX)
    for text, colour in parts:
        draw.text((x, _PAD_PX), text, font=plain, fill=colour)
        x += plain.getlength(text) + 3 * _PAD_PX
    return np.vstack([canvas, np.asarray(strip)])


def _heading(report: ObjectReport) -> str:
    """Return the name of an object, with its verdict unless it was used."""
    return visible(f"{report.category} {report.id}")[:MAX_HEADING_CHARS] + (
        "" if report.verdict == "used" else f"  {report.verdict}"
    )


def _fonts() -> tuple[FreeTypeFont, FreeTypeFont]:
    """Return bold and regular fonts of Matplotlib, which are present on every machine."""
    import matplotlib as mpl
    from PIL import ImageFont

    folder = Path(mpl.get_data_path()) / "fonts" / "ttf"
    bold, plain = (ImageFont.truetype(str(folder / name), FONT_PX) for name in _FONTS)
    return bold, plain


def view_images(scene: Scene, images: Path | None = None) -> list[Path | None]:
    """Return the image of each view, or None.

    Parameters
    ----------
    scene : Scene
    images : Path, optional
        Folder of the images; by default `images` in the folder of the model or above it.

    Raises
    ------
    InputError
        No view has an image.
    """
    folders = image_folders(scene, images)
    files = [image_file(folders, view) for view in scene.views]
    if not any(files):
        found = ", ".join(map(str, folders)) or "no folder `images` in the folder of the model or above it"
        expected = "the images of the views (specify their folder with --images)"
        raise InputError.at(scene.path, "--overlay", expected, Unquoted(found))
    return files


def write_overlays(estimate: SceneEstimate, folder: Path, images: Path | None = None) -> int:
    """Write the overlays of all views with an image to a new folder.

    Parameters
    ----------
    estimate : SceneEstimate
    folder : Path
        Must not exist.
    images : Path, optional
        As for `view_images`.

    Returns
    -------
    int
        Number of images.

    Raises
    ------
    InputError
        The folder exists, or no image is found or can be read.
    """
    files = view_images(estimate.scene, images)
    with whole_folder(folder, "--overlay") as temporary:
        names = OutputNames(temporary)
        for row, file in enumerate(files):
            if file is not None:
                image = checked_image(file, cv2.IMREAD_COLOR)
                name = estimate.scene.views[row].name
                target = names.path(name if Path(name).suffix.lower() in _RETAINED_SUFFIXES else f"{name}.png")
                write_image(target, overlay(estimate, row, image[..., ::-1])[..., ::-1])
    return sum(file is not None for file in files)


def overlay(estimate: SceneEstimate, row: int, image: Any) -> Any:
    """Draw the boxes of the visible objects on the RGB image (h, w, 3) of a view, enlarged to `MIN_WIDTH_PX`."""
    view = estimate.scene.views[row]
    factor = max(1.0, MIN_WIDTH_PX / view.camera.width)
    size = (round(view.camera.width * factor), round(view.camera.height * factor))
    canvas = cv2.resize(np.ascontiguousarray(image), size, interpolation=cv2.INTER_CUBIC)
    # The objects with a box and a mask in the view, with their reports and labels.
    visible_objects: list[tuple[MeasuredObject, ObjectReport, tuple[DimensionLabel, ...]]] = []
    reports = {report.id: report for report in estimate.result.objects}
    truth = read_truth(estimate.scene.path)
    for item in () if estimate.measurements is None else estimate.measurements.objects:
        if item.box is None or all(estimate.instances[member].view != row for member in item.members):
            continue
        # The true size belongs to the track of most masks.
        tracks = Counter(track for member in item.members if (track := estimate.instances[member].track) is not None)
        sizes = truth.sizes.get(tracks.most_common(1)[0][0], {}) if tracks else {}
        labels = dimension_labels(item, reports[item.id], estimate.result, sizes)
        visible_objects.append((item, reports[item.id], labels))
    # The centre of the first pixel is (0.5, 0.5) in COLMAP and (0, 0) in OpenCV.
    edges = [projected_edges(item.box, view) * factor - 0.5 for item, _, _ in visible_objects if item.box is not None]
    for (_, _, labels), lines in zip(visible_objects, edges, strict=True):
        for line in lines:
            _draw_line(canvas, line, PLAIN, 1)
        for label in labels:
            edge = _most_visible_edge(lines, label.axis, canvas.shape)
            if edge is not None:
                _draw_line(canvas, lines[edge], AXIS_COLOURS[label.axis] if label.is_used else UNUSED, 3)
    drawn = draw_panels(canvas, [(report, labels) for _, report, labels in visible_objects], edges)
    if not visible_objects:
        return drawn
    interval = estimate.result.interval
    level = None if interval is None else interval.level
    return with_legend(drawn, level, bool(truth.sizes), estimate.result.status)


def _most_visible_edge(lines: FloatArray, axis: int, shape: tuple[int, ...]) -> int | None:
    """Return the most visible of the lines (12, n, 2) along an axis, preferably a low one, or None."""
    best: tuple[float, int] | None = None
    for edge in np.flatnonzero([edge_axis(edge) == axis for edge in range(len(lines))]).tolist():
        line = lines[edge]
        with np.errstate(invalid="ignore"):
            inside = ((line >= 0) & (line < (shape[1], shape[0]))).all(axis=1)
        if inside.any():
            length = float(np.nansum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
            # A lower edge is preferred to a slightly longer one.
            score = float(inside.mean()) * length + 0.2 * float(np.nanmean(line[inside, 1]))
            best = max(best, (score, edge)) if best else (score, edge)
    return None if best is None else best[1]


def _draw_line(canvas: Any, line: FloatArray, colour: tuple[int, int, int], width: int) -> None:
    """Draw a line (k, 2) without its parts that are NaN or far outside the image."""
    drawable = np.isfinite(line).all(axis=1) & (np.abs(np.nan_to_num(line)).max(axis=1) < 8.0 * max(canvas.shape))
    runs = np.split(np.arange(len(line)), np.flatnonzero(np.diff(drawable)) + 1)
    parts = [np.rint(line[run]).astype(np.int32) for run in runs if drawable[run[0]] and len(run) > 1]
    cv2.polylines(canvas, parts, False, colour, width, cv2.LINE_AA)
