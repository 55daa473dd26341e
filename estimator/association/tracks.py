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

import numpy as np
from scipy.sparse import csr_array

from estimator.association.point_labels import PointLabels
from estimator.association.proximity import GroupPlaces, relative_distance
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
# Of two masks that see little of each other's points the few they share prove little: this share of the smaller mask's
# own points is added below the line, so that a full tenth of them must be in common before it counts half.
DOUBT_SHARE = 0.1
# Groups that lie in one place are joined too, unless the views say otherwise: where they see enough of each other's
# points, this share at least must be common.
NOT_CONTRADICTED_SHARE = 0.2
# Clouds of fewer points have a spacing as large as themselves, and lie anywhere.
MIN_PLACE_POINTS = 10
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
    overlaps = [_Overlap.of(cloud, views) for cloud in labels]
    groups: list[list[int]] = []
    for category in sorted({instance.category for instance in instances}):
        rows = np.array([row for row, instance in enumerate(instances) if instance.category == category])
        tables = overlaps[0].within(rows)
        for overlap in overlaps[1:]:
            tables += overlap.within(rows)
        shared, smaller, doubt = tables
        alone = [[number] for number in range(len(rows))]
        joined = _merge_by_points(alone, views[rows], shared, smaller + doubt, JOIN_SHARE)
        shared += doubt
        smaller += doubt
        own = [instances[row] for row in rows]
        clouds = [_mask_points(labels, row) for row in rows]
        near = _merge_by_place(joined, own, clouds, shared, smaller)
        if stated:
            near = _merge_by_statement(near, own, shared, smaller)
        groups += [[int(rows[k]) for k in group] for group in near]
    shared, union = np.sum([overlap.between(groups) for overlap in overlaps], axis=0)
    return _tracks(_merge_by_points(groups, views, shared, union, JOIN_SHARE_ACROSS_CATEGORIES), instances)


def incremental_tracks(instances: Sequence[Instance], labels: PointLabels) -> tuple[Track, ...]:
    """Tracks by Algorithm 1 of the paper, repaired, frame by frame and category by category.

    Equation: D(A, B) = mean over a in A of min over b in B of |a - b|, A the smaller cloud. Pairs are joined nearest
    first while D is under `DISTANCE_SHARE` of the larger one's diagonal; all unmatched objects, old and new, are kept.
    """
    clouds = [labels.points[row_members(labels.membership, row)] for row in range(len(instances))]
    groups: list[list[int]] = []
    for category in sorted({instance.category for instance in instances}):
        known: list[list[int]] = []
        places, by_view = GroupPlaces(clouds), defaultdict(list)
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


@dataclass(frozen=True, slots=True, eq=False)
class _Overlap:
    """What m masks share in one cloud.

    both : (m, m) sparse, points that two masks share; seen : (m, v) points of a mask that a view sees; views : (m,) the
    view of each mask; held : (m,) points of each mask.
    """

    both: csr_array
    seen: FloatArray
    views: IntArray
    held: FloatArray

    @classmethod
    def of(cls, cloud: PointLabels, views: IntArray) -> _Overlap:
        """The overlap of the masks of a cloud; views (m,) of the masks."""
        members = cloud.membership
        seen = (members @ cloud.visibility.T).toarray()
        return cls((members @ members.T).tocsr(), seen, views, np.diff(members.indptr).astype(np.float32))

    def within(self, rows: IntArray) -> FloatArray:
        """(3, k, k) of masks `rows` (k,): points two share; the fewer they hold that both views see; doubt."""
        seen = self.seen[np.ix_(rows, self.views[rows])]
        tables: FloatArray = np.empty((3, len(rows), len(rows)), dtype=np.float32)
        self.both[rows][:, rows].toarray(out=tables[0])
        np.minimum(seen, seen.T, out=tables[1])
        np.minimum.outer(DOUBT_SHARE * self.held[rows], DOUBT_SHARE * self.held[rows], out=tables[2])
        return tables

    def between(self, groups: Sequence[Sequence[int]]) -> FloatArray:
        """(2, k, k) sums over the pairs of masks of k groups: points shared; the union of what both views see."""
        lengths = [len(group) for group in groups]
        rows = np.fromiter((row for group in groups for row in group), dtype=np.int64, count=sum(lengths))
        ends = np.concatenate([[0], np.cumsum(lengths)])
        chosen = csr_array((np.ones(len(rows)), rows, ends), shape=(len(groups), len(self.views)))
        shared = (chosen @ self.both @ chosen.T).toarray()
        counts = np.zeros((len(groups), self.seen.shape[1]))
        np.add.at(counts, (np.repeat(np.arange(len(groups)), lengths), self.views[rows]), 1)
        # sum over masks j of a group of what the view of j sees of i
        seen = (chosen @ self.seen) @ counts.T
        return np.array([shared, seen + seen.T - shared])


