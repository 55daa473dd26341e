"""Choose the pairs of frames to match: all of a few frames; of many, neighbours in order and candidates for a loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import IntArray

#: Number of frames 1, 2, 4, 8, ... later with which each of many frames is matched: COLMAP's sequential matching with
#: quadratic overlap.
N_NEIGHBOURS = 10
#: Maximum number of frames of which every pair is compared by its strongest features; of more, every second frame is.
MAX_COMPARED = 400
#: Minimum number of the 128 strongest features that agree in a candidate for a loop; unrelated images share 0 to 2.
MIN_COMMON = 4
#: Maximum number of loops of a frame of a video, and their minimum distance in the order of the frames.
MAX_LOOPS, MIN_LOOP_DISTANCE = 6, 4
#: Maximum number of candidates of an image of a folder, which need not be in order.
MAX_UNORDERED = 18
#: Maximum ratio of the angles to the nearest and the second nearest descriptor (Lowe).
MAX_RATIO = 0.8


def all_pairs(n: int) -> list[tuple[int, int]]:
    """Return the pairs (a, b), a < b, of n frames."""
    return [(a, b) for a in range(n) for b in range(a + 1, n)]


def coarse_scores(descriptors: Sequence[NDArray[np.float32]]) -> IntArray:
    """Return the number (n, n) of the strongest features of two frames that match each other by the ratio test.

    Parameters
    ----------
    descriptors : sequence of (k, 128) ndarray of float32
        Unit rows of each frame.
    """
    n = len(descriptors)
    scores = np.zeros((n, n), dtype=np.int64)
    step = 1 if n <= MAX_COMPARED else 2
    for first in range(0, n, step):
        for second in range(first + step, n, step):
            if len(descriptors[first]) < 2 or len(descriptors[second]) < 2:
                continue
            cosines = descriptors[first] @ descriptors[second].T
            best, back = cosines.argmax(axis=1), cosines.argmax(axis=0)
            rows = np.arange(len(cosines))
            nearest = cosines[rows, best]
            cosines[rows, best] = -1.0
            angles = np.arccos(np.clip([nearest, cosines.max(axis=1)], -1, 1))
            is_match = (back[best] == rows) & (angles[0] < MAX_RATIO * angles[1])
            scores[first, second] = scores[second, first] = is_match.sum()
    return scores


def chosen_pairs(scores: IntArray, in_order: bool) -> list[tuple[int, int]]:
    """Return the pairs (a, b), a < b, of many frames to match: neighbours, and candidates for a loop.

    Parameters
    ----------
    scores : (n, n) ndarray of int
        Result of `coarse_scores`.
    in_order : bool
        Whether the frames are from a video.
    """
    n = len(scores)
    pairs = {(a, a + (1 << k)) for k in range(N_NEIGHBOURS) for a in range(n - (1 << k))}
    near, apart, most = (N_NEIGHBOURS, MIN_LOOP_DISTANCE, MAX_LOOPS) if in_order else (0, 1, MAX_UNORDERED)
    for frame, row in enumerate(scores):
        loops: list[int] = []
        for other in np.argsort(-row, kind="stable").tolist():
            if row[other] < MIN_COMMON or len(loops) == most:
                break
            if abs(other - frame) > near and all(abs(other - loop) >= apart for loop in loops):
                loops.append(other)
        pairs |= {(min(frame, other), max(frame, other)) for other in loops}
    return sorted(pairs)
