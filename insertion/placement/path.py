"""Motion of an object along a path over a level surface, with constant speed and the front ahead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import InputError

#: Length over which the direction turns before and after a corner, as a fraction of the path.
ROUNDING_FRACTION = 0.1
#: Maximum of this length, in metres.
MAX_ROUNDING_M = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class PathMotion:
    """Motion along a path. The object stands at its beginning before the start and at its end after the arrival."""

    corners: FloatArray  #: (k, 3) in the scene
    lengths: FloatArray  #: (k,) length of the path up to each corner, scene units
    speed: float  #: scene units per second
    rounding: float  #: length over which the direction turns at a corner, scene units
    start_s: float = 0.0  #: time of the start, in seconds

    @property
    def arrival_s(self) -> float:
        """Time of the arrival at the end, in seconds."""
        return self.start_s + float(self.lengths[-1]) / self.speed

    def position(self, time_s: float) -> FloatArray:
        """Return the position (3,) at a time."""
        return self._position_after(self.speed * (time_s - self.start_s))

    def front(self, time_s: float) -> FloatArray:
        """Return the unit direction (3,) of the path at a time."""
        length = float(np.clip(self.speed * (time_s - self.start_s), 0.0, self.lengths[-1]))
        ahead = self._position_after(length + self.rounding) - self._position_after(length - self.rounding)
        return np.asarray(ahead / max(float(np.linalg.norm(ahead)), 1e-12))

    def _position_after(self, length: float) -> FloatArray:
        """Return the position (3,) after a length of the path, in scene units."""
        return np.array([np.interp(length, self.lengths, self.corners[:, k]) for k in range(3)])


def path_motion(
    corners: FloatArray, metres_per_unit: float, speed_m_s: float | None, duration_s: float, start_s: float = 0.0
) -> PathMotion:
    """Return the motion along a path.

    Parameters
    ----------
    corners : (k, 3) ndarray of float
        Corners in the scene.
    speed_m_s : float or None
        Metres per second; None for a motion that takes the time from `start_s` to `duration_s`.
    duration_s : float
        Duration of the footage.
    start_s : float
        Time of the start, from the first frame.

    Raises
    ------
    InputError
        The path has no length, or there is neither a speed nor time left after the start.
    """
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    if lengths[-1] <= 0:
        raise InputError("--path: expected points other than the position of the object; found only that position")
    if speed_m_s is None and duration_s <= 0:
        raise InputError("--path: expected several frames, or --speed; found one frame")
    if 0 < duration_s <= start_s:
        raise InputError(f"--path-start: expected less than the {duration_s:g} s of the footage; found {start_s:g}")
    speed = lengths[-1] / (duration_s - start_s) if speed_m_s is None else speed_m_s / metres_per_unit
    rounding = min(ROUNDING_FRACTION * float(lengths[-1]), MAX_ROUNDING_M / metres_per_unit)
    return PathMotion(corners, lengths, float(speed), rounding, start_s)
