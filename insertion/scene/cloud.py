"""The cloud with colours: the mean linear colour of each point over the stills that see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.reconstructions.cameras import pixels_in_view
from estimator.records.scene import Scene, View
from insertion.colour.encoding import srgb_to_linear
from insertion.footage.footage import Stills
from insertion.scene.strays import stray_points
from metric_base.arrays import BoolArray, FloatArray, IntArray

__all__ = [
    "Cloud",
    "FrontPoints",
    "Observations",
    "coloured_cloud",
    "even_rows",
    "front_points",
    "observations_of",
    "points_seen",
]

#: More dense points than this add time and no light.
MAX_POINTS = 150_000
#: Stills that colour the cloud.
MAX_STILLS = 40
#: Views that are asked whether they see through a point.
STRAY_VIEWS = 16
#: A point is hidden if another one within this many pixels lies nearer than this share of its depth.
HIDDEN_PX, HIDDEN_SHARE = 4, 0.95
#: A camera that turned by a radian is as far from another one as one that moved by this share of the views' extent.
TURN_SHARE = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Which points each view of the scene was seen to see.

    rows : of the cloud, (m,) for each view; centres, axes : (n, 3) of the cameras.
    """

    rows: tuple[IntArray, ...]
    centres: FloatArray
    axes: FloatArray

    def nearest(self, view: View) -> IntArray:
        """(m,) what the view sees that stands and looks most like this one."""
        extent = max(float(np.ptp(self.centres, axis=0).max()), 1e-12)
        turns = np.arccos(np.clip(self.axes @ view.rotation[2], -1, 1))
        steps = np.linalg.norm(self.centres - view.centre, axis=1) / extent
        return self.rows[int(np.argmin(steps + TURN_SHARE * turns))]


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """The points of a scene.

    points : (n, 3) in the scene; colours : (n, 3) linear, NaN where no still shows the point; dense : whether a dense
    cloud is among them; seen_by : rows of the points that each view of the scene is known to see, or None.
    """

    points: FloatArray
    colours: NDArray[np.float32]
    dense: bool
    seen_by: tuple[IntArray, ...] | None = None
    observations: Observations | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FrontPoints:
    """The points that one view sees.

    rows : (m,) of the cloud; pixels : (m, 2); depths : (m,) scene units; dense : as the cloud's; sure : (m,) whether
    each was seen by the scene's view that is most like this one, None where all count alike. Sparse points are too few
    to hide one another: the others may shine through what stands before them.
    """

    rows: IntArray
    pixels: FloatArray
    depths: FloatArray
    dense: bool
    sure: BoolArray | None = None

    def inside(self, x0: int, y0: int, x1: int, y1: int) -> FrontPoints:
        """Those within a box of pixels, the ends not included."""
        kept = self._within(x0, y0, x1, y1)
        sure = None if self.sure is None else self.sure[kept]
        return FrontPoints(self.rows[kept], self.pixels[kept], self.depths[kept], self.dense, sure)

    def marks_inside(self, marks: BoolArray, x0: int, y0: int, x1: int, y1: int) -> BoolArray:
        """The marks (m,) of the points that `inside` keeps."""
        return marks[self._within(x0, y0, x1, y1)]

    def _within(self, x0: int, y0: int, x1: int, y1: int) -> BoolArray:
        """(n,) whether each point's pixel is in the box."""
        return np.asarray(np.all((self.pixels >= [x0, y0]) & (self.pixels < [x1, y1]), axis=1))


def front_points(view: View, cloud: Cloud, row: int | None = None) -> FrontPoints:
    """The points of the cloud that a view sees and no other point hides.

    row : of the view in the scene, if it is one of the scene's: then its own visibility decides, where it is known.
    """
    if row is None or cloud.seen_by is None:
        rows, pixels, depths = _visible_points(view, cloud.points)
        sure = None if cloud.observations is None else np.isin(rows, cloud.observations.nearest(view))
        return FrontPoints(rows, pixels, depths, cloud.dense, sure)
    known = cloud.seen_by[row]
    rows, pixels, depths = _visible_points(view, cloud.points[known])
    return FrontPoints(known[rows], pixels, depths, cloud.dense)


