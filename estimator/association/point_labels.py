"""Point labels: which points of a cloud lie in which instance mask (paper section 4.1).

The paper takes every point whose projection falls in a mask, so that a clump of the wall behind an object joins it.
Here a point counts only in views that see it: a sparse point where it was itself observed, a dense point where the
visibility file says so or, without one, where no nearer part of the cloud covers it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array

from estimator.reconstructions.cameras import PINHOLES, project
from estimator.records.scene import Camera, DenseCloud, Instance, Scene, View
from metric_base.arrays import BoolArray, FloatArray, IntArray

__all__ = ["PointLabels", "dense_labels", "point_votes", "sparse_labels", "view_labels", "visible_rows"]

# A cell of the depth buffer should hold several points of a surface, else what lies behind shines through its gaps:
# with 8 points expected a cell is empty once in 3,000 (Poisson).
POINTS_PER_CELL = 8
# Coarsest and finest depth buffer, in cells along the longer image side. Under 24 an object is a cell or two; over 320
# a cell is two pixels of a video frame, which is finer than any dense cloud we are given.
CELLS_ALONG_SIDE = (24, 320)
# A point is hidden when it lies this share behind the nearest point of its cell. Surfaces seen at 20 degrees change
# depth by about this much within a cell; things stand further than this in front of the wall.
DEPTH_TOLERANCE = 0.03
# What lies in a mask but this many diagonals of the mask before or behind the middle of what else does is a stray or
# the wall seen through the thing: few things are three times as deep as they look wide, and those are seen from
# elsewhere too.
DEPTH_DIAGONALS = 1.5
# The part of a box's width and height where the thing is rather than what is behind it, and the reach in depth about
# its middle, in diagonals of the box.
BOX_CENTRE = 0.5
BOX_DIAGONALS = 1.0
# A point belongs to an object when at least six tenths of the views that see both put it inside the object's mask: a
# mask misses a tenth of what it shows and noisy points at outlines more, the wall behind is inside in half of the views
# at most. A box is wider than the object, so most views agree on background too: there nearly all views must agree.
MASK_SHARE = 0.6
BOX_SHARE = 0.85
# Smear along the ray is seen where it is by the two pictures of its match, the surface by most views of the object: a
# point with less than this share of the usual number of views that look at it within the mask is no part of the object.
SUPPORT_SHARE = 0.15


@dataclass(frozen=True, slots=True, eq=False)
class PointLabels:
    """Labels of one cloud of n points seen by v views with m instances.

    points : (n, 3) in the world, scene units; rows : (n,) which rows of the scene's cloud they are; membership : (m, n)
    sparse, 1 where the point is seen inside the mask; visibility : (v, n) sparse, 1 where the view sees the point;
    looked : (v, n) sparse, 1 where the view looks at the point's place with nothing before it, whether or not it was
    matched there; masked : (m, n) sparse, 1 where it does so inside the mask.
    """

    points: FloatArray
    rows: IntArray
    membership: csr_array
    visibility: csr_array
    looked: csr_array
    masked: csr_array


def sparse_labels(scene: Scene, instances: Sequence[Instance]) -> PointLabels:
    """Labels of the sparse points by their own observations: a keypoint inside a mask labels its point."""

    def sights() -> Iterator[_Sight]:
        for view in scene.views:
            rows = view.point_index
            yield _Sight(rows, view.keypoints, scene.points[rows] @ view.rotation[2] + view.translation[2])

    visibility, membership = _matrices(sights(), scene.views, instances, len(scene.points))
    rows = np.arange(len(scene.points))
    return PointLabels(scene.points, rows, membership, visibility, visibility, membership)


def dense_labels(scene: Scene, instances: Sequence[Instance]) -> PointLabels:
    """Labels of the dense points by projection into the views that see them.

    ValueError if the scene has no dense cloud.
    """
    if scene.dense is None:
        raise ValueError("the scene has no dense cloud")
    views, own = scene.views, scene.dense.points
    rows = np.arange(len(own))
    # coordinate by coordinate in memory: projection runs along one at a time
    points = np.asfortranarray(own)
    looks = (_Sight(*_visible_rows(view, points)) for view in views)
    looked, masked = _matrices(looks, views, instances, len(points))
    listed = _rows_by_view(scene.dense, len(views))
    if listed is None:
        return PointLabels(own, rows, masked, looked, looked, masked)
    sights = (_sight_of_rows(view, points, some) for view, some in zip(views, listed, strict=True))
    visibility, membership = _matrices(sights, views, instances, len(points))
    return PointLabels(own, rows, membership, visibility, looked, masked)


def point_votes(
    labels: PointLabels, instances: Sequence[Instance], tracks: Sequence[Sequence[int]]
) -> tuple[IntArray, ...]:
    """Rows (k,) of `labels.points` of each track: a point goes to the track that most views agree on, by share.

    Views that see the point inside the track's mask vote for it; views that look at its place with nothing before it,
    and have it outside the mask, vote against. A view without a mask of the track does not vote: a missed detection is
    no evidence. tracks : rows of `instances`, one sequence per track.
    """
    count = labels.points.shape[0]
    best = np.zeros(count)
    owner = np.full(count, -1)
    by_point = labels.looked.tocsc()
    # the smallest first: of a poster and the cabinet behind it that agree as well, the poster has its points
    held = [int(np.diff(labels.membership.indptr)[list(members)].max(initial=0)) for members in tracks]
    for number in np.argsort(held, kind="stable").tolist():
        members = tracks[number]
        inside = _column_counts(labels.membership, members, count)
        rows = np.flatnonzero(inside)
        asked = np.zeros(by_point.shape[0], dtype=np.float32)
        asked[[instances[member].view for member in members]] = 1
        unhidden = _column_counts(labels.masked, members, count)[rows]
        against = asked @ by_point[:, rows] - unhidden
        share = inside[rows] / (inside[rows] + np.maximum(against, 0))
        share[unhidden < _least_support(unhidden, share)] = 0
        boxes = all(instances[member].from_box for member in members)
        # a hair per vote settles ties between masks that overlap: the more often seen, the surer
        score = share + 1e-6 * inside[rows]
        wins = (share >= (BOX_SHARE if boxes else MASK_SHARE)) & (score > best[rows])
        best[rows[wins]] = score[wins]
        owner[rows[wins]] = number
    return tuple(np.flatnonzero(owner == number) for number in range(len(tracks)))


def _least_support(views: IntArray, share: FloatArray) -> float:
    """The least number of views of a point that is believed, from those (n,) of all and their shares of votes (n,)."""
    agreed = views[share >= MASK_SHARE]
    return SUPPORT_SHARE * float(np.median(agreed)) if agreed.size else 0.0


def view_labels(pixels: FloatArray, instances: Iterable[Instance]) -> list[IntArray]:
    """Positions in `pixels` (n, 2) that are inside each instance's mask; pixel (x, y) covers [x, x + 1)."""
    columns, lines = np.floor(pixels.T).astype(np.int32)
    # numbers of two bytes are sorted by radix
    small = len(lines) and lines.min() >= -(2**15) and lines.max() < 2**15
    order = np.argsort(lines.astype(np.int16) if small else lines, kind="stable")
    columns, lines = columns[order], lines[order]
    members = []
    for instance in instances:
        (height, width), (left, top) = instance.mask.shape, instance.origin
        start, end = np.searchsorted(lines, [top, top + height])
        x = columns[start:end] - np.int32(left)
        near = np.flatnonzero((x >= 0) & (x < width))
        inside = near[instance.mask[lines[start:end][near] - top, x[near]]]
        members.append(np.sort(order[start:end][inside]))
    return members


