"""Which pairs of frames to match: all of a few frames; of many, neighbours in order and candidates for a loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import IntArray

#: Of many frames, each is matched with so many of those that are 1, 2, 4, 8, ... after it: COLMAP's sequential matching
#: with quadratic overlap.
OVERLAP = 10
#: Up to so many frames every pair is compared by its strongest features; beyond, every second frame is.
COMPARED = 400
#: Strongest features that must agree before a loop is tried (of 128; unrelated pictures share 0 to 2).
LEAST_COMMON = 4
#: Loops that are tried for a frame, and how far apart they are in the order of the frames.
LOOPS, APART = 6, 4
#: Pictures of a folder need not be in order: so many candidates, next to each other or not.
UNORDERED_LOOPS = 18
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


def all_pairs(n: int) -> list[tuple[int, int]]:
    """Pairs (a, b), a < b, of n frames."""
    return [(a, b) for a in range(n) for b in range(a + 1, n)]


def _neighbour_pairs(n: int) -> set[tuple[int, int]]:
    """Pairs (a, b), a < b, of n frames in their order."""
    return {(a, a + (1 << k)) for k in range(OVERLAP) for a in range(n - (1 << k))}


def chosen_pairs(scores: IntArray, in_order: bool) -> list[tuple[int, int]]:
    """Pairs (a, b), a < b, of many frames to match in full: neighbours, and loops.

    scores : (n, n) of `coarse_scores`; in_order : the frames are of a video. Pictures of a folder need not be in order.
    """
    pairs = _neighbour_pairs(len(scores))
    for a in range(len(scores)):
        pairs |= {(min(a, b), max(a, b)) for b in _loops(a, scores[a], in_order)}
    return sorted(pairs)


def _loops(frame: int, row: IntArray, in_order: bool) -> list[int]:
    """Frames beyond the neighbours that agree best with this one, by its row of counts (n,), spread over the video."""
    near, apart, most = (OVERLAP, APART, LOOPS) if in_order else (0, 1, UNORDERED_LOOPS)
    loops: list[int] = []
    for other in np.argsort(-row, kind="stable"):
        if row[other] < LEAST_COMMON or len(loops) == most:
            break
        if abs(int(other) - frame) > near and all(abs(int(other) - taken) >= apart for taken in loops):
            loops.append(int(other))
    return loops


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