def coloured_cloud(scene: Scene, stills: Stills) -> Cloud:
    """Sparse and dense points of the scene with their colours."""
    points, step = scene.points, 1
    if scene.dense is not None:
        step = max(1, -(-len(scene.dense.points) // MAX_POINTS))
        points = np.concatenate([points, scene.dense.points[::step]])
    total = np.zeros((len(points), 3))
    count = np.zeros(len(points))
    for row in even_rows(stills.rows, MAX_STILLS):
        seen, pixels, _ = points_seen(scene, row, points)
        at = pixels.astype(np.int64)
        total[seen] += srgb_to_linear(stills.picture(row)[at[:, 1], at[:, 0]])
        count[seen] += 1
    with np.errstate(invalid="ignore"):
        colours = np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], np.nan)
    dense = scene.dense is not None
    seen_by, observations = _visibility(scene, step), None if dense else observations_of(scene)
    return _without_strays(Cloud(points, colours.astype(np.float32), dense, seen_by, observations), scene)


def observations_of(scene: Scene) -> Observations | None:
    """The observations of the sparse points, None where a view has none."""
    rows = tuple(np.unique(view.point_index[view.point_index >= 0]) for view in scene.views)
    if not rows or not all(map(len, rows)):
        return None
    axes = np.array([view.rotation[2] for view in scene.views])
    return Observations(rows, np.array([view.centre for view in scene.views]), axes)


def _without_strays(cloud: Cloud, scene: Scene) -> Cloud:
    """The cloud without the points that views see through, where it is known what each view sees."""
    if cloud.seen_by is None:
        return cloud
    asked = even_rows(tuple(range(len(scene.views))), STRAY_VIEWS)
    kept = ~stray_points(cloud.points, [scene.views[k] for k in asked], [cloud.seen_by[k] for k in asked])
    number = np.cumsum(kept) - 1
    seen_by = tuple(number[rows[kept[rows]]] for rows in cloud.seen_by)
    return Cloud(cloud.points[kept], cloud.colours[kept], cloud.dense, seen_by)


def _visibility(scene: Scene, step: int) -> tuple[IntArray, ...] | None:
    """Rows (k,) of the cloud's points by view: the sparse observations, and every `step`-th dense point's list."""
    dense = scene.dense
    if dense is None or dense.visible_offsets is None or dense.visible_views is None:
        return None
    counts = np.diff(dense.visible_offsets)
    owner = np.repeat(np.arange(len(counts)), counts)
    kept = owner % step == 0
    owner, views = owner[kept] // step + len(scene.points), dense.visible_views[kept]
    order = np.argsort(views, kind="stable")
    starts = np.searchsorted(views[order], np.arange(len(scene.views) + 1))
    rows = [owner[order[starts[k] : starts[k + 1]]] for k in range(len(scene.views))]
    return tuple(np.unique(np.concatenate([v.point_index, r])) for v, r in zip(scene.views, rows, strict=True))


def points_seen(scene: Scene, row: int, points: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Rows of the points that a view sees and no other point hides, their (m, 2) pixels and (m,) depths."""
    return _visible_points(scene.views[row], points)


def _visible_points(view: View, points: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Rows (m,) of points (n, 3) that no nearer point hides, their pixels (m, 2) and depths (m,)."""
    pixels, depths = pixels_in_view(view, points)
    inside = np.flatnonzero(np.isfinite(pixels[:, 0]))
    pixels, depths = pixels[inside], depths[inside]
    kept = depths < _nearest(pixels, depths, view.camera.width, view.camera.height) / HIDDEN_SHARE
    return inside[kept], pixels[kept], depths[kept]


def even_rows(rows: tuple[int, ...], most: int) -> list[int]:
    """At most `most` of the rows, evenly spread."""
    chosen = np.unique(np.linspace(0, len(rows) - 1, min(len(rows), most)).round().astype(np.int64))
    return [rows[k] for k in chosen]


def _nearest(pixels: FloatArray, depths: FloatArray, width: int, height: int) -> FloatArray:
    """(m,) least depth in the neighbourhood of each point, from a coarse depth buffer."""
    from scipy.ndimage import minimum_filter

    shape = (height // HIDDEN_PX + 1, width // HIDDEN_PX + 1)
    cells = (pixels // HIDDEN_PX).astype(np.int64)
    buffer = np.full(shape, np.inf)
    np.minimum.at(buffer, (cells[:, 1], cells[:, 0]), depths)
    return np.asarray(minimum_filter(buffer, 3)[cells[:, 1], cells[:, 0]])
