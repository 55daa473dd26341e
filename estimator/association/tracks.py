"""Objects across frames: which masks of different frames show one object (paper section 4.1, Algorithm 1).

Two ways are kept. `shared_tracks`, the default, joins masks by the points they share among those both views see; it
needs no length and never joins two masks of one frame. `incremental_tracks` is the paper's Algorithm 1 with its two
errors repaired: it stops when the nearest pair is too far (the paper's test is reversed), and objects that a frame does
not show stay.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush

import numpy as np

from estimator.association.linked_groups import merge_linked
from estimator.association.mask_overlap import MaskOverlap, linked_parts
from estimator.association.point_labels import PointLabels
from estimator.association.proximity import MIN_PLACE_POINTS, GroupPlaces, NearbyGroups, relative_distance
from estimator.records.scene import Instance
from estimator.visibility.sights import row_members
from metric_base.arrays import BoolArray, FloatArray, IntArray

__all__ = ["Track", "incremental_tracks", "shared_tracks", "voted_category"]

# Two masks of one object share most of the points that both views see; masks of neighbours share those along a border
# and some that shine through. Half way between none and all.
JOIN_SHARE = 0.5
# Two labels of one object (bucket and cup) are joined only on stronger evidence: a poster lies within its cabinet's
# mask, but its points are a small part of the cabinet's, and share is taken over the union.
JOIN_SHARE_ACROSS_CATEGORIES = 0.7
# Masks that share fewer points than this are told apart by chance.
MIN_SHARED_POINTS = 3
# Groups that lie in one place are joined too, unless the views say otherwise: where they see enough of each other's
# points, this share at least must be common.
NOT_CONTRADICTED_SHARE = 0.2
# More masks or groups that links join into one part are joined without tables of all by all: five such tables of 2,000
# take 100 MB.
MAX_TABLE = 2000
# Points of one mask that say where it is.
MAX_MASK_POINTS = 1000


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One object: rows of the instances that show it, at most one per view, and the category most of them name."""

    members: tuple[int, ...]
    category: str


def shared_tracks(
    instances: Sequence[Instance], labels: Sequence[PointLabels], stated: bool = False
) -> tuple[Track, ...]:
    """Tracks by shared points: the closest pair of groups is joined first, never two masks of one view.

    The affinity of two groups is the points their masks share over the points that either holds among those the other's
    view sees, summed over all pairs of their masks and over the clouds in `labels`. For masks of one category "either"
    is the smaller, since a mask cut by the image or by another object holds a part of the whole; groups of different
    categories are joined afterwards by the union of both, so that a poster does not join its cabinet.

    stated : groups that the file gives one track are joined too, unless the views contradict it.
    """
    views = np.array([instance.view for instance in instances], dtype=np.int64)
    names, kinds = np.unique([instance.category for instance in instances], return_inverse=True)
    overlap = MaskOverlap.of(labels, views)
    own, across = overlap.joinable(kinds, JOIN_SHARE, JOIN_SHARE_ACROSS_CATEGORIES)
    joined: list[list[list[int]]] = [[] for _ in names]
    for part in linked_parts(len(instances), own):
        joined[kinds[part[0]]] += _merge_part(part, overlap, own)
    places = GroupPlaces(lambda row: _mask_points(labels, row))
    groups: list[list[int]] = []
    for alike in joined:
        near = _merge_by_place(sorted(alike), instances, places, overlap)
        groups += _merge_by_statement(near, instances, overlap) if stated else near
    return _tracks(_merge_across(groups, overlap, across), instances)


def incremental_tracks(instances: Sequence[Instance], labels: PointLabels) -> tuple[Track, ...]:
    """Tracks by Algorithm 1 of the paper, repaired, frame by frame and category by category.

    Equation: D(A, B) = mean over a in A of min over b in B of |a - b|, A the smaller cloud. Pairs are joined nearest
    first while D is under `DISTANCE_SHARE` of the larger one's diagonal; all unmatched objects, old and new, are kept.
    """
    groups: list[list[int]] = []
    for category in sorted({instance.category for instance in instances}):
        known: list[list[int]] = []
        places = GroupPlaces(lambda row: labels.points[row_members(labels.membership, row)])
        by_view = defaultdict(list)
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


