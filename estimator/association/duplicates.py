"""Two masks on one object in one picture: one of them stays, or none where nothing says which is right."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from estimator.records.scene import Instance
from metric_base.arrays import IntArray

__all__ = ["distinct_rows", "overlap"]

# Masks of one object by one detector share nine tenths of their union; an object and one before it under a half.
SAME_OBJECT_OVERLAP = 0.7


def distinct_rows(instances: Sequence[Instance]) -> IntArray:
    """Rows (k,) of the instances that are left when each object of a picture has one mask at most.

    Of two masks whose intersection is 0.7 of their union or more, the one with the better score stays; of equal scores
    the first, but neither where they name different categories.
    """
    by_view: dict[int, list[int]] = defaultdict(list)
    for row, instance in enumerate(instances):
        by_view[instance.view].append(row)
    dropped: set[int] = set()
    for rows in by_view.values():
        ranked = sorted(rows, key=lambda row: (-instances[row].score, row))
        for place, row in enumerate(ranked):
            for other in ranked[place + 1 :]:
                if not {row, other} & dropped and overlap(instances[row], instances[other]) >= SAME_OBJECT_OVERLAP:
                    dropped |= _worse(instances, row, other)
    return np.array([row for row in range(len(instances)) if row not in dropped], dtype=np.int64)


def overlap(one: Instance, two: Instance) -> float:
    """Intersection of two masks of one picture over their union, 0 for empty ones."""
    (height, width), (left, top) = one.mask.shape, one.origin
    (other_height, other_width), (other_left, other_top) = two.mask.shape, two.origin
    x0, x1 = max(left, other_left), min(left + width, other_left + other_width)
    y0, y1 = max(top, other_top), min(top + height, other_top + other_height)
    # the boxes bound what the masks can share
    if x1 <= x0 or y1 <= y0:
        return 0.0
    first = one.mask[y0 - top : y1 - top, x0 - left : x1 - left]
    second = two.mask[y0 - other_top : y1 - other_top, x0 - other_left : x1 - other_left]
    shared = int(np.count_nonzero(first & second))
    union = int(np.count_nonzero(one.mask)) + int(np.count_nonzero(two.mask)) - shared
    return shared / union if union else 0.0


def _worse(instances: Sequence[Instance], better: int, other: int) -> set[int]:
    """Which of two masks of one object go, `better` having the better score or an equal one."""
    alike = instances[better].category == instances[other].category
    scored_higher = instances[better].score > instances[other].score
    return {other} if alike or scored_higher else {better, other}
