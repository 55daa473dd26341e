"""Sights: which points of a cloud a view sees, where and how deep, and the cloud's lists turned round to views.

Whoever asks which view sees which point (the labels of the points, truncated sides, the light and the occlusion of an
inserted object) asks here. A sparse point is seen where it was itself observed, a dense one where its visibility file
says so; without either a depth buffer decides (`depth_buffer`).

Depth buffers of a cloud: what nearer points hide, and what a view sees around an object.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array

from estimator.projection.cameras import PINHOLES, project
from estimator.records.scene import Camera, DenseCloud, Scene, View
from metric_base.arrays import BoolArray, FloatArray, IntArray

# A camera that turned by a radian is as far from another one as one that moved by this share of the views' extent.
TURN_SHARE = 1.0
# A cell of the depth buffer should hold several points of a surface, else what lies behind shines through its gaps:
# with 8 points expected a cell is empty once in 3,000 (Poisson).
POINTS_PER_CELL = 8
# Coarsest and finest depth buffer, in cells along the longer image side. Under 24 an object is a cell or two; over 320
# a cell is two pixels of a video frame, which is finer than any dense cloud we are given.
CELLS_ALONG_SIDE = (24, 320)
# A point is hidden when it lies this share behind the nearest point of its cell. Surfaces seen at 20 degrees change
# depth by about this much within a cell; objects stand further than this in front of the wall.
DEPTH_TOLERANCE = 0.03
# Cotangent of the slant up to which one surface fills a cell, 20 degrees: in the coarse cells of a few thousand points
# an object's own far side is deeper than `DEPTH_TOLERANCE` and would be hidden by its near side.
SLANT = 2.75
# Cells of a depth picture along the image's width; holes in it are read as nothing there.
DEPTH_CELLS = 160
MAX_DEPTH_POINTS = 20_000


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What one view sees of a cloud: rows (k,) of the points, their pixels (k, 2) and depths (k,) in scene units."""

    rows: IntArray
    pixels: FloatArray
    depths: FloatArray

    @classmethod
    def of_observations(cls, view: View, points: FloatArray) -> Sight:
        """The view's own observations of the points (n, 3), at their keypoints."""
        rows = view.point_index
        return cls(rows, view.keypoints, points[rows] @ view.rotation[2] + view.translation[2])

    def some(self, kept: BoolArray | IntArray) -> Sight:
        """Those that are kept, by a mask (k,) or by places."""
        return Sight(self.rows[kept], self.pixels[kept], self.depths[kept])


@dataclass(frozen=True, slots=True, eq=False)
class Visibility:
    """Which points each view of a scene is known to see.

    rows : (m,) of the cloud, for each view; centres, axes : (v, 3) of the cameras; complete : whether what is not
    listed is not seen: the lists of a dense cloud are complete, observations of sparse points miss many views.
    """

    rows: tuple[IntArray, ...]
    centres: FloatArray
    axes: FloatArray
    complete: bool

    def nearest(self, view: View) -> IntArray:
        """(m,) what the view of the scene sees whose camera is most like this one."""
        extent = max(float(np.ptp(self.centres, axis=0).max()), 1e-12)
        turns = np.arccos(np.clip(self.axes @ view.rotation[2], -1, 1))
        steps = np.linalg.norm(self.centres - view.centre, axis=1) / extent
        return self.rows[int(np.argmin(steps + TURN_SHARE * turns))]

    def of_points(self, kept: BoolArray) -> Visibility:
        """The visibility of the points that are kept, (n,) of the cloud, in their new numbers."""
        number = np.cumsum(kept) - 1
        rows = tuple(number[own[kept[own]]] for own in self.rows)
        return Visibility(rows, self.centres, self.axes, self.complete)


