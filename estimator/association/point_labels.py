"""Point labels: which points of a cloud lie in which instance mask (paper section 4.1).

The paper takes every point whose projection falls in a mask, so that a clump of the wall behind an object joins it.
Here a point counts only in views that see it: a sparse point where it was itself observed, a dense point where the
visibility file says so or, without one, where no nearer part of the cloud covers it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from estimator.records.scene import Camera, Instance, Scene, View
from estimator.visibility.depth_buffer import unhidden
from estimator.visibility.sights import Sight, indicator, listed_rows, row_members, sight_of
from metric_base.arrays import BoolArray, FloatArray, IntArray

__all__ = ["PointLabels", "dense_labels", "point_votes", "sparse_labels", "view_labels"]

# What lies in a mask but this many diagonals of the mask before or behind the middle of what else does is a stray or
# the wall seen through the object: few objects are three times as deep as they look wide, and those are seen from
# elsewhere too.
DEPTH_DIAGONALS = 1.5
# The part of a box's width and height where the object is rather than what is behind it, and the reach in depth about
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
    sights = (Sight.of_observations(view, scene.points) for view in scene.views)
    visibility, membership = _matrices(sights, scene.views, instances, len(scene.points))
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
    looks = (unhidden(view, points) for view in views)
    looked, masked = _matrices(looks, views, instances, len(points))
    listed = listed_rows(scene.dense, len(views))
    if listed is None:
        return PointLabels(own, rows, masked, looked, looked, masked)
    sights = (_listed_sight(view, points, some) for view, some in zip(views, listed, strict=True))
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


def _listed_sight(view: View, points: FloatArray, rows: IntArray) -> Sight:
    """The sight of the listed rows (k,) of points (n, 3), less those that project outside the image."""
    sight = sight_of(view, np.asfortranarray(points[rows]))
    return Sight(rows[sight.rows], sight.pixels, sight.depths)


def _matrices(
    sights: Iterable[Sight], views: Sequence[View], instances: Sequence[Instance], count: int
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
            near = _at_depth(sight.depths[inside], sight.pixels[inside], instances[number], views[index].camera)
            members[number] = rows[inside[near]]
    return indicator(seen, count), indicator(members, count)


def _at_depth(depth: FloatArray, pixels: FloatArray, instance: Instance, camera: Camera) -> BoolArray:
    """(n,) whether points of a mask, at depths (n,) and pixels (n, 2), are near the middle of the object.

    The middle of a mask is its median depth. Of a box half is background, so there it is the median of the inner half,
    where the object is.
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


def _column_counts(matrix: csr_array, rows: Sequence[int], count: int) -> IntArray:
    """(c,) how often each of the c = `count` columns is set in the given rows."""
    parts = [row_members(matrix, row) for row in rows]
    return np.bincount(np.concatenate([*parts, np.empty(0, dtype=np.int32)]), minlength=count)
