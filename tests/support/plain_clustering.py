"""Agglomerative clustering as the rule is written: the best pair is searched among all pairs after every merge."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from metric_base.arrays import FloatArray, IntArray


def plainly_merged(
    groups: Sequence[Sequence[int]], views: IntArray, over: FloatArray, under: FloatArray, share: float
) -> list[list[int]]:
    """Return the groups, sorted, after merging the pair with the largest quotient of sums of the tables (m, m)."""
    merged = [list(group) for group in groups]
    while True:
        best, pair = 0.0, (0, 0)
        for one, first in enumerate(merged):
            for two in range(one + 1, len(merged)):
                pairs = np.ix_(first, merged[two])
                free = not {views[row] for row in first} & {views[row] for row in merged[two]}
                shared = over[pairs].sum()
                affinity = shared / max(under[pairs].sum(), 1) if free and shared >= 3 else 0.0
                if affinity > best:
                    best, pair = affinity, (one, two)
        if best < share:
            return sorted(sorted(group) for group in merged)
        merged[pair[0]] += merged.pop(pair[1])