def scene_visibility(scene: Scene, step: int = 1) -> Visibility | None:
    """What the views see of the sparse points and, after them, of every `step`-th dense point.

    None where it is not known: a dense cloud without lists, or without one a view that observes nothing.
    """
    sparse = tuple(np.unique(view.point_index) for view in scene.views)
    rows: tuple[IntArray, ...] = sparse
    if scene.dense is not None:
        listed = listed_rows(scene.dense, len(scene.views), step)
        if listed is None:
            return None
        rows = tuple(
            np.unique(np.concatenate([own, dense + len(scene.points)]))
            for own, dense in zip(sparse, listed, strict=True)
        )
    elif not rows or not all(map(len, rows)):
        return None
    centres, axes = ([view.centre for view in scene.views], [view.rotation[2] for view in scene.views])
    return Visibility(rows, np.array(centres), np.array(axes), scene.dense is not None)


def listed_rows(cloud: DenseCloud, views: int, step: int = 1) -> list[IntArray] | None:
    """Rows (k,) of every `step`-th point of the cloud that each of the views sees, by its lists; None without them."""
    if cloud.visible_offsets is None or cloud.visible_views is None:
        return None
    every: IntArray = np.arange(len(cloud.points), dtype=np.int32)
    rows = np.repeat(every, np.diff(cloud.visible_offsets))
    seen_by = cloud.visible_views
    if step > 1:
        kept = rows % step == 0
        rows, seen_by = rows[kept] // step, seen_by[kept]
    order = np.argsort(seen_by, kind="stable")
    ends = np.searchsorted(seen_by[order], np.arange(views + 1))
    return [rows[order[start:end]] for start, end in pairwise(ends)]


def sight_of(view: View, points: FloatArray) -> Sight:
    """The points (n, 3) that project into the picture, whatever may stand before them."""
    # (3, n); a product this narrow is no work for BLAS, whose threads would wait for one another
    local = np.einsum("ij,jn->in", view.rotation, points.T) + view.translation[:, None]
    rows = _perhaps_inside(view.camera, local)
    local = local.take(rows, axis=1)
    pixels = project(view.camera, local.T)
    x, y = pixels.T
    # NaN, behind the camera or beyond its lens, is not inside
    inside = np.flatnonzero((x >= 0) & (x < view.camera.width) & (y >= 0) & (y < view.camera.height))
    return Sight(rows[inside], pixels.take(inside, axis=0), local[2, inside])


def indicator(rows: Sequence[IntArray], count: int) -> csr_array:
    """(r, c) sparse matrix of r = len(rows) rows and c = `count` columns, 1 at the listed columns (k,) of each row."""
    lengths = np.fromiter((len(part) for part in rows), dtype=np.int64, count=len(rows))
    indptr = np.concatenate([[0], np.cumsum(lengths)])
    indices = np.concatenate([*rows, np.empty(0, dtype=np.int32)]).astype(np.int32, copy=False)
    if indptr[-1] < 2**31:
        indptr = indptr.astype(np.int32)
    return csr_array((np.ones(indices.size, dtype=np.float32), indices, indptr), shape=(len(rows), count))


def row_members(matrix: csr_array, row: int) -> IntArray:
    """Columns (k,) that are set in one row of an `indicator`."""
    return np.asarray(matrix.indices[matrix.indptr[row] : matrix.indptr[row + 1]])


def _perhaps_inside(camera: Camera, local: FloatArray) -> IntArray:
    """Rows of points (3, n) in the camera's frame that may project into the image; all ahead for a bent lens."""
    if camera.model not in PINHOLES:
        return np.flatnonzero(local[2] > 0)
    *focal, centre_x, centre_y = camera.params
    # tangents of the wider half of the image, and a hair for rounding
    wide = (1 + 1e-9) * max(abs(centre_x), abs(camera.width - centre_x)) / focal[0]
    high = (1 + 1e-9) * max(abs(centre_y), abs(camera.height - centre_y)) / focal[-1]
    return np.flatnonzero((np.abs(local[0]) <= wide * local[2]) & (np.abs(local[1]) <= high * local[2]))


