"""Objects across frames: which masks of different frames show one thing (paper section 4.1, Algorithm 1).

Two ways are kept. `shared_tracks`, the default, joins masks by the points they share among those both views see; it
needs no length and never joins two masks of one frame. `incremental_tracks` is the paper's Algorithm 1 with its two
faults repaired: it stops when the nearest pair is too far (the paper's test is reversed), and objects that a frame does
not show stay.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np

from estimator.geometry.point_labels import PointLabels
from estimator.geometry.proximity import Places, relative_distance
from estimator.records.scene import Instance
from metric_base.arrays import BoolArray, FloatArray, IntArray

__all__ = ["Track", "incremental_tracks", "shared_tracks", "voted_category"]

# Two masks of one thing share most of the points that both views see; masks of neighbours share those along a border
# and some that shine through. Half way between none and all.
JOIN_SHARE = 0.5
# Two labels of one thing (bucket and cup) are joined only on stronger evidence: a poster lies within its cabinet's
# mask, but its points are a small part of the cabinet's, and share is taken over the union.
JOIN_SHARE_ACROSS_CATEGORIES = 0.7
# Masks that share fewer points than this are told apart by chance.
MIN_SHARED_POINTS = 3
# Of two masks that see little of each other's points the few they share prove little: this share of the smaller mask's
# own points is added below the line, so that a full tenth of them must be in common before it counts half.
DOUBT_SHARE = 0.1
# Groups that lie in one place are joined too, unless the views say otherwise: where they see enough of each other's
# points, this share at least must be common.
NOT_CONTRADICTED_SHARE = 0.2
# Clouds of fewer points have a spacing as large as themselves, and lie anywhere.
MIN_PLACE_POINTS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One thing: rows of the instances that show it, at most one per view, and the category most of them name."""

    members: tuple[int, ...]
    category: str


def shared_tracks(instances: Sequence[Instance], labels: Sequence[PointLabels]) -> tuple[Track, ...]:
    """Tracks by shared points: the closest pair of groups is joined first, never two masks of one view.

    The affinity of two groups is the points their masks share over the points that either holds among those the other's
    view sees, summed over all pairs of their masks and over the clouds in `labels`. For masks of one category "either"
    is the smaller, since a mask cut by the image or by another thing holds a part of the whole; groups of different
    categories are joined afterwards by the union of both, so that a poster does not join its cabinet.
    """
    views = np.array([instance.view for instance in instances], dtype=np.int64)
    shared, smaller, union, doubt = _overlaps(views, labels)
    clouds = [np.concatenate([cloud.points[_members(cloud, row)] for cloud in labels]) for row in range(len(instances))]
    groups: list[list[int]] = []
    for category in sorted({instance.category for instance in instances}):
        rows = [row for row, instance in enumerate(instances) if instance.category == category]
        alone = [[row] for row in rows]
        joined = _merge_by_points(alone, views, shared, smaller + doubt, JOIN_SHARE)
        groups += _merge_by_place(joined, instances, clouds, shared + doubt, smaller + doubt)
    groups = _merge_by_points(groups, views, shared, union, JOIN_SHARE_ACROSS_CATEGORIES)
    return _tracks(groups, instances)


def incremental_tracks(instances: Sequence[Instance], labels: PointLabels) -> tuple[Track, ...]:
    """Tracks by Algorithm 1 of the paper, repaired, frame by frame and category by category.

    Equation: D(A, B) = mean over a in A of min over b in B of |a - b|, A the smaller cloud. Pairs are joined nearest
    first while D is under `DISTANCE_SHARE` of the larger one's diagonal; all unmatched objects, old and new, are kept.
    """
    clouds = [labels.points[_members(labels, row)] for row in range(len(instances))]
    groups: list[list[int]] = []
    for category in sorted({instance.category for instance in instances}):
        known: list[list[int]] = []
        places, by_view = Places(clouds), defaultdict(list)
        for row, instance in enumerate(instances):
            if instance.category == category:
                by_view[instance.view].append(row)
        for view in sorted(by_view):
            known = _merge_frame(known, by_view[view], places)
        groups += known
    return _tracks(groups, instances)


def voted_category(instances: Sequence[Instance]) -> str:
    """The category with the largest sum of scores; the first in the alphabet of equals."""
    votes: dict[str, float] = defaultdict(float)
    for instance in instances:
        votes[instance.category] += instance.score
    return min(votes, key=lambda name: (-votes[name], name))


def _tracks(groups: Sequence[Sequence[int]], instances: Sequence[Instance]) -> tuple[Track, ...]:
    ordered = sorted(tuple(sorted(group)) for group in groups)
    return tuple(Track(group, voted_category([instances[row] for row in group])) for group in ordered)


def _members(labels: PointLabels, row: int) -> IntArray:
    matrix = labels.membership
    return np.asarray(matrix.indices[matrix.indptr[row] : matrix.indptr[row + 1]])


