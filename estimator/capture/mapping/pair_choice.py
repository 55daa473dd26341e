"""Which pairs of frames to match: neighbours in time, and all pairs whose few strongest features already agree."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import IntArray

__all__ = ["EXHAUSTIVE", "chosen_pairs", "coarse_scores"]

#: So few frames are matched each with each.
EXHAUSTIVE = 30
#: Frames matched with each in a video whatever they show: the next ones, then ever further.
OFFSETS = (1, 2, 3, 4, 6, 9, 13, 18)
#: Up to so many frames every pair is compared by its strongest features; beyond, every second frame is.
COMPARED = 400
#: Strongest features that must agree before a pair is matched in full (of 128; unrelated pictures share 0 to 2).
LEAST_COMMON = 4
#: Partners that a frame gets beyond its neighbours, and how far apart they are in the order of the frames.
PARTNERS, APART = 6, 4
#: Lowe's ratio, on angles between descriptors.
RATIO = 0.8


def coarse_scores(descriptors: Sequence[NDArray[np.float32]]) -> IntArray:
    """(n, n) how many of the strongest features of two frames are each other's nearest, by the ratio test.

    descriptors : (k, 128) unit rows of each frame.
    """
    n = len(descriptors)
    scores = np.zeros((n, n), dtype=np.int64)
    step = 1 if n <= COMPARED else 2
    for first in range(0, n, step):
        for second in range(first + step, n, step):
            common = _common(descriptors[first], descriptors[second])
            scores[first, second] = scores[second, first] = common
    return scores


def chosen_pairs(scores: IntArray, in_order: bool) -> list[tuple[int, int]]:
    """Pairs (a, b), a < b, to match in full.

    in_order : the frames are of a video, so that neighbours overlap; pictures of a folder need not.
    """
    n = len(scores)
    if n <= EXHAUSTIVE:
        return [(a, b) for a in range(n) for b in range(a + 1, n)]
    pairs = {(a, a + step) for step in OFFSETS for a in range(n - step)} if in_order else set()
    for a in range(n):
        pairs |= {(min(a, b), max(a, b)) for b in _partners(a, scores[a], in_order)}
    return sorted(pairs)


def _partners(frame: int, row: IntArray, in_order: bool) -> list[int]:
    """Frames that agree best with this one, by its row of counts (n,), spread over the video."""
    near, apart, most = (OFFSETS[-1], APART, PARTNERS) if in_order else (0, 1, 3 * PARTNERS)
    partners: list[int] = []
    for other in np.argsort(-row, kind="stable"):
        if row[other] < LEAST_COMMON or len(partners) == most:
            break
        if abs(int(other) - frame) > near and all(abs(int(other) - taken) >= apart for taken in partners):
            partners.append(int(other))
    return partners


def _common(one: NDArray[np.float32], two: NDArray[np.float32]) -> int:
    """How many descriptors, unit vectors (n, 128) and (m, 128), are each other's nearest."""
    if len(one) < 2 or len(two) < 2:
        return 0
    cosines = one @ two.T
    best, back = cosines.argmax(axis=1), cosines.argmax(axis=0)
    rows = np.arange(len(one))
    first = cosines[rows, best]
    cosines[rows, best] = -1.0
    second = cosines.max(axis=1)
    angles = np.arccos(np.clip(first, -1, 1)), np.arccos(np.clip(second, -1, 1))
    return int(((back[best] == rows) & (angles[0] < RATIO * angles[1])).sum())
