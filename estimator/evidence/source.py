"""What every kind of evidence is to the pipeline: something that looks at a scene and says scales.

The path of the camera over the time of its video, for evidence that has times.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from estimator.records.result import ScaleEvidence
from estimator.records.scene import Scene
from metric_base.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from estimator.records.objects import Measurements


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


@runtime_checkable
class EvidenceSource(Protocol):
    """A kind of evidence that the user asked for."""

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:
        """What it states about a scene, in metres per scene unit; one row with a reason where it cannot speak.

        Raises
        ------
        InputError
            A file that the user named cannot be read.
        """
        ...


def silent(kind: str, name: str, reason: str) -> tuple[ScaleEvidence, ...]:
    """The row of evidence that cannot speak."""
    return (ScaleEvidence(kind, name, None, None, reason=reason),)