def unhidden(view: View, points: FloatArray, slant: float = 0.0) -> Sight:
    """The points (n, 3) that the view sees by a depth buffer of the cloud itself.

    The buffer's cells are as large as the cloud's density asks for; a point is kept when it lies within
    `DEPTH_TOLERANCE` of the nearest depth in its cell, or within what a surface of that slant (the cotangent of its
    angle to the line of sight) rises by across the cell.
    """
    sight = sight_of(view, points)
    if sight.rows.size == 0:
        return sight
    cell = _cell_size(view.camera, sight.rows.size)
    across = int(view.camera.width // cell) + 1
    columns, lines = (sight.pixels.T * (1 / cell)).astype(np.int64)
    cells = lines * across + columns
    # half the precision, and a twentieth of the time
    near = sight.depths.astype(np.float32)
    nearest = np.full(int(cells.max()) + 1, np.inf, dtype=np.float32)
    np.minimum.at(nearest, cells, near)
    # the first parameter of every camera model is a focal length in pixels
    tolerance = max(DEPTH_TOLERANCE, slant * cell / float(view.camera.params[0]))
    return sight.some(np.flatnonzero(near <= nearest[cells] * np.float32(1 + tolerance)))


def views_by_depth(views: Iterable[View], points: FloatArray) -> tuple[View, ...]:
    """The views of a reconstruction without observations, each observing the points (n, 3) that none hides from it."""
    sights = ((view, unhidden(view, points, SLANT)) for view in views)
    return tuple(replace(view, keypoints=sight.pixels, point_index=sight.rows) for view, sight in sights)


@dataclass(slots=True, eq=False)
class Surroundings:
    """What the views see around an object: the nearest cloud point per cell of each view, computed on demand.

    points : (n, 3) of a cloud of the scene; visibility : (v, n) sparse, 1 where the view sees the point; up : (3,).
    """

    scene: Scene
    points: FloatArray
    visibility: csr_array
    up: FloatArray
    _pictures: dict[int, tuple[FloatArray, FloatArray]] = field(default_factory=dict)

    def depths_and_heights(self, view: int, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(k,) depth and height along up of the nearest point at each pixel; depth is infinite where there is none."""
        if view not in self._pictures:
            self._pictures[view] = self._picture(view)
        depth, height = self._pictures[view]
        camera = self.scene.views[view].camera
        index = np.floor(pixels * (DEPTH_CELLS / camera.width)).astype(np.int64)
        inside = np.all((index >= 0) & (index < depth.shape[::-1]), axis=1)
        columns, lines = np.where(inside[:, None], index, 0).T
        return np.where(inside, depth[lines, columns], np.inf), height[lines, columns]

    def _picture(self, number: int) -> tuple[FloatArray, FloatArray]:
        """(h, w) depth and height of the nearest point in each cell of a view, scene units; infinite, 0 without."""
        view, rows = self.scene.views[number], row_members(self.visibility, number)
        points = self.points[rows[:: max(1, -(-len(rows) // MAX_DEPTH_POINTS))]]
        lines = int(view.camera.height * DEPTH_CELLS / view.camera.width) + 1
        depth, height = np.full((lines, DEPTH_CELLS), np.inf), np.zeros((lines, DEPTH_CELLS))
        sight = sight_of(view, points)
        # farthest first, so that the nearest is written last
        sight = sight.some(np.argsort(-sight.depths))
        cells = (sight.pixels * (DEPTH_CELLS / view.camera.width)).astype(np.int64)
        depth[cells[:, 1], cells[:, 0]] = sight.depths
        height[cells[:, 1], cells[:, 0]] = points[sight.rows] @ self.up
        return depth, height


def _cell_size(camera: Camera, count: int) -> float:
    """Side in pixels of a depth buffer's cell for `count` points in the image."""
    side = max(camera.width, camera.height)
    wanted = np.sqrt(camera.width * camera.height * POINTS_PER_CELL / count)
    return float(np.clip(wanted, side / CELLS_ALONG_SIDE[1], side / CELLS_ALONG_SIDE[0]))
