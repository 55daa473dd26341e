"""What masks share: points of every cloud that two masks hold, of those that both their views see.

No table of all masks by all masks is held: 20,000 masks would take 1.6 GB for one. Tables are filled for the masks that
are asked about, and `joinable` says which these can be: a pass over blocks of rows keeps the pairs that share enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from estimator.association.point_labels import PointLabels
from metric_base.arrays import FloatArray, IntArray

__all__ = ["MaskOverlap", "linked_parts"]

# Of two masks that see little of each other's points the few they share prove little: this share of the smaller mask's
# own points is added below the line, so that a full tenth of them must be in common before it counts half.
DOUBT_SHARE = 0.1
# Masks whose pairs are looked at together: so many of 20,000 make 5 million pairs at most, 60 MB.
BLOCK_ROWS = 256
# Points and pairs of masks that are summed together, 100 MB.
BLOCK_COST = 1 << 20
# Sums of single precision are exact to far less than this.
ROUNDING = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class MaskOverlap:
    """What m masks share in c clouds.

    members : c of (m, n) sparse, the points of each mask; seen : c of (m, v), points of a mask that a view sees;
    held : c of (m,) points of each mask; views : (m,) the view of each mask.
    """

    members: tuple[csr_array, ...]
    seen: tuple[FloatArray, ...]
    held: tuple[FloatArray, ...]
    views: IntArray

    @classmethod
    def of(cls, clouds: Sequence[PointLabels], views: IntArray) -> MaskOverlap:
        """The overlap of the masks in the clouds; views (m,) of the masks."""
        members = tuple(cloud.membership for cloud in clouds)
        seen = tuple((cloud.membership @ cloud.visibility.T).toarray() for cloud in clouds)
        return cls(members, seen, tuple(np.diff(own.indptr).astype(np.float32) for own in members), views)

    def tables(self, one: IntArray, two: IntArray) -> FloatArray:
        """(3, a, b) of masks `one` (a,) and `two` (b,): points two share; the fewer both views see; doubt."""
        tables: FloatArray = np.zeros((3, len(one), len(two)), dtype=np.float32)
        for members, seen, held in zip(self.members, self.seen, self.held, strict=True):
            tables[0] += (members[one] @ members[two].T).toarray()
            tables[1] += np.minimum(seen[np.ix_(one, self.views[two])], seen[np.ix_(two, self.views[one])].T)
            tables[2] += np.minimum.outer(DOUBT_SHARE * held[one], DOUBT_SHARE * held[two])
        return tables

    def sums(self, group: Sequence[int], others: Sequence[Sequence[int]]) -> FloatArray:
        """(2, k) over the pairs of masks of a group and each of k others, not empty: points shared; their total.

        The doubt is in both.
        """
        ends = np.cumsum([len(other) for other in others])
        rows = np.fromiter((row for other in others for row in other), dtype=np.int64, count=int(ends[-1]))
        shared, smaller, doubt = self.tables(np.array(group, dtype=np.int64), rows)
        lines = np.array([table.sum(axis=0, dtype=float) for table in (shared + doubt, smaller + doubt)])
        return np.asarray(np.add.reduceat(lines, np.concatenate([[0], ends[:-1]]), axis=1))

    def between(self, groups: Sequence[Sequence[int]]) -> FloatArray:
        """(2, k, k) sums over the pairs of masks of k groups: points shared; the union of what both views see."""
        lengths = [len(group) for group in groups]
        rows = np.fromiter((row for group in groups for row in group), dtype=np.int64, count=sum(lengths))
        own = np.repeat(np.arange(len(groups)), lengths)
        chosen = csr_array((np.ones(len(rows)), (own, np.arange(len(rows)))), shape=(len(groups), len(rows)))
        shown, place = np.unique(self.views[rows], return_inverse=True)
        counts = np.zeros((len(groups), len(shown)))
        np.add.at(counts, (own, place), 1)
        tables = np.zeros((2, len(groups), len(groups)))
        for members, seen in zip(self.members, self.seen, strict=True):
            points = chosen @ members[rows]
            shared = (points @ points.T).toarray()
            # sum over masks j of a group of what the view of j sees of i
            sights = (chosen @ seen[np.ix_(rows, shown)]) @ counts.T
            tables += np.array([shared, sights + sights.T - shared])
        return tables

    def pair_sums(self, groups: Sequence[Sequence[int]], pairs: IntArray) -> FloatArray:
        """(4, e) over the masks of pairs (2, e) of groups: points shared; fewer both views see; doubt; the union."""
        lengths = np.array([len(group) for group in groups], dtype=np.int64)
        rows = np.fromiter((row for group in groups for row in group), dtype=np.int64, count=int(lengths.sum()))
        owner, first = np.repeat(np.arange(len(groups)), lengths), np.cumsum(lengths) - lengths
        chosen = csr_array((np.ones(len(rows), dtype=np.float32), (owner, rows)), shape=(len(groups), len(self.views)))
        sums: FloatArray = np.zeros((4, pairs.shape[1]))
        if not pairs.shape[1]:
            return sums
        for members, seen, held in zip(self.members, self.seen, self.held, strict=True):
            points = csr_array(chosen @ members)
            cost = np.diff(points.indptr)[pairs].sum(axis=0) + lengths[pairs].prod(axis=0)
            for own in np.split(np.arange(len(cost)), np.flatnonzero(np.diff(np.cumsum(cost) // BLOCK_COST)) + 1):
                shared = points[pairs[0, own]].multiply(points[pairs[1, own]]).sum(axis=1)
                width = lengths[pairs[1, own]]
                count = lengths[pairs[0, own]] * width
                begin = np.cumsum(count) - count
                step, width = np.arange(int(count.sum())) - np.repeat(begin, count), np.repeat(width, count)
                one = rows[np.repeat(first[pairs[0, own]], count) + step // width]
                two = rows[np.repeat(first[pairs[1, own]], count) + step % width]
                there, here = seen[one, self.views[two]], seen[two, self.views[one]]
                doubt = DOUBT_SHARE * np.minimum(held[one], held[two])
                lines = np.array([np.minimum(there, here), doubt, there + here], dtype=float)
                sums[0, own] += shared
                sums[1:, own] += np.add.reduceat(lines, begin, axis=1)
        sums[3] -= sums[0]
        return sums

    def joinable(self, kinds: IntArray, share: float, share_across: float) -> tuple[IntArray, IntArray]:
        """(2, e) and (2, f) pairs of masks of two views: of one kind (m,) and `share`, of any and `share_across`.

        A group's affinity is a quotient of sums, and no larger than the largest of the summands' quotients: two groups
        reach a share only where a pair of their masks does. So groups of different connected parts never join.
        """
        own: list[IntArray] = [np.empty((2, 0), dtype=np.int32)]
        across: list[IntArray] = [np.empty((2, 0), dtype=np.int32)]
        for start in range(0, len(self.views), BLOCK_ROWS):
            pairs, shared = self._sharing(start)
            smaller, doubt, total = np.zeros((3, pairs.shape[1]), dtype=np.float32)
            views = self.views[pairs]
            for seen, held in zip(self.seen, self.held, strict=True):
                there, here = seen[pairs[0], views[1]], seen[pairs[1], views[0]]
                smaller += np.minimum(there, here)
                total += there + here
                doubt += DOUBT_SHARE * np.minimum(held[pairs[0]], held[pairs[1]])
            apart = views[0] != views[1]
            near = shared >= (1 - ROUNDING) * share * (smaller + doubt)
            own.append(pairs[:, apart & near & (kinds[pairs[0]] == kinds[pairs[1]])])
            across.append(pairs[:, apart & (shared >= (1 - ROUNDING) * share_across * (total - shared))])
        return np.concatenate(own, axis=1), np.concatenate(across, axis=1)

    def _sharing(self, start: int) -> tuple[IntArray, FloatArray]:
        """Pairs (2, e) of a mask of the block from `start` and a later one that share points, and how many (e,)."""
        block = slice(start, start + BLOCK_ROWS)
        both = sum(
            (own[block] @ own[start:].T for own in self.members[1:]), self.members[0][block] @ self.members[0][start:].T
        )
        lines, columns = both.tocoo().coords
        later = columns > lines
        return np.array([lines[later], columns[later]], dtype=np.int32) + np.int32(start), both.tocoo().data[later]


def linked_parts(count: int, links: IntArray) -> list[IntArray]:
    """The connected parts of `count` nodes by their links (2, e): rows (k,) of each in order, by the first of them."""
    graph = csr_array((np.ones(links.shape[1], dtype=bool), (links[0], links[1])), shape=(count, count))
    number, part = connected_components(graph, directed=False)
    order = np.argsort(part, kind="stable")
    parts = np.split(order, np.searchsorted(part[order], np.arange(1, number)))
    return sorted((own for own in parts if len(own)), key=lambda own: int(own[0]))
