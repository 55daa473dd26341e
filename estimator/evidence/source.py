"""The protocol of evidence sources, and the path of a camera over time for evidence with times."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from estimator.records.objects import Measurements
from estimator.records.result import ScaleEvidence
from estimator.records.scene import Scene
from metric_base.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class CameraPath:
    """The path of the camera of a video."""

    times_s: FloatArray  #: (n,) increasing, 0 at the first frame of the video.
    centres: FloatArray  #: (n, 3) in scene units.

    def interpolate(self, times_s: FloatArray, max_gap_s: float) -> tuple[FloatArray, IntArray]:
        """Interpolate the camera centres at `times_s`, except in gaps of `max_gap_s` or more between frames.

        Return the centres (m, 3) and the indices (m,) of the times.
        """
        if len(self.times_s) < 2:
            return np.empty((0, 3)), np.empty(0, dtype=np.int64)
        after = np.searchsorted(self.times_s, times_s).clip(1, len(self.times_s) - 1)
        gap = self.times_s[after] - self.times_s[after - 1]
        rows = np.flatnonzero((times_s >= self.times_s[0]) & (times_s <= self.times_s[-1]) & (gap < max_gap_s))
        centres = np.column_stack([np.interp(times_s[rows], self.times_s, column) for column in self.centres.T])
        return centres, rows


@runtime_checkable
class EvidenceSource(Protocol):
    """A source of evidence that the user requests, such as `Gps`."""

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:
        """Return the evidence in a scene, in metres per scene unit.

        A source without a result returns one row with the reason (`skipped_evidence`).

        Raises
        ------
        InputError
            A file that the user named cannot be read.
        """
        ...


def skipped_evidence(kind: str, name: str, reason: str) -> tuple[ScaleEvidence, ...]:
    """Return the row of a source without a result."""
    return (ScaleEvidence(kind, name, None, None, reason=reason),)
