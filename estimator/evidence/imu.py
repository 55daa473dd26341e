"""Estimate the scale from an inertial unit: its path, integrated from accelerations, against the path of the camera.

The angular rates w rotate the specific force f of the unit into a fixed frame: a(t) = R(t) f(t) with R' = R [w]. Its
double integral is the path of the unit up to a polynomial: initial velocity (degree 1), gravity and bias (2), and the
drift of the gyroscope (3 and more). The path of the camera in scene units is p(t). A polynomial is removed from both in
windows of ten seconds; the remainders q(t) and p(t) are the swing of the walk. The rotation Q minimises
sum |q(t + d) - s Q p(t)|^2 (Umeyama 1991), with the clock offset d that fits best. The scale s is that of the
components along gravity, because an error e of the attitude adds g e to the horizontal components and g e^2 to this
one. It is sum q q / sum q p, the regression of the path of the camera on that of the unit: the path of the camera has
millimetres of noise, which would bias the ratio of the two swings, and that of the unit has almost none at the rate of
steps.

The rotation of the camera is not used: in stabilised videos, it is not that of the unit.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legfit, legval

from estimator.evidence.alignment import align
from estimator.evidence.source import CameraPath, skipped_evidence
from estimator.records.objects import Measurements
from estimator.records.result import ScaleEvidence
from estimator.records.scene import Scene
from estimator.telemetry.records import Samples, Telemetry
from metric_base.arrays import FloatArray

KIND = "imu"
#: Length of a window in seconds, and its minimum.
WINDOW_S = 10.0
MIN_WINDOW_S = 4.0
#: Seconds of a window per degree of its polynomial.
SECONDS_PER_DEGREE = 2.0
#: Maximum time in seconds between frames, and between readings, of a path without a gap.
MAX_GAP_S = 0.5
#: Maximum offset of the clocks in seconds, and the step of the search.
MAX_OFFSET_S = 0.5
OFFSET_STEP_S = 0.01
#: Standard gravity in m/s^2.
GRAVITY = 9.80665
#: Range of valid readings at rest in m/s^2.
MIN_GRAVITY = 9.0
MAX_GRAVITY = 10.6
#: Maximum median reading of a unit that states multiples of gravity instead of m/s^2.
MAX_READING_G = 2.0
#: Minimum number of readings per second to follow a walk.
MIN_RATE_HZ = 25.0
#: Minimum root mean square of the swing in metres; the noise of a unit is as large.
MIN_SWING_RMS_M = 0.004
#: Minimum correlation of the two paths. `walk_carpark` has 0.996; offset and rotation are fitted, so that two unrelated
#: walks with one step rate are correlated, too.
MIN_PATH_CORRELATION = 0.96
#: Number of parts of a window whose separate scales indicate the error of the total.
WINDOW_PARTS = 4
#: Standard deviation of the log scale of a calibrated accelerometer in cameras and phones.
MIN_LOG_SD = 0.01
#: Minimum extent of a logged path relative to the residual of its alignment with the camera path.
MIN_PATH_RESIDUALS = 3


@dataclass(frozen=True, slots=True)
class Inertial:
    """The scale of a path by an inertial unit."""

    scale: float  #: Metres per scene unit.
    sd_log: float  #: Standard deviation of its natural log.
    correlation: float  #: Of the paths of camera and unit.
    offset_s: float  #: Of the clocks, in seconds.


@dataclass(frozen=True, slots=True, eq=False)
class Imu:
    """The telemetry of a video, and the path of its camera."""

    telemetry: Telemetry
    path: CameraPath
    name: str  #: Name of the file.

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:  # noqa: ARG002
        """Return the scale by the swing or, if the log contains the camera path in metres, by this path."""
        logged = self.telemetry.path
        if logged is not None:
            centres, rows = self.path.interpolate(logged.times_s, MAX_GAP_S)
            alignment = align(centres, logged.positions[rows]) if len(rows) > 3 else None
            if alignment is None or alignment.extent < MIN_PATH_RESIDUALS * alignment.residual:
                return skipped_evidence(KIND, self.name, "the logged path and that of the camera do not agree")
            return (ScaleEvidence(KIND, self.name, alignment.scale, math.hypot(alignment.sd_log, MIN_LOG_SD)),)
        inertial = inertial_scale(self.telemetry.specific_force, self.telemetry.angular_rate, self.path)
        if isinstance(inertial, str):
            return skipped_evidence(KIND, self.name, inertial)
        return (ScaleEvidence(KIND, self.name, inertial.scale, inertial.sd_log),)


def inertial_scale(force: Samples, rate: Samples, path: CameraPath) -> Inertial | str:
    """Estimate the scale of a camera path from the readings of an inertial unit.

    Parameters
    ----------
    force : Samples
        Specific force in m/s^2 or in multiples of gravity.
    rate : Samples
        Angular rate in rad/s.
    path : CameraPath

    Returns
    -------
    Inertial or str
        The reason if the scale is undetermined.
    """
    reason = _missing_readings(force, rate, path)
    if reason is not None:
        return reason
    values = force.values * (GRAVITY if np.median(np.linalg.norm(force.values, axis=1)) < MAX_READING_G else 1.0)
    # Windows that overlap by half.
    first, last = path.times_s[[0, -1]]
    length = min(WINDOW_S, last - first)
    count = max(1, round((last - first - length) / (WINDOW_S / 2)) + 1)
    starts = np.linspace(first, last - length, count)
    windows = [window for start in starts if (window := time_window(Samples(force.times_s, values), rate, path, start))]
    if not windows:
        return "no stretch of four seconds has both the camera's path and the unit's readings"
    gravity = float(np.median([window.gravity for window in windows]))
    if not MIN_GRAVITY < gravity < MAX_GRAVITY:
        return f"the accelerometer reads {gravity:.1f} m/s^2 at rest, not {GRAVITY:.1f}"
    offsets = np.arange(-MAX_OFFSET_S, MAX_OFFSET_S + OFFSET_STEP_S / 2, OFFSET_STEP_S)
    up = [window.up for window in windows]
    fits = [fit_swings([window.swings(offset) for window in windows], up) for offset in offsets]
    best = int(np.argmax([correlation for _, _, correlation, _ in fits]))
    scale, sd_log, correlation, swing_m = fits[best]
    if swing_m < MIN_SWING_RMS_M:
        swing = f"{1000 * swing_m:.1f} mm up and down, {1000 * MIN_SWING_RMS_M:.0f} mm needed"
        return f"the camera hardly accelerates: it swings by {swing}"
    if correlation < MIN_PATH_CORRELATION:
        agreement = f"correlate by {correlation:.2f}, {MIN_PATH_CORRELATION} needed"
        return f"the accelerations and the path of the camera do not agree: they {agreement}"
    return Inertial(scale, math.hypot(sd_log, MIN_LOG_SD), correlation, float(offsets[best]))


def _missing_readings(force: Samples, rate: Samples, path: CameraPath) -> str | None:
    """Return the reason why the readings or the path are insufficient, or None."""
    if not len(force):
        return "no accelerometer readings"
    if not len(rate):
        return "no gyroscope readings"
    if len(path.times_s) < 2 or path.times_s[-1] - path.times_s[0] < MIN_WINDOW_S:
        return f"the path of the camera is shorter than {MIN_WINDOW_S:.0f} seconds"
    slowest = min(len(samples) / max(samples.times_s[-1] - samples.times_s[0], 1e-9) for samples in (force, rate))
    return None if slowest >= MIN_RATE_HZ else f"{slowest:.0f} readings a second, {MIN_RATE_HZ:.0f} needed"


@dataclass(frozen=True, slots=True, eq=False)
class TimeWindow:
    """The paths of camera and unit in a window."""

    times_s: FloatArray  #: (n,) of the camera.
    centres: FloatArray  #: (n, 3) of the camera, in scene units.
    unit_times_s: FloatArray  #: (m,)
    unit_path: FloatArray  #: (m, 3) in metres, up to a polynomial.
    gravity: float  #: In m/s^2.
    up: FloatArray  #: (3,) in the axes of `unit_path`.

    def swings(self, offset_s: float) -> tuple[FloatArray, FloatArray]:
        """Return the paths (n, 3) of camera and unit without their polynomials, at the times of both."""
        shifted = self.times_s + offset_s
        is_known = (shifted >= self.unit_times_s[0]) & (shifted <= self.unit_times_s[-1])
        unit = [np.interp(shifted[is_known], self.unit_times_s, column) for column in self.unit_path.T]
        times = self.times_s[is_known]
        return remove_drift(times, self.centres[is_known]), remove_drift(times, np.column_stack(unit))


def time_window(force: Samples, rate: Samples, path: CameraPath, start: float) -> TimeWindow | None:
    """Return the window that begins at `start`; None if one of the paths has a gap."""
    inside = (path.times_s >= start - 1e-6) & (path.times_s <= start + WINDOW_S + 1e-6)
    times = path.times_s[inside]
    if len(times) < 4 or times[-1] - times[0] < MIN_WINDOW_S or np.diff(times).max() > MAX_GAP_S:
        return None
    near = (force.times_s > times[0] - MAX_OFFSET_S) & (force.times_s < times[-1] + MAX_OFFSET_S)
    unit_times = force.times_s[near]
    if len(unit_times) < 4 or unit_times[0] > times[0] + MAX_OFFSET_S or unit_times[-1] < times[-1] - MAX_OFFSET_S:
        return None
    if np.diff(unit_times).max() > MAX_GAP_S:
        return None
    rates = np.column_stack([np.interp(unit_times, rate.times_s, column) for column in rate.values.T])
    # The axes of a log may be left-handed. With the wrong sign of the rates, gravity rotates with the unit.
    candidates = [force_in_fixed_frame(unit_times, force.values[near], sign * rates) for sign in (1.0, -1.0)]
    fixed = max(candidates, key=lambda values: float(np.linalg.norm(values.mean(axis=0))))
    gravity = float(np.linalg.norm(fixed.mean(axis=0)))
    unit_path, up = double_integral(unit_times, fixed), fixed.mean(axis=0) / max(gravity, 1e-9)
    return TimeWindow(times, path.centres[inside], unit_times, unit_path, gravity, up)


def force_in_fixed_frame(times_s: FloatArray, force: FloatArray, rates: FloatArray) -> FloatArray:
    """Rotate the specific force (m, 3) into the axes of the unit at the first of the times (m,), by rates (m, 3)."""
    from scipy.spatial.transform import Rotation

    steps = Rotation.from_rotvec(0.5 * (rates[1:] + rates[:-1]) * np.diff(times_s)[:, None]).as_matrix()
    attitudes = np.array([*itertools.accumulate(steps, np.matmul, initial=np.eye(3))])  # (m, 3, 3)
    return np.asarray(np.einsum("nij,nj->ni", attitudes, force))


def double_integral(times_s: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Return the path (m, 3) of accelerations (m, 3) without their mean, by the trapezoidal rule."""
    from scipy.integrate import cumulative_trapezoid

    speed = cumulative_trapezoid(acceleration - acceleration.mean(axis=0), times_s, axis=0, initial=0)
    return np.asarray(cumulative_trapezoid(speed, times_s, axis=0, initial=0))


