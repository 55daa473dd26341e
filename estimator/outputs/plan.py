"""Draw plan and elevation of a scene: points, cameras and boxes of objects in metres, from above and from the side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.geometry.planes import level_basis
from estimator.outputs.label_placement import place_labels
from estimator.records.objects import MeasuredObject, corners
from metric_base.arrays import FloatArray
from metric_base.escaping import visible

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from estimator.records.result import SceneEstimate

#: Colours that are distinguishable with all kinds of colour vision (Okabe and Ito).
COLOURS = {"used": "#0072B2", "outlier": "#D55E00", "skipped": "#8C8C8C"}
POINT_COLOUR, CAMERA_COLOUR = "#9A9A9A", "#CC79A7"
#: Maximum number of points of a cloud that are drawn.
MAX_POINTS = 12_000
#: Margin around the boxes and cameras, relative to their extent.
MARGIN_FRACTION = 0.12
#: Width of a character of an id, in pixels of the figure.
CHARACTER_PX = 6.2
#: Height of a line of text, in pixels of the figure.
LINE_PX = 11.0
#: Maximum number of characters of an id.
MAX_LABEL_CHARS = 24


def draw_scene(above: Axes, side: Axes, estimate: SceneEstimate) -> None:
    """Draw plan and elevation in metres, with x along the longer horizontal extent of the objects."""
    from scipy.spatial import ConvexHull, QhullError

    scale, up = estimate.result.best_scale, estimate.result.up
    if scale is None or up is None:
        above.set_axis_off()
        side.set_axis_off()
        return
    objects = [] if estimate.measurements is None else [item for item in estimate.measurements.objects if item.box]
    verdicts = {report.id: report.verdict for report in estimate.result.objects}
    # Sorted by name, which is the order of the video.
    cameras = np.array([view.centre for view in sorted(estimate.scene.views, key=lambda view: view.name)])
    frame = _frame(np.array(up.vector), objects, cameras) * scale
    boxes = [corners(item.box) @ frame.T for item in objects if item.box is not None]
    cloud = estimate.scene.points if estimate.scene.dense is None else estimate.scene.dense.points
    points, path = cloud[:: -(-len(cloud) // MAX_POINTS) or 1] @ frame.T, cameras @ frame.T
    # The origin is the lowest corner of objects and cameras.
    origin = np.vstack([*boxes, path]).min(axis=0)
    points, path, boxes = points - origin, path - origin, [box - origin for box in boxes]
    content = np.vstack([*boxes, path])
    low, high = content.min(axis=0), content.max(axis=0)
    margin = MARGIN_FRACTION * float((high - low).max())
    low, high = low - margin, high + margin
    order = np.argsort([-np.ptp(box, axis=0).prod() for box in boxes], kind="stable")  # small boxes on top
    for axes, rows, name in ((above, [0, 1], "from above"), (side, [0, 2], "from the side")):
        axes.scatter(points[:, rows[0]], points[:, rows[1]], s=0.9, c=POINT_COLOUR, linewidths=0, rasterized=True)
        axes.plot(*path[:, rows].T, color=CAMERA_COLOUR, linewidth=1, marker=".", markersize=4)
        for row in order:
            outline = boxes[row][:, rows]
            colour = COLOURS[verdicts.get(objects[row].id, "skipped")]
            try:
                hull = outline[ConvexHull(outline).vertices]
            except QhullError:  # the box has no width
                hull = outline
            axes.fill(*hull.T, facecolor=colour, edgecolor=colour, alpha=0.10, linewidth=0)
            axes.fill(*hull.T, fill=False, edgecolor=colour, linewidth=1.1)
        axes.set_xlim(low[rows[0]], high[rows[0]])
        axes.set_ylim(low[rows[1]], high[rows[1]])
        axes.set_aspect("equal")
        axes.set_title(f"{name}, metres", fontsize=10, loc="left")
        axes.tick_params(labelsize=8)
        axes.spines[["top", "right"]].set_visible(False)
    side.set_xlabel("pink: cameras; boxes with ids: blue used, orange outlier, grey skipped; dots: points", fontsize=9)
    figure = above.get_figure(root=True)
    if figure is not None:
        figure.draw_without_rendering()  # determines the position of the axes on the page
    for axes, rows in ((above, [0, 1]), (side, [0, 2])):
        colours = [COLOURS[verdicts.get(item.id, "skipped")] for item in objects]
        _label_boxes(axes, [box[:, rows] for box in boxes], [item.id for item in objects], colours)


def _frame(up: FloatArray, objects: Sequence[MeasuredObject], cameras: FloatArray) -> FloatArray:
    """Return two horizontal directions and the vertical (3, 3), aligned with most boxes.

    Directions t of boxes are equivalent after a rotation by 90 degrees. They are averaged as exp(4 i t), weighted by
    the footprints. The direction of the larger extent is the first one.
    """
    basis = level_basis(up / np.linalg.norm(up))
    boxes = [item.box for item in objects if item.box is not None]
    angle = 0.0
    if boxes:
        directions = np.array([box.axes[0] for box in boxes]) @ basis[:2].T  # (n, 2)
        weights = [box.extents[0] * box.extents[1] for box in boxes]
        angle = float(np.angle(np.dot(weights, np.exp(4j * np.arctan2(directions[:, 1], directions[:, 0]))))) / 4
    first = np.cos(angle) * basis[0] + np.sin(angle) * basis[1]
    rows = np.array([first, np.cross(basis[2], first)])
    positions = (np.vstack([corners(box) for box in boxes]) if boxes else cameras) @ rows.T
    if np.ptp(positions[:, 0]) < np.ptp(positions[:, 1]):
        rows = np.array([rows[1], -rows[0]])
    return np.vstack([rows, basis[2]])


def _label_boxes(axes: Axes, outlines: Sequence[FloatArray], ids: Sequence[str], colours: Sequence[str]) -> None:
    """Draw the ids of boxes (8, 2) without overlap, with a line to boxes from which they were moved."""
    from matplotlib.patheffects import Normal, Stroke

    if not outlines:
        return
    low, high = axes.transAxes.transform([(0, 0), (1, 1)])
    # Pixels from the lower left corner of the axes.
    corners_px = [axes.transData.transform(outline) - low for outline in outlines]
    bounds = np.array([np.concatenate([corner.min(axis=0), corner.max(axis=0)]) for corner in corners_px])
    labels = [visible(name)[:MAX_LABEL_CHARS] for name in ids]
    sizes = np.array([(CHARACTER_PX * max(len(name), 1) + 3, LINE_PX) for name in labels])
    positions = place_labels(bounds, sizes, tuple((high - low).tolist()), step=6.0, cover_cost=0.0) + sizes / 2
    centres = (bounds[:, :2] + bounds[:, 2:]) / 2
    for label, position, centre, colour in zip(labels, positions, centres, colours, strict=True):
        is_moved = np.hypot(*(position - centre)) > LINE_PX
        line = {"arrowstyle": "-", "color": colour, "linewidth": 0.6, "shrinkA": 0, "shrinkB": 0} if is_moved else None
        spots = [tuple(axes.transData.inverted().transform(spot + low)) for spot in (centre, position)]
        text: Any = axes.annotate(
            label, spots[0], xytext=spots[1], fontsize=7, color=colour, ha="center", va="center", arrowprops=line,
            parse_math=False,
        )  # fmt: skip
        text.set_path_effects([Stroke(linewidth=2, foreground="white"), Normal()])
