"""Overlays: every frame with the boxes of what it shows and their sizes, as in the paper's teaser.

A dimension that counted is drawn in the colour of its axis with its interval in metres; one that did not is red.
Where the scene knows the truth, `E` is the estimate and `G` the true size, as in the paper.

The text of an overlay: a panel beside each object, and the legend below.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.instances.view_matching import image_file, image_folders
from estimator.outputs.ground_truth import read_truth
from estimator.outputs.label_placement import place_labels
from estimator.outputs.size_labels import DimensionLabel, dimension_labels
from estimator.projection.cameras import project
from estimator.records.objects import EDGES, Box, MeasuredObject, corners, edge_axis
from estimator.records.result import ObjectReport, Status
from estimator.records.scene import Instance, Scene, View
from metric_base.arrays import FloatArray
from metric_base.errors import InputError, Unquoted
from metric_base.escaping import visible
from metric_base.files import OutputNames, whole_folder
from metric_base.images import read_picture, write_picture

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont

    from estimator.records.result import SceneEstimate

#: Pieces that an edge is drawn in, so that a lens may bend it and a camera cut it.
_PIECES = 24
#: Colours (red, green, blue) of length, width and height where they count, and of all that do not.
AXIS_COLOURS = ((64, 224, 255), (255, 210, 64), (128, 255, 128))
UNTRUSTED, PLAIN, PANEL = (255, 90, 90), (235, 235, 235), (0, 0, 0)
PANEL_OPACITY = 0.74
FONT_PX = 15
_LINE_PX, _PAD_PX = FONT_PX + 3, 5
#: Longest name of an object that a panel shows.
MAX_HEADING = 40
_FONTS = ("DejaVuSans-Bold.ttf", "DejaVuSans.ttf")
#: Frames are enlarged to this width, so that the text of many objects finds room.
LEAST_WIDTH_PX = 1600
#: Kinds of picture that are written as they were; others become PNG.
_WRITTEN = (".png", ".jpg", ".jpeg")


def projected_edges(box: Box, view: View) -> FloatArray:
    """(12, pieces + 1, 2) pixels along each edge, NaN where it is behind the camera or beyond its lens."""
    ends = corners(box)[EDGES]  # (12, 2, 3)
    steps = np.linspace(0.0, 1.0, _PIECES + 1)[None, :, None]
    points = ends[:, None, 0] * (1 - steps) + ends[:, None, 1] * steps
    points_camera = points.reshape(-1, 3) @ view.rotation.T + view.translation
    return project(view.camera, points_camera).reshape(len(EDGES), _PIECES + 1, 2)


def draw_panels(
    canvas: Any, texts: Sequence[tuple[ObjectReport, tuple[DimensionLabel, ...]]], edges: Sequence[FloatArray]
) -> Any:
    """The canvas (h, w, 3) with a panel of text beside each object, none over another where there is room.

    edges : (12, k, 2) pixels of each object's box.
    """
    from PIL import Image, ImageDraw

    bold, plain = _fonts()
    sizes = np.array([_panel_size(report, labels, bold, plain) for report, labels in texts]).reshape(-1, 2)
    bounds = np.array([_visible_bounds(lines, canvas.shape) for lines in edges]).reshape(-1, 4)
    places = np.rint(place_labels(bounds, sizes, (canvas.shape[1], canvas.shape[0])))
    sheet = Image.fromarray(canvas)
    shade = Image.new("RGBA", sheet.size, (0, 0, 0, 0))
    draw = ImageDraw.Draw(shade)
    for (report, labels), size, (x, y), bound in zip(texts, sizes.tolist(), places.tolist(), bounds, strict=True):
        middle = tuple(((bound[:2] + bound[2:]) / 2).tolist())
        draw.line([(x + size[0] / 2, y + size[1] / 2), middle], fill=(*PLAIN, 170), width=1)
        draw.rectangle([x, y, x + size[0], y + size[1]], fill=(*PANEL, int(255 * PANEL_OPACITY)))
        head = UNTRUSTED if report.verdict != "used" else PLAIN
        draw.text((x + _PAD_PX, y + 2), _heading(report), font=bold, fill=(*head, 255))
        for line, label in enumerate(labels, start=1):
            colour = AXIS_COLOURS[label.axis] if label.trusted else UNTRUSTED
            draw.text((x + _PAD_PX, y + 2 + line * _LINE_PX), label.text, font=plain, fill=(*colour, 255))
    return np.asarray(Image.alpha_composite(sheet.convert("RGBA"), shade).convert("RGB"))


def with_legend(canvas: Any, level: float | None, has_truth: bool, status: Status = "resolved") -> Any:
    """The canvas (h, w, 3) with a strip below it: the letters, colours and brackets, and a status that is a warning.

    level : of the interval, None where none is stated.
    """
    from PIL import Image, ImageDraw

    _, plain = _fonts()
    truth = "   E estimate, G true size" if has_truth else ""
    brackets = "metres at the highest mode" if level is None else f"metres   [low, high] {level:.0%} interval"
    mark = [] if status == "resolved" else [(f"SCALE {status.upper()}", UNTRUSTED)]
    parts = [
        *mark,
        ("l length", AXIS_COLOURS[0]), ("w width", AXIS_COLOURS[1]), ("h height", AXIS_COLOURS[2]),
        ("red: not used for the scale", UNTRUSTED),
        (f"{brackets}   > at least (truncated){truth}", PLAIN),
    ]  # fmt: skip
    strip = Image.new("RGB", (canvas.shape[1], _LINE_PX + 2 * _PAD_PX), PANEL)
    draw, x = ImageDraw.Draw(strip), float(_PAD_PX)
    for text, colour in parts:
        draw.text((x, _PAD_PX), text, font=plain, fill=colour)
        x += plain.getlength(text) + 3 * _PAD_PX
    return np.vstack([canvas, np.asarray(strip)])


def _heading(report: ObjectReport) -> str:
    return visible(f"{report.category} {report.id}")[:MAX_HEADING] + (
        "" if report.verdict == "used" else f"  {report.verdict}"
    )


def _panel_size(
    report: ObjectReport, labels: Sequence[DimensionLabel], bold: FreeTypeFont, plain: FreeTypeFont
) -> tuple[int, int]:
    widths = [bold.getlength(_heading(report)), *(plain.getlength(label.text) for label in labels)]
    return math.ceil(max(widths)) + 2 * _PAD_PX, (1 + len(labels)) * _LINE_PX + _PAD_PX


def _visible_bounds(lines: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """(4,) left, top, right and bottom of what is seen of a box."""
    places = lines.reshape(-1, 2)
    with np.errstate(invalid="ignore"):
        seen = places[((places >= 0) & (places < (shape[1], shape[0]))).all(axis=1)]
    if not len(seen):
        return np.array([0.0, 0.0, shape[1], shape[0]])
    return np.concatenate([seen.min(axis=0), seen.max(axis=0)])


def _fonts() -> tuple[FreeTypeFont, FreeTypeFont]:
    """Bold and plain, from the fonts that matplotlib brings along: no machine lacks them."""
    import matplotlib as mpl
    from PIL import ImageFont

    folder = Path(mpl.get_data_path()) / "fonts" / "ttf"
    bold, plain = (ImageFont.truetype(str(folder / name), FONT_PX) for name in _FONTS)
    return bold, plain


def view_pictures(scene: Scene, images: Path | None = None) -> list[Path | None]:
    """The picture of each view, None where there is none: in `images`, else in `images` beside or above the model.

    Raises
    ------
    InputError
        There is no picture of any view.
    """
    folders = image_folders(scene, images)
    files = [image_file(folders, view) for view in scene.views]
    if not any(files):
        places = ", ".join(str(place) for place in folders) or "no folder `images` beside or above the model"
        raise InputError.at(
            scene.path, "--overlay", "the pictures of the views (name their folder with --images)", Unquoted(places)
        )
    return files


def write_overlays(estimate: SceneEstimate, folder: Path, images: Path | None = None) -> int:
    """Draw every frame whose picture is found into a new folder, under its own name; how many there are.

    InputError where the folder exists, or no picture of the scene is found in `images` beside or above the model.
    """
    import cv2

    files = view_pictures(estimate.scene, images)
    with whole_folder(folder, "--overlay") as temporary:
        names = OutputNames(temporary)
        for row, file in enumerate(files):
            if file is not None:
                picture = read_picture(file, cv2.IMREAD_COLOR)
                if picture is None:
                    raise InputError.at(file, "picture", "one that OpenCV reads", Unquoted("something else"))
                name = estimate.scene.views[row].name
                target = names.path(name if Path(name).suffix.lower() in _WRITTEN else f"{name}.png")
                write_picture(target, overlay(estimate, row, picture[..., ::-1])[..., ::-1])
    return sum(file is not None for file in files)


def overlay(estimate: SceneEstimate, row: int, picture: Any) -> Any:
    """(H, W, 3) uint8, the red-green-blue picture of view `row`, enlarged, with the boxes of the objects it shows."""
    import cv2

    view = estimate.scene.views[row]
    factor = max(1.0, LEAST_WIDTH_PX / view.camera.width)
    size = (round(view.camera.width * factor), round(view.camera.height * factor))
    canvas = cv2.resize(np.ascontiguousarray(picture), size, interpolation=cv2.INTER_CUBIC)
    shown = _shown(estimate, row)
    edges = [_on_canvas(projected_edges(item.box, view), factor) for item, _, _ in shown if item.box is not None]
    for (_, _, labels), lines in zip(shown, edges, strict=True):
        _draw_edges(canvas, lines, labels)
    drawn = draw_panels(canvas, [(report, labels) for _, report, labels in shown], edges)
    if not shown:
        return drawn
    interval = estimate.result.interval
    has_truth = bool(read_truth(estimate.scene.path).sizes)
    return with_legend(drawn, None if interval is None else interval.level, has_truth, estimate.result.status)


def _shown(estimate: SceneEstimate, row: int) -> list[tuple[MeasuredObject, ObjectReport, tuple[DimensionLabel, ...]]]:
    """The objects with a box that have a mask in the view, with what is written of them."""
    if estimate.measurements is None:
        return []
    reports = {report.id: report for report in estimate.result.objects}
    truth = read_truth(estimate.scene.path)
    shown = []
    for item in estimate.measurements.objects:
        if item.box is None or all(estimate.instances[member].view != row for member in item.members):
            continue
        sizes = truth.sizes.get(_track(item, estimate.instances) or "", {})
        shown.append((item, reports[item.id], dimension_labels(item, reports[item.id], estimate.result, sizes)))
    return shown


def _track(item: MeasuredObject, instances: Sequence[Instance]) -> str | None:
    """The annotation's own track that most masks of the object bear."""
    tracks = Counter(track for member in item.members if (track := instances[member].track) is not None)
    return tracks.most_common(1)[0][0] if tracks else None


