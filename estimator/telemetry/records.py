"""Sensor data of one recording. Times are in seconds after the first frame of its video."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from metric_base.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Samples of a sensor with three axes."""

    #: (n,) increasing times in seconds.
    times_s: FloatArray
    #: (n, 3) values.
    values: FloatArray

    def __len__(self) -> int:
        return len(self.times_s)

    @classmethod
    def from_rows(cls, rows: FloatArray) -> Samples:
        """Create samples from rows (n, 4) of a time and three values; rows whose time does not increase are dropped."""
        rows = rows[np.diff(rows[:, 0], prepend=-np.inf) > 0]
        return cls(rows[:, 0], rows[:, 1:])


@dataclass(frozen=True, slots=True, eq=False)
class Positions:
    """Positions on the earth, or in a frame in metres."""

    #: (n,) increasing times in seconds.
    times_s: FloatArray
    #: (n, 3) latitude and longitude in degrees (WGS 84) and altitude in metres; x, y, z in metres if not geodetic.
    positions: FloatArray
    geodetic: bool
    #: Horizontal standard deviation of a position in metres, None if it is unknown.
    accuracy_m: float | None = None

    def __len__(self) -> int:
        return len(self.times_s)

    @classmethod
    def from_rows(cls, rows: FloatArray, geodetic: bool, accuracy_m: float | None = None) -> Positions | None:
        """Create positions from rows (n, 4) of a time and a position, as `Samples.from_rows`; None without rows."""
        samples = Samples.from_rows(rows)
        return cls(samples.times_s, samples.values, geodetic, accuracy_m) if len(samples) else None


def _no_samples() -> Samples:
    return Samples(np.empty(0), np.empty((0, 3)))


@dataclass(frozen=True, slots=True, eq=False)
class Telemetry:
    """Sensor data of one recording; missing data are empty or None."""

    #: m/s^2 along the axes of the sensor, including gravity.
    specific_force: Samples = field(default_factory=_no_samples)
    #: rad/s about the same axes.
    angular_rate: Samples = field(default_factory=_no_samples)
    #: Positions of a satellite receiver.
    positions: Positions | None = None
    #: Positions of the camera in metres, as ARKit and ARCore compute them.
    path: Positions | None = None

    @property
    def is_inertially_empty(self) -> bool:
        """True if there are neither accelerations nor a path."""
        return not len(self.specific_force) and self.path is None
