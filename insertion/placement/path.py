"""A way over a level surface, which an object follows at one speed with its front ahead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import InputError

#: Corners are rounded in the direction over this share of the way before and after, and no more than these metres.
ROUND_SHARE, ROUND_M = 0.1, 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """The way.

    corners : (k, 3) in the scene; along : (k,) way to each of them; speed : scene units a second; rounding : way over
    which a turn is spread, scene units.
    """

    corners: FloatArray
    along: FloatArray
    speed: float
    rounding: float

    @property
    def arrival_s(self) -> float:
        """When the end is reached."""
        return float(self.along[-1]) / self.speed

    def place(self, time_s: float) -> FloatArray:
        """(3,) place at a time; the object waits at the end."""
        return self._at(self.speed * time_s)

    def front(self, time_s: float) -> FloatArray:
        """(3,) unit direction of the way at a time."""
        at = float(np.clip(self.speed * time_s, 0.0, self.along[-1]))
        ahead = self._at(at + self.rounding) - self._at(at - self.rounding)
        return np.asarray(ahead / max(float(np.linalg.norm(ahead)), 1e-12))

    def _at(self, way: float) -> FloatArray:
        """(3,) place after a way, scene units."""
        return np.array([np.interp(way, self.along, self.corners[:, k]) for k in range(3)])


def walk_along(corners: FloatArray, metres_per_unit: float, speed_m_s: float | None, duration_s: float) -> Walk:
    """The way through corners (k, 3); without a speed (metres a second) it takes the whole of `duration_s`.

    Raises InputError where the corners are one place, or there is no time.
    """
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    if along[-1] <= 0:
        raise InputError("--path: expected points apart from the object's place; found only that place")
    if speed_m_s is None and duration_s <= 0:
        raise InputError("--path: expected more than one picture, or --speed; found one")
    speed = along[-1] / duration_s if speed_m_s is None else speed_m_s / metres_per_unit
    rounding = min(ROUND_SHARE * float(along[-1]), ROUND_M / metres_per_unit)
    return Walk(corners, along, float(speed), rounding)
