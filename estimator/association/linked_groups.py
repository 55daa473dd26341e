"""Groups of many linked masks: sums of the linked pairs are held, not tables of all groups by all.

Of 20,000 masks that chain into one part each table would take 1.6 GB. A quotient of sums is between the quotients of
its summands. So groups that are each other's best partner can be joined at once, in rounds, and pairs below the share
need not be kept: what they grow into is no nearer. Only ties and pairs of very few points can end otherwise than by
joining the best pair first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import BoolArray, FloatArray, IntArray

__all__ = ["merge_linked"]

# Odd numbers that scatter the order of equal affinities: in rows of equals one pair a round would be joined.
SCATTER = np.array([[2654435761], [2246822519]], dtype=np.uint64)
# Pairs that are looked up in the table of views at once.
BLOCK_PAIRS = 1 << 16


def merge_linked(
    groups: Sequence[Sequence[int]],
    links: IntArray,
    views: IntArray,
    sums: Callable[[Sequence[Sequence[int]], IntArray], FloatArray],
    share: float,
    least_shared: float,
) -> list[list[int]]:
    """Groups after joining the best pairs while they reach `share`; groups with a view in common never join.

    links : (2, e) of groups that may join; views : (m,) of the masks; sums : of groups and pairs (2, e), the points
    shared and their total (2, e); least_shared : fewer shared points join nothing.
    """
    members = [list(group) for group in groups]
    pairs = _unlike_views(_distinct(links, len(members)), _views_shown(members, views))
    table = sums(members, pairs)
    while True:
        near = table[0] >= share * table[1]
        pairs, table = pairs[:, near], table[:, near]
        joined = _mutual_best(pairs, table, least_shared, len(members))
        if not joined.any():
            return members
        owner, members = _join(members, pairs[:, joined])
        grown: BoolArray = np.zeros(len(members), dtype=bool)
        grown[owner[pairs[:, joined]]] = True
        moved = np.sort(owner[pairs], axis=0)
        kept = ~grown[moved].any(axis=0)
        touched = moved[:, ~kept & (moved[0] != moved[1])]
        fresh = _unlike_views(_distinct(touched, len(members)), _views_shown(members, views))
        pairs = np.concatenate([moved[:, kept], fresh], axis=1)
        table = np.concatenate([table[:, kept], sums(members, fresh)], axis=1)


def _mutual_best(pairs: IntArray, table: FloatArray, least_shared: float, count: int) -> BoolArray:
    """(e,) which pairs are the best of both their groups, of `count`."""
    affinity = table[0] / np.maximum(table[1], 1)
    affinity[table[0] < least_shared] = 0
    scattered = (pairs.astype(np.uint64) * SCATTER).sum(axis=0) & np.uint64(0xFFFFFFFF)
    rank: IntArray = np.empty(len(affinity), dtype=np.int64)
    rank[np.lexsort((scattered, -affinity))] = np.arange(len(affinity))
    best: IntArray = np.full(count, len(affinity), dtype=np.int64)
    for side in pairs:
        np.minimum.at(best, side, rank)
    return np.asarray((affinity > 0) & (rank == best[pairs[0]]) & (rank == best[pairs[1]]))


def _join(members: list[list[int]], pairs: IntArray) -> tuple[IntArray, list[list[int]]]:
    """The new number (k,) of every group and the new groups; no group is in two of the pairs (2, e)."""
    target: IntArray = np.arange(len(members))
    target[pairs[1]] = pairs[0]
    left, owner = np.unique(target, return_inverse=True)
    merged = [members[one] for one in left]
    for one, two in pairs.T:
        merged[owner[one]] = members[one] + members[two]
    return owner, merged


def _distinct(pairs: IntArray, count: int) -> IntArray:
    """The pairs (2, e) of `count` groups once each, the lower number first."""
    low, high = np.sort(pairs, axis=0).astype(np.int64)
    return np.array(np.divmod(np.unique(low * count + high), max(count, 1)), dtype=np.int64)


def _views_shown(members: Sequence[Sequence[int]], views: IntArray) -> NDArray[np.uint8]:
    """(k, b) the views of each group, eight to a byte."""
    shown: BoolArray = np.zeros((len(members), int(views.max(initial=0)) + 1), dtype=bool)
    owner = np.repeat(np.arange(len(members)), [len(group) for group in members])
    shown[owner, views[np.concatenate([np.asarray(group) for group in members])]] = True
    return np.packbits(shown, axis=1)


def _unlike_views(pairs: IntArray, shown: NDArray[np.uint8]) -> IntArray:
    """The pairs (2, e) of groups without a view in common."""
    starts = range(0, pairs.shape[1], BLOCK_PAIRS)
    blocks = [pairs[:, start : start + BLOCK_PAIRS] for start in starts]
    apart = [~(shown[one] & shown[two]).any(axis=1) for one, two in blocks]
    return pairs[:, np.concatenate([*apart, np.empty(0, dtype=bool)])]
