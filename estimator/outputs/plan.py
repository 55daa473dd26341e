"""Plan and elevation of a scene: its points, cameras and objects' boxes in metres, from above and from the side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.geometry.box_edges import corners
from estimator.geometry.planes import level_basis
from estimator.records.measured_object import MeasuredObject
from estimator.records.scene import Scene
from metric_base.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from estimator.results.scene_estimate import SceneEstimate

__all__ = ["COLOURS", "bare_axes", "draw_scene"]

#: Colours that are told apart with any kind of sight (Okabe and Ito).
COLOURS = {"used": "#0072B2", "outlier": "#D55E00", "skipped": "#8C8C8C"}
POINT_COLOUR, CAMERA_COLOUR = "#9A9A9A", "#CC79A7"
#: Points drawn of a cloud; more only darken the paper.
MAX_POINTS = 12_000
#: How far the picture of the scene goes beyond the boxes and cameras, as a share of their extent.
SCENE_MARGIN = 0.12


def draw_scene(above: Axes, side: Axes, estimate: SceneEstimate) -> None:
    """Plan and elevation in metres; x along the longer horizontal extent of the objects."""
    scale, up = estimate.result.scale, estimate.result.up
    if scale is None or up is None:
        above.set_axis_off()
        side.set_axis_off()
        return
    objects = [] if estimate.measurements is None else [item for item in estimate.measurements.objects if item.box]
    verdicts = {report.id: report.verdict for report in estimate.result.objects}
    # by name, which is the order of the video; a model's own order jumps
    cameras = np.array([view.centre for view in sorted(estimate.scene.views, key=lambda view: view.name)])
    frame = _frame(np.array(up.vector), objects, cameras) * scale
    boxes = [corners(item.box) @ frame.T for item in objects if item.box is not None]
    points, path = _cloud(estimate.scene) @ frame.T, cameras @ frame.T
    # zero is the lowest and leftmost of the objects and cameras, so that heights read as heights
    origin = np.vstack([*boxes, path]).min(axis=0)
    points, path, boxes = points - origin, path - origin, [box - origin for box in boxes]
    low, high = _bounds([*boxes, path])
    order = np.argsort([-np.ptp(box, axis=0).prod() for box in boxes], kind="stable")  # small ones on top
    for axes, rows, name in ((above, [0, 1], "from above"), (side, [0, 2], "from the side")):
        axes.scatter(points[:, rows[0]], points[:, rows[1]], s=0.9, c=POINT_COLOUR, linewidths=0, rasterized=True)
        axes.plot(*path[:, rows].T, color=CAMERA_COLOUR, linewidth=1, marker=".", markersize=4)
        for row in order:
            _draw_box(axes, boxes[row][:, rows], objects[row], COLOURS[verdicts.get(objects[row].id, "skipped")])
        axes.set_xlim(low[rows[0]], high[rows[0]])
        axes.set_ylim(low[rows[1]], high[rows[1]])
        axes.set_aspect("equal")
        axes.set_title(f"{name}, metres", fontsize=10, loc="left")
        axes.tick_params(labelsize=8)
        bare_axes(axes, keep_left=True)
    side.set_xlabel("pink: cameras; blue: used, orange: outlier, grey: skipped", fontsize=9)


def _frame(up: FloatArray, objects: Sequence[MeasuredObject], cameras: FloatArray) -> FloatArray:
    """(3, 3) rows: two horizontal directions and up, turned so that most of the furniture lies along the paper.

    Boxes repeat every quarter turn, so their directions t are averaged as exp(4 i t), weighted by their footprints;
    of the two directions the one in which they reach further comes first.
    """
    basis = level_basis(up / np.linalg.norm(up))
    boxes = [item.box for item in objects if item.box is not None]
    turn = 0.0
    if boxes:
        along = np.array([box.axes[0] for box in boxes]) @ basis[:2].T  # (n, 2)
        weights = [box.extents[0] * box.extents[1] for box in boxes]
        turn = float(np.angle(np.dot(weights, np.exp(4j * np.arctan2(along[:, 1], along[:, 0]))))) / 4
    first = np.cos(turn) * basis[0] + np.sin(turn) * basis[1]
    rows = np.array([first, np.cross(basis[2], first)])
    places = (np.vstack([corners(box) for box in boxes]) if boxes else cameras) @ rows.T
    if np.ptp(places[:, 0]) < np.ptp(places[:, 1]):
        rows = np.array([rows[1], -rows[0]])
    return np.vstack([rows, basis[2]])


def _cloud(scene: Scene) -> FloatArray:
    points = scene.points if scene.dense is None else scene.dense.points
    return points[:: -(-len(points) // MAX_POINTS) or 1]


def _bounds(parts: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    places = np.vstack(parts)
    low, high = places.min(axis=0), places.max(axis=0)
    margin = SCENE_MARGIN * float((high - low).max())
    return low - margin, high + margin


def _draw_box(axes: Axes, outline: FloatArray, item: MeasuredObject, colour: str) -> None:
    """The silhouette of a box, (8, 2) projected corners, with the object's id."""
    from matplotlib.patheffects import Normal, Stroke
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = outline[ConvexHull(outline).vertices]
    except QhullError:  # a box without a width
        hull = outline
    axes.fill(*hull.T, facecolor=colour, edgecolor=colour, alpha=0.10, linewidth=0)
    axes.fill(*hull.T, fill=False, edgecolor=colour, linewidth=1.1)
    text: Any = axes.annotate(item.id, outline.mean(axis=0), fontsize=7, color=colour, ha="center", va="center")
    text.set_clip_on(True)
    text.set_path_effects([Stroke(linewidth=2, foreground="white"), Normal()])


def bare_axes(axes: Axes, keep_left: bool = False) -> None:
    """Axes without the lines that frame nothing."""
    for name in ("top", "right") if keep_left else ("top", "right", "left"):
        axes.spines[name].set_visible(False)
