"""Plan and elevation of a scene: its points, cameras and objects' boxes in metres, from above and from the side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.geometry.planes import level_basis
from estimator.outputs.label_placement import place_labels
from estimator.records.objects import MeasuredObject, corners
from estimator.records.scene import Scene
from metric_base.arrays import FloatArray
from metric_base.escaping import visible

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from estimator.records.result import SceneEstimate

#: Colours that are told apart with any kind of sight (Okabe and Ito).
COLOURS = {"used": "#0072B2", "outlier": "#D55E00", "skipped": "#8C8C8C"}
POINT_COLOUR, CAMERA_COLOUR = "#9A9A9A", "#CC79A7"
#: Points drawn of a cloud; more only darken the paper.
MAX_POINTS = 12_000
#: How far the picture of the scene goes beyond the boxes and cameras, as a share of their extent.
SCENE_MARGIN = 0.12
#: Width of a letter and height of a line of the ids in pixels of the figure, and the longest id that is shown.
LETTER_PX, LINE_PX, MAX_LABEL = 6.2, 11.0, 24


def draw_scene(above: Axes, side: Axes, estimate: SceneEstimate) -> None:
    """Plan and elevation in metres; x along the longer horizontal extent of the objects."""
    scale, up = estimate.result.best_scale, estimate.result.up
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
            _draw_box(axes, boxes[row][:, rows], COLOURS[verdicts.get(objects[row].id, "skipped")])
        axes.set_xlim(low[rows[0]], high[rows[0]])
        axes.set_ylim(low[rows[1]], high[rows[1]])
        axes.set_aspect("equal")
        axes.set_title(f"{name}, metres", fontsize=10, loc="left")
        axes.tick_params(labelsize=8)
        hide_spines(axes, keep_left=True)
    side.set_xlabel("pink: cameras; boxes with ids: blue used, orange outlier, grey skipped; dots: points", fontsize=9)
    figure = above.get_figure(root=True)
    if figure is not None:
        figure.draw_without_rendering()  # only then it is known where everything is on the paper
    for axes, rows in ((above, [0, 1]), (side, [0, 2])):
        colours = [COLOURS[verdicts.get(item.id, "skipped")] for item in objects]
        _label_boxes(axes, [box[:, rows] for box in boxes], [item.id for item in objects], colours)


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
    """(n, 3) points of the scene, thinned."""
    points = scene.points if scene.dense is None else scene.dense.points
    return points[:: -(-len(points) // MAX_POINTS) or 1]


def _bounds(parts: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Low (2,) and high (2,) corner about all places (n, 2), with a margin."""
    places = np.vstack(parts)
    low, high = places.min(axis=0), places.max(axis=0)
    margin = SCENE_MARGIN * float((high - low).max())
    return low - margin, high + margin


def _draw_box(axes: Axes, outline: FloatArray, colour: str) -> None:
    """The silhouette of a box, (8, 2) projected corners."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = outline[ConvexHull(outline).vertices]
    except QhullError:  # a box without a width
        hull = outline
    axes.fill(*hull.T, facecolor=colour, edgecolor=colour, alpha=0.10, linewidth=0)
    axes.fill(*hull.T, fill=False, edgecolor=colour, linewidth=1.1)


def _label_boxes(axes: Axes, outlines: Sequence[FloatArray], ids: Sequence[str], colours: Sequence[str]) -> None:
    """The ids of boxes, (8, 2) corners each, none over another, inside the frame, with a line where one moved."""
    from matplotlib.patheffects import Normal, Stroke

    if not outlines:
        return
    low, high = axes.transAxes.transform([(0, 0), (1, 1)])
    # in pixels from the lower left corner of the frame
    corners_px = [axes.transData.transform(outline) - low for outline in outlines]
    bounds = np.array([np.concatenate([corner.min(axis=0), corner.max(axis=0)]) for corner in corners_px])
    shown = [visible(name)[:MAX_LABEL] for name in ids]
    sizes = np.array([(LETTER_PX * max(len(name), 1) + 3, LINE_PX) for name in shown])
    places = place_labels(bounds, sizes, tuple((high - low).tolist()), step=6.0, cover_cost=0.0) + sizes / 2
    middles = (bounds[:, :2] + bounds[:, 2:]) / 2
    for name, place, middle, colour in zip(shown, places, middles, colours, strict=True):
        moved = np.hypot(*(place - middle)) > LINE_PX
        line = {"arrowstyle": "-", "color": colour, "linewidth": 0.6, "shrinkA": 0, "shrinkB": 0} if moved else None
        spots = [tuple(axes.transData.inverted().transform(spot + low)) for spot in (middle, place)]
        text: Any = axes.annotate(
            name, spots[0], xytext=spots[1], fontsize=7, color=colour, ha="center", va="center", arrowprops=line,
            parse_math=False,
        )  # fmt: skip
        text.set_path_effects([Stroke(linewidth=2, foreground="white"), Normal()])


def hide_spines(axes: Axes, keep_left: bool = False) -> None:
    """Axes without the lines that frame nothing."""
    for name in ("top", "right") if keep_left else ("top", "right", "left"):
        axes.spines[name].set_visible(False)