def _sums(groups: Sequence[Sequence[int]], table: FloatArray) -> FloatArray:
    """(k, k) sums of a table (m, m) over the pairs of k groups of its rows."""
    order = np.concatenate([np.asarray(group, dtype=np.int64) for group in groups])
    starts = np.concatenate([[0], np.cumsum([len(group) for group in groups])[:-1]])
    return np.asarray(np.add.reduceat(np.add.reduceat(table[np.ix_(order, order)], starts, axis=0), starts, axis=1))


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
    groups: list[list[int]],
    instances: Sequence[Instance],
    clouds: Sequence[FloatArray],
    shared: FloatArray,
    total: FloatArray,
) -> list[list[int]]:
    """Groups of one category after joining those in one place, nearest first, unless the views contradict it.

    An object whose views share no points (a mask cut to a corner, a camera that came back) falls apart by points alone.
    Boxes hold background and say nothing about place. clouds : points (k, 3) of each mask; shared, total : (m, m) what
    two masks share, and their total.
    """
    views = np.array([instance.view for instance in instances])
    merged: list[tuple[int, ...]] = [tuple(group) for group in groups]
    places = GroupPlaces(clouds)
    over, under = _sums(merged, shared), _sums(merged, total)
    barred = _share_a_view(merged, views)
    boxed = np.array([any(instances[row].from_box for row in group) for group in merged])
    barred |= boxed[:, None] | boxed[None, :]

    def distances(one: int) -> FloatArray:
        """(k,) distance of group `one` from each other group that it may join, infinite for the rest."""
        may = ~barred[one] & (over[one] >= NOT_CONTRADICTED_SHARE * under[one])
        row = np.full(len(merged), np.inf)
        for two in np.flatnonzero(may):
            if two != one and _is_place_known(merged[one], merged[two], clouds):
                row[two] = relative_distance(places.of(merged[one]), places.of(merged[two]))
        return row

    apart = np.array([distances(number) for number in range(len(merged))])
    while apart.size and apart.min() < 1:
        first, second = sorted(divmod(int(apart.argmin()), len(merged)))
        merged[first] += merged[second]
        merged[second] = ()
        for table in (over, under, barred):
            table[first] += table[second]
            table[:, first] = table[first]
        barred[second] = barred[:, second] = True
        apart[second] = apart[:, second] = np.inf
        apart[first] = apart[:, first] = distances(first)
    return [list(group) for group in merged if group]


def _merge_by_statement(
    groups: list[list[int]], instances: Sequence[Instance], shared: FloatArray, total: FloatArray
) -> list[list[int]]:
    """Groups of one category after joining those whose masks have one track in the file, the largest first.

    Views that see enough of each other's points and hardly share any contradict it, and so do two masks in one view.
    shared, total : (m, m) what two masks share, and their total.
    """
    by_track: dict[str | None, list[list[int]]] = defaultdict(list)
    for group in sorted(groups, key=len, reverse=True):
        names = Counter(track for row in group if (track := instances[row].track) is not None)
        name = names.most_common(1)[0][0] if names else None
        for other in by_track[name] if name is not None else ():
            apart = {instances[row].view for row in group}.isdisjoint(instances[row].view for row in other)
            over, under = (float(table[np.ix_(group, other)].sum()) for table in (shared, total))
            if apart and (under < MIN_PLACE_POINTS or over >= NOT_CONTRADICTED_SHARE * under):
                other.extend(group)
                break
        else:
            by_track[name].append(list(group))
    return [group for merged in by_track.values() for group in merged]


def _is_place_known(one: Sequence[int], two: Sequence[int], clouds: Sequence[FloatArray]) -> bool:
    """Whether, of two groups with clouds (n, 3), one has enough points to say where it is, the other to lie there."""
    few, many = sorted(sum(len(clouds[row]) for row in group) for group in (one, two))
    return many >= MIN_PLACE_POINTS and few >= MIN_SHARED_POINTS


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
