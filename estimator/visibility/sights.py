"""Sights: which points of a cloud a view sees, where and how deep, and the cloud's lists turned round to views.

Whoever asks which view sees which point (the labels of the points, truncated sides, the light and the occlusion of an
inserted object) asks here. A sparse point is seen where it was itself observed, a dense one where its visibility file
says so; without either a depth buffer decides (`depth_buffer`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array

from estimator.projection.cameras import PINHOLES, project
from estimator.records.scene import Camera, DenseCloud, Scene, View
from metric_base.arrays import BoolArray, FloatArray, IntArray

__all__ = ["Sight", "Visibility", "indicator", "listed_rows", "row_members", "scene_visibility", "sight_of"]

# A camera that turned by a radian is as far from another one as one that moved by this share of the views' extent.
TURN_SHARE = 1.0


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