def _overlaps(views: IntArray, labels: Sequence[PointLabels]) -> FloatArray:
    """(4, m, m) points two masks share; the fewer, and the union, of those they hold that both views see; doubt."""
    count = len(views)
    shared, smaller, union, doubt = tables = np.zeros((4, count, count))
    for cloud in labels:
        both = (cloud.membership @ cloud.membership.T).toarray()
        # (m, m): points of mask i that the view of mask j sees
        seen = (cloud.membership @ cloud.visibility.T).toarray()[:, views]
        shared += both
        held = np.diff(cloud.membership.indptr).astype(float)
        smaller += np.minimum(seen, seen.T)
        doubt += DOUBT_SHARE * np.minimum(held[:, None], held[None, :])
        union += seen + seen.T - both
    return tables


def _merge_by_points(
    groups: Sequence[Sequence[int]], views: IntArray, shared: FloatArray, total: FloatArray, share: float
) -> list[list[int]]:
    """Groups after joining the best pair first while it reaches `share`; groups with a view in common never join."""
    members = [list(group) for group in groups]
    count = len(members)
    indicator = np.zeros((count, len(views)))
    for number, group in enumerate(members):
        indicator[number, group] = 1
    over = indicator @ shared @ indicator.T
    under = indicator @ total @ indicator.T
    seen = np.zeros((count, int(views.max(initial=0)) + 1))
    np.add.at(seen, (np.nonzero(indicator)[0], views[np.nonzero(indicator)[1]]), 1)
    barred = (seen @ seen.T) > 0
    affinity = _affinity(over, under, barred)
    while count > 1:
        one, two = divmod(int(affinity.argmax()), count)
        if affinity[one, two] < share:
            break
        members[one] += members[two]
        members[two] = []
        for table in (over, under, barred):
            table[one] += table[two]
            table[:, one] += table[:, two]
        barred[two] = barred[:, two] = True
        affinity[one] = affinity[:, one] = _affinity(over[one], under[one], barred[one])
        affinity[two] = affinity[:, two] = 0
    return [group for group in members if group]


def _merge_by_place(
    groups: list[list[int]],
    instances: Sequence[Instance],
    clouds: Sequence[FloatArray],
    shared: FloatArray,
    total: FloatArray,
) -> list[list[int]]:
    """Groups of one category after joining those that lie in one place, nearest first, unless the views contradict it.

    A thing whose views share no points (a mask cut to a corner, a camera that came back) falls apart by points alone.
    Boxes hold background and say nothing about place.
    """
    merged = [tuple(group) for group in groups]
    places = Places(clouds)

    @cache
    def distance(one: tuple[int, ...], two: tuple[int, ...]) -> float:
        if not (_may_join(one, two, instances, shared, total) and _is_place_known(one, two, clouds)):
            return np.inf
        return relative_distance(places.of(one), places.of(two))

    while True:
        pairs = combinations(range(len(merged)), 2)
        nearest, first, second = min(((distance(merged[a], merged[b]), a, b) for a, b in pairs), default=(np.inf, 0, 0))
        if nearest >= 1:
            return [list(group) for group in merged]
        merged[first] += merged.pop(second)


def _may_join(
    one: Sequence[int], two: Sequence[int], instances: Sequence[Instance], shared: FloatArray, total: FloatArray
) -> bool:
    """Whether two groups have masks rather than boxes, no view in common, and no views that tell them apart."""
    if any(instances[row].from_box for row in (*one, *two)):
        return False
    if {instances[row].view for row in one} & {instances[row].view for row in two}:
        return False
    pairs = np.ix_(one, two)
    return bool(shared[pairs].sum() >= NOT_CONTRADICTED_SHARE * total[pairs].sum())


def _is_place_known(one: Sequence[int], two: Sequence[int], clouds: Sequence[FloatArray]) -> bool:
    """Whether one of two groups has points enough to say where it is, and the other enough to lie there."""
    few, many = sorted(sum(len(clouds[row]) for row in group) for group in (one, two))
    return many >= MIN_PLACE_POINTS and few >= MIN_SHARED_POINTS


def _affinity(shared: FloatArray, total: FloatArray, barred: BoolArray) -> FloatArray:
    """Shared points over the total; 0 where groups may not join or share too few to tell."""
    return np.where(barred | (shared < MIN_SHARED_POINTS), 0.0, shared / np.maximum(total, 1))


def _merge_frame(known: list[list[int]], fresh: list[int], places: Places) -> list[list[int]]:
    """Objects after one frame: MergePointCloud of Algorithm 1 with both repairs."""
    new_places = [places.of((row,)) for row in fresh]
    distances = np.array(
        [[relative_distance(places.of(tuple(group)), place) for place in new_places] for group in known]
    )
    waiting = set(fresh)
    merged = [list(group) for group in known]
    while distances.size and distances.min() < 1:
        old, new = divmod(int(distances.argmin()), len(fresh))
        merged[old].append(fresh[new])
        waiting.discard(fresh[new])
        distances[old], distances[:, new] = np.inf, np.inf
    return merged + [[row] for row in fresh if row in waiting]