def _mask_points(labels: Sequence[PointLabels], row: int) -> FloatArray:
    """(k, 3) points of one mask in all clouds, in world, at most `MAX_MASK_POINTS` of each cloud."""
    rows = [row_members(cloud.membership, row) for cloud in labels]
    thin = [own[:: max(1, -(-len(own) // MAX_MASK_POINTS))] for own in rows]
    return np.concatenate([cloud.points[own] for cloud, own in zip(labels, thin, strict=True)])


def _merge_part(part: IntArray, overlap: MaskOverlap, links: IntArray) -> list[list[int]]:
    """Groups of the masks (k,) of one category, joined by the points they share; links (2, e) of all masks."""
    if len(part) > MAX_TABLE:
        place: IntArray = np.full(len(overlap.views), -1)
        place[part] = np.arange(len(part))
        inner = place[links]

        def sums(groups: Sequence[Sequence[int]], pairs: IntArray) -> FloatArray:
            shared, smaller, doubt, _ = overlap.pair_sums(groups, pairs)
            return np.array([shared, smaller + doubt])

        alone = [[int(row)] for row in part]
        return merge_linked(alone, inner[:, inner[0] >= 0], overlap.views, sums, JOIN_SHARE, MIN_SHARED_POINTS)
    shared, smaller, doubt = overlap.tables(part, part)
    alone = [[number] for number in range(len(part))]
    merged = _merge_by_points(alone, overlap.views[part], shared, smaller + doubt, JOIN_SHARE)
    return [[int(part[k]) for k in group] for group in merged]


def _merge_across(groups: list[list[int]], overlap: MaskOverlap, links: IntArray) -> list[list[int]]:
    """Groups of all categories after joining those that share most of their points; links (2, e) of masks."""
    owner: IntArray = np.empty(len(overlap.views), dtype=np.int64)
    for number, group in enumerate(groups):
        owner[group] = number
    merged: list[list[int]] = []
    for part in linked_parts(len(groups), owner[links]):
        own = [groups[number] for number in part]
        if len(own) > MAX_TABLE:
            place: IntArray = np.full(len(groups), -1)
            place[part] = np.arange(len(part))
            inner = place[owner[links]]
            inner = inner[:, (inner[0] >= 0) & (inner[0] != inner[1])]
            own = merge_linked(
                own,
                inner,
                overlap.views,
                lambda groups, pairs: overlap.pair_sums(groups, pairs)[[0, 3]],
                JOIN_SHARE_ACROSS_CATEGORIES,
                MIN_SHARED_POINTS,
            )
        elif len(own) > 1:
            shared, union = overlap.between(own)
            own = _merge_by_points(own, overlap.views, shared, union, JOIN_SHARE_ACROSS_CATEGORIES)
        merged += own
    return merged


def _share_a_view(groups: Sequence[Sequence[int]], views: IntArray) -> BoolArray:
    """(k, k) whether two groups of masks have a view in common; `views` (m,) of the masks."""
    seen = np.zeros((len(groups), int(views.max(initial=0)) + 1), dtype=np.float32)
    for number, group in enumerate(groups):
        seen[number, views[list(group)]] = 1
    return np.asarray((seen @ seen.T) > 0)


def _merge_by_points(
    groups: Sequence[Sequence[int]], views: IntArray, over: FloatArray, under: FloatArray, share: float
) -> list[list[int]]:
    """Groups after joining the best pair first while it reaches `share`; groups with a view in common never join.

    over, under : (k, k) points shared and their total between groups; both are used up. The best partner of every group
    is kept, so that a step takes k operations and not k squared.
    """
    members = [list(group) for group in groups]
    if len(members) < 2:
        return members
    barred = _share_a_view(members, views)
    affinity = _affinity(over, under, barred)
    partner, best = affinity.argmax(axis=1), affinity.max(axis=1)
    while best.max() >= share:
        one = int(best.argmax())
        two = int(partner[one])
        members[one] += members[two]
        members[two] = []
        for table in (over, under, barred):
            table[one] += table[two]
            table[:, one] = table[one]
        barred[two] = barred[:, two] = True
        affinity[one] = affinity[:, one] = row = _affinity(over[one], under[one], barred[one])
        affinity[two] = affinity[:, two] = 0
        _renew(affinity, partner, best, row, one, two)
    return [group for group in members if group]


def _renew(affinity: FloatArray, partner: IntArray, best: FloatArray, row: FloatArray, one: int, two: int) -> None:
    """Bring the best partners up to date after group `two` went into `one`, whose affinities are now `row` (k,)."""
    stale = (partner == two) | ((partner == one) & (row < best))
    stale[[one, two]] = True
    better = ~stale & ((row > best) | ((row == best) & (one < partner)))
    partner[better], best[better] = one, row[better]
    rows = np.flatnonzero(stale)
    part = affinity[rows]
    partner[rows] = part.argmax(axis=1)
    best[rows] = part.max(axis=1)


def _merge_by_place(
    groups: list[list[int]], instances: Sequence[Instance], places: GroupPlaces, overlap: MaskOverlap
) -> list[list[int]]:
    """Groups of one category after joining those in one place, nearest first, unless the views contradict it.

    An object whose views share no points (a mask cut to a corner, a camera that came back) falls apart by points alone.
    Boxes hold background and say nothing about place.
    """
    merged = [tuple(group) for group in groups]
    nearby = NearbyGroups(places, [() if any(instances[row].from_box for row in group) else group for group in merged])
    shown = np.zeros((len(merged), int(overlap.views.max(initial=0)) + 1), dtype=bool)
    for number, group in enumerate(merged):
        shown[number, overlap.views[list(group)]] = True
    age = [0] * len(merged)

    def distances(one: int) -> list[tuple[float, int]]:
        """Groups that `one` may join, with the distance of each."""
        near = nearby.of(one)
        near = near[~(shown[near] & shown[one]).any(axis=1)]
        if not len(near):
            return []
        over, under = overlap.sums(merged[one], [merged[two] for two in near])
        near = near[over >= NOT_CONTRADICTED_SHARE * under]
        apart = ((relative_distance(places.of(merged[one]), places.of(merged[two])), int(two)) for two in near)
        return [(distance, two) for distance, two in apart if distance < 1]

    # of equal distances the first pair; one whose group has grown since is passed over
    waiting = [(apart, one, two, 0, 0) for one in range(len(merged)) for apart, two in distances(one)]
    heapify(waiting)
    while waiting:
        _, one, two, *ages = heappop(waiting)
        if ages != [age[one], age[two]]:
            continue
        first, second = sorted((one, two))
        places.forget(merged[first], merged[second])
        merged[first] += merged[second]
        merged[second] = ()
        shown[first] |= shown[second]
        age[first], age[second] = age[first] + 1, -1
        nearby.replace(first, merged[first])
        nearby.replace(second, ())
        for apart, other in distances(first):
            heappush(waiting, (apart, first, other, age[first], age[other]))
            heappush(waiting, (apart, other, first, age[other], age[first]))
    return [list(group) for group in merged if group]


def _merge_by_statement(
    groups: list[list[int]], instances: Sequence[Instance], overlap: MaskOverlap
) -> list[list[int]]:
    """Groups of one category after joining those whose masks have one track in the file, the largest first.

    Views that see enough of each other's points and hardly share any contradict it, and so do two masks in one view.
    """
    by_track: dict[str | None, list[list[int]]] = defaultdict(list)
    for group in sorted(groups, key=len, reverse=True):
        names = Counter(track for row in group if (track := instances[row].track) is not None)
        name = names.most_common(1)[0][0] if names else None
        for other in by_track[name] if name is not None else ():
            if not {instances[row].view for row in group}.isdisjoint(instances[row].view for row in other):
                continue
            over, under = overlap.sums(group, [other])[:, 0]
            if under < MIN_PLACE_POINTS or over >= NOT_CONTRADICTED_SHARE * under:
                other.extend(group)
                break
        else:
            by_track[name].append(list(group))
    return [group for merged in by_track.values() for group in merged]


def _affinity(shared: FloatArray, total: FloatArray, barred: BoolArray) -> FloatArray:
    """Shared points (g, g) over the total (g, g); 0 where groups may not join or share too few to tell."""
    return np.where(barred | (shared < MIN_SHARED_POINTS), 0.0, shared / np.maximum(total, 1))


def _merge_frame(known: list[list[int]], fresh: list[int], places: GroupPlaces) -> list[list[int]]:
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
