"""Overlays: every frame with the boxes of what it shows and their sizes, as in the paper's teaser.

A dimension that counted is drawn in the colour of its axis with its interval in metres; one that did not is red.
Where the scene knows the truth, `E` is the estimate and `G` the true size, as in the paper.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.geometry.box_edges import edge_axis, projected_edges
from estimator.instances.image_files import image_file, image_folders
from estimator.outputs.ground_truth import read_truth
from estimator.outputs.panels import AXIS_COLOURS, PLAIN, UNTRUSTED, with_legend, with_panels
from estimator.outputs.size_labels import DimensionLabel, dimension_labels
from estimator.records.measured_object import MeasuredObject
from estimator.records.result import ObjectReport
from estimator.records.scene import Instance, Scene
from metric_base.arrays import FloatArray
from metric_base.errors import InputError, Unquoted
from metric_base.files import OutputNames, whole_folder
from metric_base.images import read_picture, write_picture

if TYPE_CHECKING:
    from estimator.results.scene_estimate import SceneEstimate

__all__ = ["overlay", "view_pictures", "write_overlays"]

#: Frames are enlarged to this width, so that the text of many objects finds room.
LEAST_WIDTH_PX = 1600
#: Kinds of picture that are written as they were; others become PNG.
_WRITTEN = (".png", ".jpg", ".jpeg")


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
    drawn = with_panels(canvas, [(report, labels) for _, report, labels in shown], edges)
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
