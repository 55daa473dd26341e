"""Point labels: which points of a cloud lie in which instance mask (paper section 4.1).

The paper takes every point whose projection falls in a mask, so that a clump of the wall behind an object joins it.
Here a point counts only in views that see it: a sparse point where it was itself observed, a dense point where the
visibility file says so or, without one, where no nearer part of the cloud covers it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array

from estimator.reconstructions.cameras import project
from estimator.records.scene import Camera, Instance, Scene, View
from metric_base.arrays import BoolArray, FloatArray, IntArray

__all__ = ["PointLabels", "PointVotes", "dense_labels", "point_votes", "sparse_labels", "view_labels", "visible_rows"]

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
# A point belongs to an object when at least six tenths of the views that see both put it inside the object's mask: a
# mask misses a tenth of what it shows and noisy points at outlines more, the wall behind is inside in half of the views
# at most. A box is wider than the object, so most views agree on background too: there nearly all views must agree.
MASK_SHARE = 0.6
BOX_SHARE = 0.85


@dataclass(frozen=True, slots=True, eq=False)
class PointLabels:
    """Labels of one cloud of n points seen by v views with m instances.

    points : (n, 3); membership : (m, n) sparse, 1 where the point is seen inside the mask; visibility : (v, n) sparse,
    1 where the view sees the point; looked : (v, n) sparse, 1 where the view looks at the point's place with nothing
    before it, whether or not it was matched there; masked : (m, n) sparse, 1 where it does so inside the mask.
    """

    points: FloatArray
    membership: csr_array
    visibility: csr_array
    looked: csr_array
    masked: csr_array


@dataclass(frozen=True, slots=True, eq=False)
class PointVotes:
    """Rows of the cloud that each track owns (one array per track)."""

    rows: tuple[IntArray, ...]


def sparse_labels(scene: Scene, instances: Sequence[Instance]) -> PointLabels:
    """Labels of the sparse points by their own observations: a keypoint inside a mask labels its point."""
    pixels = [view.keypoints for view in scene.views]
    rows = [view.point_index for view in scene.views]
    seen = _Sight(scene.views, scene.points, rows, pixels)
    return _labels(seen, seen, instances)


def dense_labels(scene: Scene, instances: Sequence[Instance]) -> PointLabels:
    """Labels of the dense points by projection into the views that see them.

    Raises ValueError where the scene has no dense cloud.
    """
    if scene.dense is None:
        raise ValueError("the scene has no dense cloud")
    points = scene.dense.points
    visible = [visible_rows(view, points) for view in scene.views]
    looked = _Sight(scene.views, points, [rows for rows, _ in visible], [pixels for _, pixels in visible])
    listed = _rows_by_view(scene.dense.visible_offsets, scene.dense.visible_views, len(scene.views))
    if listed is None:
        return _labels(looked, looked, instances)
    inside = [_inside_rows(view, points[rows]) for view, rows in zip(scene.views, listed, strict=True)]
    rows = [given[within] for given, (within, _, _) in zip(listed, inside, strict=True)]
    return _labels(_Sight(scene.views, points, rows, [pixels for _, pixels, _ in inside]), looked, instances)


def point_votes(labels: PointLabels, instances: Sequence[Instance], tracks: Sequence[Sequence[int]]) -> PointVotes:
    """Points of each track: a point goes to the track that the largest share of its views agrees on.

    For are the views that see the point inside the track's mask; against are those that look at its place with nothing
    before it and have it outside. A view without a mask of the track is not asked: a missed detection is no vote
    against. tracks : rows of `instances`, one sequence per track.
    """
    count = labels.points.shape[0]
    best = np.zeros(count)
    owner = np.full(count, -1)
    for number, members in enumerate(tracks):
        inside = _column_counts(labels.membership, members, count)
        rows = np.flatnonzero(inside)
        views = sorted({instances[member].view for member in members})
        against = (
            _column_counts(labels.looked, views, count)[rows] - _column_counts(labels.masked, members, count)[rows]
        )
        share = inside[rows] / (inside[rows] + np.maximum(against, 0))
        boxes = all(instances[member].from_box for member in members)
        # a hair per vote settles ties between masks that overlap: the more often seen, the surer
        score = share + 1e-6 * inside[rows]
        wins = (share >= (BOX_SHARE if boxes else MASK_SHARE)) & (score > best[rows])
        best[rows[wins]] = score[wins]
        owner[rows[wins]] = number
    return PointVotes(tuple(np.flatnonzero(owner == number) for number in range(len(tracks))))


def view_labels(pixels: FloatArray, instances: Iterable[Instance]) -> list[IntArray]:
    """Positions in `pixels` (n, 2) that fall inside each instance's mask; pixel (x, y) covers [x, x + 1)."""
    columns = np.floor(pixels[:, 0]).astype(np.int32)
    lines = np.floor(pixels[:, 1]).astype(np.int32)
    members = []
    for instance in instances:
        height, width = instance.mask.shape
        x, y = columns - np.int32(instance.origin[0]), lines - np.int32(instance.origin[1])
        near = np.flatnonzero((x >= 0) & (x < width) & (y >= 0) & (y < height))
        members.append(near[instance.mask[y[near], x[near]]])
    return members