def remove_drift(times_s: FloatArray, path: FloatArray) -> FloatArray:
    """Subtract from a path (n, 3) its polynomial with one degree per `SECONDS_PER_DEGREE`, of degree 2 at least."""
    length = times_s[-1] - times_s[0]
    degree = max(2, round(length / SECONDS_PER_DEGREE))
    x = 2 * (times_s - times_s[0]) / length - 1
    return np.asarray(path - legval(x, legfit(x, path, degree)).T)


def fit_swings(swings: list[tuple[FloatArray, FloatArray]], up: list[FloatArray]) -> tuple[float, float, float, float]:
    """Return scale, its log standard deviation, correlation, and root mean square swing in metres, of all windows.

    The standard deviation is a jackknife estimate over the parts of the windows, plus half of the loss of correlation
    by noise, and half of the log ratio to the scale of all components. `up` (3,) of each window is in the axes of the
    path of the unit.
    """
    from scipy.linalg import orthogonal_procrustes

    sums: list[FloatArray] = []  # of each part: products, squares of camera and unit, along gravity and in total
    for (camera, unit), vertical in zip(swings, up, strict=True):
        # Orthogonal matrix from the camera path to the unit path. It may be a reflection: logs with
        # left-handed axes, or with the other sign of the specific force, mirror the path.
        aligned = camera @ orthogonal_procrustes(camera, unit)[0]
        for rows in np.array_split(np.arange(len(camera)), WINDOW_PARTS):
            camera_up, unit_up = aligned[rows] @ vertical, unit[rows] @ vertical
            along = [camera_up @ unit_up, camera_up @ camera_up, unit_up @ unit_up]
            products = (aligned[rows] * unit[rows]).sum(), (aligned[rows] ** 2).sum(), (unit[rows] ** 2).sum()
            sums.append(np.array([*along, *products]))
    total = np.sum(sums, axis=0)
    without_part = total - np.array(sums)
    swing = math.sqrt(float(total[2]) / sum(len(unit) for _, unit in swings))
    if min(total) <= 0 or without_part.min() <= 0:
        return 1.0, math.inf, 0.0, swing
    jackknife_sd = math.sqrt((len(sums) - 1) * float(np.log(without_part[:, 2] / without_part[:, 0]).var()))
    scale, scale_of_all = float(total[2] / total[0]), float(total[5] / total[3])
    correlation = float(total[3] / math.sqrt(total[4] * total[5]))
    lost = 1 - float(total[0] / math.sqrt(total[1] * total[2]))
    sd_log = math.hypot(jackknife_sd, 0.5 * lost, 0.5 * math.log(scale / scale_of_all))
    return scale, sd_log, correlation, swing
