"""The path of the camera over the time of its video, for evidence that has times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from metric_base.arrays import FloatArray, IntArray

__all__ = ["CameraPath"]


@dataclass(frozen=True, slots=True, eq=False)
class CameraPath:
    """times_s : (n,), increasing, 0 at the first frame of the video; centres : (n, 3) in scene units."""

    times_s: FloatArray
    centres: FloatArray

    def at(self, times_s: FloatArray, longest_gap_s: float) -> tuple[FloatArray, IntArray]:
        """Centres (m, 3) at those of the times that lie between frames less than so far apart, and the times' rows."""
        if len(self.times_s) < 2:
            return np.empty((0, 3)), np.empty(0, dtype=np.int64)
        after = np.searchsorted(self.times_s, times_s).clip(1, len(self.times_s) - 1)
        gap = self.times_s[after] - self.times_s[after - 1]
        inside = (times_s >= self.times_s[0]) & (times_s <= self.times_s[-1]) & (gap < longest_gap_s)
        rows = np.flatnonzero(inside)
        places = np.column_stack([np.interp(times_s[rows], self.times_s, column) for column in self.centres.T])
        return places, rows