def _on_canvas(pixels: FloatArray, factor: float) -> FloatArray:
    """Pixels with (0.5, 0.5) as the first centre to the canvas, whose first centre OpenCV calls (0, 0)."""
    return pixels * factor - 0.5


def _draw_edges(canvas: Any, lines: FloatArray, labels: Sequence[DimensionLabel]) -> None:
    """All twelve edges, (12, k, 2) pixels, thin, and the clearest along each dimension thick in its colour."""
    for line in lines:
        _draw_line(canvas, line, PLAIN, 1)
    for label in labels:
        edge = _clearest(lines, label.axis, canvas.shape)
        if edge is not None:
            _draw_line(canvas, lines[edge], AXIS_COLOURS[label.axis] if label.trusted else UNTRUSTED, 3)


def _clearest(lines: FloatArray, axis: int, shape: tuple[int, ...]) -> int | None:
    """The edge along an axis with most of its length in the picture, of (12, k, 2); the lowest of equals."""
    best: tuple[float, int] | None = None
    for edge in range(len(lines)):
        if edge_axis(edge) != axis:
            continue
        line = lines[edge]
        with np.errstate(invalid="ignore"):
            inside = ((line >= 0) & (line < (shape[1], shape[0]))).all(axis=1)
        if not inside.any():
            continue
        # a lower edge wins over a slightly longer one
        score = float(inside.mean()) * _length(line) + 0.2 * float(np.nanmean(line[inside, 1]))
        best = max(best, (score, edge)) if best else (score, edge)
    return None if best is None else best[1]


def _length(line: FloatArray) -> float:
    """Length of a line (k, 2) in pixels, without its NaN parts."""
    return float(np.nansum(np.linalg.norm(np.diff(line, axis=0), axis=1)))


def _draw_line(canvas: Any, line: FloatArray, colour: tuple[int, int, int], width: int) -> None:
    """Draw a line (k, 2), without what is NaN or far outside."""
    import cv2

    drawable = np.isfinite(line).all(axis=1) & (np.abs(np.nan_to_num(line)).max(axis=1) < 8.0 * max(canvas.shape))
    runs = np.split(np.arange(len(line)), np.flatnonzero(np.diff(drawable)) + 1)
    parts = [np.rint(line[run]).astype(np.int32) for run in runs if drawable[run[0]] and len(run) > 1]
    cv2.polylines(canvas, parts, False, colour, width, cv2.LINE_AA)