def visible_rows(view: View, points: FloatArray) -> tuple[IntArray, FloatArray]:
    """Rows of points (n, 3) that the view sees, by a depth buffer of the cloud itself, and their pixels (m, 2).

    The buffer's cells are as large as the cloud's density asks for; a point is kept when it lies within
    `DEPTH_TOLERANCE` of the nearest depth in its cell.
    """
    return _visible_rows(view, points)[:2]


def _visible_rows(view: View, points: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Rows of the points (n, 3) that no nearer point hides, their pixels (m, 2) and depths (m,)."""
    rows, pixels, depth = _inside_rows(view, points)
    if rows.size == 0:
        return rows, pixels, depth
    cell = _cell_size(view.camera, rows.size)
    across = int(view.camera.width // cell) + 1
    columns, lines = (pixels.T * (1 / cell)).astype(np.int64)
    cells = lines * across + columns
    # half the precision, and a twentieth of the time
    near = depth.astype(np.float32)
    nearest = np.full(int(cells.max()) + 1, np.inf, dtype=np.float32)
    np.minimum.at(nearest, cells, near)
    seen = np.flatnonzero(near <= nearest[cells] * np.float32(1 + DEPTH_TOLERANCE))
    return rows[seen], pixels.take(seen, axis=0), depth[seen]


def _cell_size(camera: Camera, count: int) -> float:
    """Side in pixels of a depth buffer's cell for `count` points in the image."""
    side = max(camera.width, camera.height)
    wanted = np.sqrt(camera.width * camera.height * POINTS_PER_CELL / count)
    return float(np.clip(wanted, side / CELLS_ALONG_SIDE[1], side / CELLS_ALONG_SIDE[0]))


def _inside_rows(view: View, points: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Rows of the points (n, 3) that project into the image, their pixels (m, 2) and depths (m,)."""
    # (3, n); a product this narrow is no work for BLAS, whose threads would wait for one another
    local = np.einsum("ij,jn->in", view.rotation, points.T) + view.translation[:, None]
    rows = _perhaps_inside(view.camera, local)
    local = local.take(rows, axis=1)
    pixels = project(view.camera, local.T)
    x, y = pixels.T
    # NaN, behind the camera or beyond its lens, is not inside
    inside = np.flatnonzero((x >= 0) & (x < view.camera.width) & (y >= 0) & (y < view.camera.height))
    return rows[inside], pixels.take(inside, axis=0), local[2, inside]


def _perhaps_inside(camera: Camera, local: FloatArray) -> IntArray:
    """Rows of points (3, n) in the camera's frame that may project into the image; all ahead for a bent lens."""
    if camera.model not in PINHOLES:
        return np.flatnonzero(local[2] > 0)
    *focal, centre_x, centre_y = camera.params
    # tangents of the wider half of the image, and a hair for rounding
    wide = (1 + 1e-9) * max(abs(centre_x), abs(camera.width - centre_x)) / focal[0]
    high = (1 + 1e-9) * max(abs(centre_y), abs(camera.height - centre_y)) / focal[-1]
    return np.flatnonzero((np.abs(local[0]) <= wide * local[2]) & (np.abs(local[1]) <= high * local[2]))


def _rows_by_view(cloud: DenseCloud, views: int) -> list[IntArray] | None:
    """Rows (k,) of the cloud that each of the views sees, by its visibility file; None without one."""
    if cloud.visible_offsets is None or cloud.visible_views is None:
        return None
    every: IntArray = np.arange(len(cloud.points), dtype=np.int32)
    rows = np.repeat(every, np.diff(cloud.visible_offsets))
    order = np.argsort(cloud.visible_views, kind="stable")
    ends = np.searchsorted(cloud.visible_views[order], np.arange(views + 1))
    return [rows[order[start:end]] for start, end in pairwise(ends)]


@dataclass(frozen=True, slots=True, eq=False)
class _Sight:
    """What one view sees: rows (k,) of the points, their pixels (k, 2) and depths (k,)."""

    rows: IntArray
    pixels: FloatArray
    depth: FloatArray


def _sight_of_rows(view: View, points: FloatArray, rows: IntArray) -> _Sight:
    """The sight of the listed rows (k,) of points (n, 3), less those that project outside the image."""
    inside, pixels, depth = _inside_rows(view, np.asfortranarray(points[rows]))
    return _Sight(rows[inside], pixels, depth)


def _matrices(
    sights: Iterable[_Sight], views: Sequence[View], instances: Sequence[Instance], count: int
) -> tuple[csr_array, csr_array]:
    """Sparse (v, n) of what the views see and (m, n) of what they see inside the masks; one view is open at a time."""
    by_view: dict[int, list[int]] = defaultdict(list)
    for number, instance in enumerate(instances):
        by_view[instance.view].append(number)
    seen: list[IntArray] = []
    members: list[IntArray] = [np.empty(0, dtype=np.int32)] * len(instances)
    for index, sight in enumerate(sights):
        rows: IntArray = sight.rows.astype(np.int32)  # half the memory
        seen.append(rows)
        here = [instances[number] for number in by_view[index]]
        for number, inside in zip(by_view[index], view_labels(sight.pixels, here), strict=True):
            near = _at_depth(sight.depth[inside], sight.pixels[inside], instances[number], views[index].camera)
            members[number] = rows[inside[near]]
    return _indicator(seen, count), _indicator(members, count)


def _at_depth(depth: FloatArray, pixels: FloatArray, instance: Instance, camera: Camera) -> BoolArray:
    """(n,) whether points of a mask, at depths (n,) and pixels (n, 2), are near the middle of the thing.

    The middle of a mask is its median depth. Of a box half is background, so there it is the median of the inner half,
    where the thing is.
    """
    if not depth.size:
        return np.ones(depth.shape, dtype=bool)
    size = np.array(instance.mask.shape[::-1], dtype=float)
    inner = depth
    if instance.from_box:
        central = np.abs(pixels - instance.origin - size / 2) <= BOX_CENTRE * size / 2
        inner = depth[central.all(axis=1)] if central.all(axis=1).any() else depth
    middle = float(np.median(inner))
    # the first parameter of every camera model is a focal length in pixels
    diagonal = float(np.hypot(*size)) * middle / float(camera.params[0])
    reach = BOX_DIAGONALS if instance.from_box else DEPTH_DIAGONALS
    return np.asarray(np.abs(depth - middle) <= reach * diagonal)


def _indicator(rows: Sequence[IntArray], count: int) -> csr_array:
    """(r, c) sparse matrix of r = len(rows) rows and c = `count` columns, 1 at the listed columns (k,) of each row."""
    lengths = np.fromiter((len(part) for part in rows), dtype=np.int64, count=len(rows))
    indptr = np.concatenate([[0], np.cumsum(lengths)])
    indices = np.concatenate([*rows, np.empty(0, dtype=np.int32)]).astype(np.int32, copy=False)
    if indptr[-1] < 2**31:
        indptr = indptr.astype(np.int32)
    return csr_array((np.ones(indices.size, dtype=np.float32), indices, indptr), shape=(len(rows), count))


def _column_counts(matrix: csr_array, rows: Sequence[int], count: int) -> IntArray:
    """(c,) how often each of the c = `count` columns is set in the given rows."""
    parts = [matrix.indices[matrix.indptr[row] : matrix.indptr[row + 1]] for row in rows]
    return np.bincount(np.concatenate([*parts, np.empty(0, dtype=np.int32)]), minlength=count)
