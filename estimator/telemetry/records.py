"""The telemetry of one recording, on the clock of its video: 0 is the first frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from metric_base.arrays import FloatArray


def _no_vectors() -> Samples:
    return Samples(np.empty(0), np.empty((0, 3)))


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """times_s : (n,), increasing; values : (n, 3)."""

    times_s: FloatArray
    values: FloatArray

    def __len__(self) -> int:
        return len(self.times_s)


@dataclass(frozen=True, slots=True, eq=False)
class Positions:
    """Positions on the earth or in metres.

    times_s : (n,); places : (n, 3), latitude and longitude in degrees (WGS 84) and altitude in metres, or x, y, z in
    metres where not geodetic; accuracy_m : of one position, horizontally, None where it is not stated.
    """

    times_s: FloatArray
    places: FloatArray
    geodetic: bool
    accuracy_m: float | None = None

    def __len__(self) -> int:
        return len(self.times_s)


@dataclass(frozen=True, slots=True, eq=False)
class Telemetry:
    """What one recording holds; a part that it lacks is empty or None.

    specific_force : m/s^2 in the axes of the unit, gravity included; angular_rate : rad/s in the same axes; positions :
    of a satellite receiver; path : of the camera in metres, as ARKit and ARCore compute it.
    """

    specific_force: Samples = field(default_factory=_no_vectors)
    angular_rate: Samples = field(default_factory=_no_vectors)
    positions: Positions | None = None
    path: Positions | None = None

    @property
    def is_inertially_empty(self) -> bool:
        """Whether it holds neither accelerations nor a path."""
        return not len(self.specific_force) and self.path is None