def visible_rows(view: View, points: FloatArray) -> tuple[IntArray, FloatArray]:
    """Rows of points (n, 3) that the view sees, by a depth buffer of the cloud itself, and their pixels (m, 2).

    The buffer's cells are as large as the cloud's density asks for; a point is kept when it lies within
    `DEPTH_TOLERANCE` of the nearest depth in its cell.
    """
    rows, pixels, depth = _inside_rows(view, points)
    if rows.size == 0:
        return rows, pixels
    cell = _cell_size(view.camera, rows.size)
    across = int(view.camera.width // cell) + 1
    columns, lines = (pixels.T * (1 / cell)).astype(np.int64)
    cells = lines * across + columns
    nearest = np.full(int(cells.max()) + 1, np.inf)
    np.minimum.at(nearest, cells, depth)
    seen = depth <= nearest[cells] * (1 + DEPTH_TOLERANCE)
    return rows[seen], pixels[seen]


def _cell_size(camera: Camera, count: int) -> float:
    """Side in pixels of a depth buffer's cell for `count` points in the image."""
    side = max(camera.width, camera.height)
    wanted = np.sqrt(camera.width * camera.height * POINTS_PER_CELL / count)
    return float(np.clip(wanted, side / CELLS_ALONG_SIDE[1], side / CELLS_ALONG_SIDE[0]))


def _inside_rows(view: View, points: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Rows of the points (n, 3) that project into the image, their pixels (m, 2) and depths (m,)."""
    # a product this narrow is no work for BLAS, whose threads would wait for one another
    camera_points = np.einsum("nj,ij->ni", points, view.rotation) + view.translation
    pixels = project(view.camera, camera_points)
    x, y = pixels.T
    # NaN, behind the camera or beyond its lens, is not inside
    rows = np.flatnonzero((x >= 0) & (x < view.camera.width) & (y >= 0) & (y < view.camera.height))
    return rows, pixels[rows], camera_points[rows, 2]


def _rows_by_view(offsets: IntArray | None, views: IntArray | None, count: int) -> list[IntArray] | None:
    """Rows of the cloud that each view sees, from the compressed rows of a visibility file."""
    if offsets is None or views is None:
        return None
    point_rows = np.repeat(np.arange(offsets.size - 1), np.diff(offsets))
    order = np.argsort(views, kind="stable")
    ends = np.searchsorted(views[order], np.arange(count + 1))
    return [point_rows[order[start:end]] for start, end in pairwise(ends)]


@dataclass(frozen=True, slots=True, eq=False)
class _Sight:
    """Which rows of points (n, 3) each of the views sees, and at which pixels."""

    views: Sequence[View]
    points: FloatArray
    rows: Sequence[IntArray]
    pixels: Sequence[FloatArray]


def _labels(seen: _Sight, looked: _Sight, instances: Sequence[Instance]) -> PointLabels:
    """All four sparse matrices from what the views see and what they look at."""
    count = len(seen.points)
    membership, visibility = _indicator(_members(seen, instances), count), _indicator(seen.rows, count)
    if looked is seen:
        return PointLabels(seen.points, membership, visibility, visibility, membership)
    looked_members = _indicator(_members(looked, instances), count)
    return PointLabels(seen.points, membership, visibility, _indicator(looked.rows, count), looked_members)


def _members(sight: _Sight, instances: Sequence[Instance]) -> list[IntArray]:
    """Rows of the points that each instance's view sees inside its mask and at its depth."""
    members: list[IntArray] = [np.empty(0, dtype=np.int64)] * len(instances)
    by_view: dict[int, list[int]] = defaultdict(list)
    for number, instance in enumerate(instances):
        by_view[instance.view].append(number)
    for index, here in by_view.items():
        view, rows = sight.views[index], sight.rows[index]
        depth = sight.points[rows] @ view.rotation[2] + view.translation[2]
        inside = view_labels(sight.pixels[index], [instances[number] for number in here])
        for number, positions in zip(here, inside, strict=True):
            members[number] = rows[positions[_at_depth(depth[positions], instances[number], view.camera)]]
    return members


def _at_depth(depth: FloatArray, instance: Instance, camera: Camera) -> BoolArray:
    """(n,) whether points of a mask lie near their median depth; all of a box, which is mostly background."""
    if instance.from_box or not depth.size:
        return np.ones(depth.shape, dtype=bool)
    middle = float(np.median(depth))
    # the first parameter of every camera model is a focal length in pixels
    diagonal = float(np.hypot(*instance.mask.shape)) * middle / float(camera.params[0])
    return np.asarray(np.abs(depth - middle) <= DEPTH_DIAGONALS * diagonal)


def _indicator(rows: Sequence[IntArray], count: int) -> csr_array:
    """(len(rows), count) sparse matrix with 1 at the listed columns of each row."""
    lengths = np.fromiter((len(part) for part in rows), dtype=np.int64, count=len(rows))
    indptr = np.concatenate([[0], np.cumsum(lengths)])
    indices = np.concatenate([*rows, np.empty(0, dtype=np.int64)]).astype(np.int64)
    return csr_array((np.ones(indices.size, dtype=np.float32), indices, indptr), shape=(len(rows), count))


def _column_counts(matrix: csr_array, rows: Sequence[int], count: int) -> IntArray:
    """How often each column is set in the given rows."""
    parts = [matrix.indices[matrix.indptr[row] : matrix.indptr[row + 1]] for row in rows]
    return np.bincount(np.concatenate([*parts, np.empty(0, dtype=np.int64)]).astype(np.int64), minlength=count)
