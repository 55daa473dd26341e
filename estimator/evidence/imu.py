"""The scale from an inertial unit: how far its accelerations move it, against the path of the camera.

The gyroscope's rates w turn the specific force f of the unit into a frame that does not turn: a(t) = R(t) f(t) with
R' = R [w]. Twice integrated it is the unit's path, up to a polynomial: initial velocity (degree 1), gravity and bias
(2), and what drifts of the gyroscope add (3 and more). The camera's path in scene units is p(t). Both lose their
polynomials over windows of ten seconds; what is left, q(t) and p(t), is the swing of the walk. The rotation Q makes
sum |q(t + d) - s Q p(t)|^2 least (Umeyama 1991), for the offset d of the clocks that fits best. The scale s is that of
the components along gravity: a tilt of the estimated attitude by an angle e adds g e to the horizontal ones, and g e^2
to this one. It is sum q q / sum q p, the regression of the camera's path on the unit's: the camera's has millimetres of
noise, which the ratio of the two swings would take for swing, and the unit's has hardly any at the rate of steps.

The rotation of the camera is not used: videos are stabilised, and then it is not that of the unit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estimator.evidence.alignment import align
from estimator.evidence.source import CameraPath, silent
from estimator.records.result import ScaleEvidence
from estimator.records.scene import Scene
from estimator.telemetry.records import Positions, Samples, Telemetry
from metric_base.arrays import FloatArray

if TYPE_CHECKING:
    from estimator.records.objects import Measurements

KIND = "imu"
#: Seconds of a window, least of one, and seconds for each degree of its polynomial.
WINDOW_S, LEAST_WINDOW_S, SECONDS_PER_DEGREE = 10.0, 4.0, 2.0
#: Frames further apart than this leave a gap in the path.
LONGEST_GAP_S = 0.5
#: Offsets of the clocks in seconds that are tried.
MOST_OFFSET_S, OFFSET_STEP_S = 0.5, 0.01
#: Standard gravity in m/s^2, and the readings at rest that a unit in m/s^2 may have.
GRAVITY, LEAST_GRAVITY, MOST_GRAVITY = 9.80665, 9.0, 10.6
#: Samples a second that follow a walk.
LEAST_RATE_HZ = 25.0
#: Root mean square of the swing in metres below which a unit's noise is as large.
LEAST_SWING_M = 0.004
#: Correlation of the two paths: less is no agreement. `walk_carpark` has 0.996; offset and rotation are fitted, so two
#: unrelated walks of one step rate correlate, too.
LEAST_CORRELATION = 0.96
#: Parts of a window whose own scales say how far the whole one may be off.
PARTS = 4
#: Accelerometers of cameras and telephones are calibrated to about one per cent, natural log.
LEAST_SD = 0.01


@dataclass(frozen=True, slots=True)
class Inertial:
    """metres per scene unit, its standard deviation (natural log), correlation of the paths, offset of the clocks."""

    scale: float
    sd_log: float
    correlation: float
    offset_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Imu:
    """The telemetry of a video, and the path of its camera; name : of the file."""

    telemetry: Telemetry
    path: CameraPath
    name: str

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:  # noqa: ARG002
        """The scale of the swing or, of a log that has the camera's path in metres, of that path."""
        if self.telemetry.path is not None:
            return self._of_path(self.telemetry.path)
        answer = inertial_scale(self.telemetry.specific_force, self.telemetry.angular_rate, self.path)
        if isinstance(answer, str):
            return silent(KIND, self.name, answer)
        return (ScaleEvidence(KIND, self.name, answer.scale, answer.sd_log),)

    def _of_path(self, path: Positions) -> tuple[ScaleEvidence, ...]:
        centres, rows = self.path.at(path.times_s, LONGEST_GAP_S)
        alignment = align(centres, path.positions[rows]) if len(rows) > 3 else None
        if alignment is None or alignment.extent < 3 * alignment.residual:
            return silent(KIND, self.name, "the logged path and that of the camera do not agree")
        return (ScaleEvidence(KIND, self.name, alignment.scale, math.hypot(alignment.sd_log, LEAST_SD)),)


def inertial_scale(force: Samples, rate: Samples, path: CameraPath) -> Inertial | str:
    """The scale of a camera's path from specific force (m/s^2 or g) and angular rate (rad/s), or why there is none."""
    reason = _unusable(force, rate, path)
    if reason is not None:
        return reason
    values = force.values * (GRAVITY if np.median(np.linalg.norm(force.values, axis=1)) < 2 else 1.0)
    windows = [
        window for start in _starts(path) if (window := _window(Samples(force.times_s, values), rate, path, start))
    ]
    if not windows:
        return "no stretch of four seconds has both the camera's path and the unit's readings"
    gravity = float(np.median([window.gravity for window in windows]))
    if not LEAST_GRAVITY < gravity < MOST_GRAVITY:
        return f"the accelerometer reads {gravity:.1f} m/s^2 at rest, not {GRAVITY:.1f}"
    offsets = np.arange(-MOST_OFFSET_S, MOST_OFFSET_S + OFFSET_STEP_S / 2, OFFSET_STEP_S)
    up = [window.up for window in windows]
    fits = [_fit([window.swings(offset) for window in windows], up) for offset in offsets]
    best = int(np.argmax([fit.correlation for fit in fits]))
    fit = fits[best]
    if fit.swing_m < LEAST_SWING_M:
        words = f"{1000 * fit.swing_m:.1f} mm up and down, {1000 * LEAST_SWING_M:.0f} mm needed"
        return f"the camera hardly accelerates: it swings by {words}"
    if fit.correlation < LEAST_CORRELATION:
        words = f"correlate by {fit.correlation:.2f}, {LEAST_CORRELATION} needed"
        return f"the accelerations and the path of the camera do not agree: they {words}"
    return Inertial(fit.scale, math.hypot(fit.sd_log, LEAST_SD), fit.correlation, float(offsets[best]))


def _unusable(force: Samples, rate: Samples, path: CameraPath) -> str | None:
    if not len(force):
        return "no accelerometer readings"
    if not len(rate):
        return "no gyroscope readings"
    if len(path.times_s) < 2 or path.times_s[-1] - path.times_s[0] < LEAST_WINDOW_S:
        return f"the path of the camera is shorter than {LEAST_WINDOW_S:.0f} seconds"
    slowest = min(len(samples) / max(samples.times_s[-1] - samples.times_s[0], 1e-9) for samples in (force, rate))
    return None if slowest >= LEAST_RATE_HZ else f"{slowest:.0f} readings a second, {LEAST_RATE_HZ:.0f} needed"


def _starts(path: CameraPath) -> FloatArray:
    """(w,) starts of the windows in seconds, half a window apart."""
    first, last = path.times_s[[0, -1]]
    length = min(WINDOW_S, last - first)
    count = max(1, round((last - first - length) / (WINDOW_S / 2)) + 1)
    return np.linspace(first, last - length, count)


@dataclass(frozen=True, slots=True, eq=False)
class _TimeWindow:
    """A stretch of both paths.

    times_s, centres : (n,), (n, 3) of the camera; fine_s, moved : (m,), (m, 3) of the unit, in metres; gravity : m/s^2;
    up : (3,) in the axes of the unit's path.
    """

    times_s: FloatArray
    centres: FloatArray
    fine_s: FloatArray
    moved: FloatArray
    gravity: float
    up: FloatArray

    def swings(self, offset_s: float) -> tuple[FloatArray, FloatArray]:
        """The camera's and the unit's paths (n, 3) without their polynomials, where both are known."""
        there = self.times_s + offset_s
        known = (there >= self.fine_s[0]) & (there <= self.fine_s[-1])
        moved = np.column_stack([np.interp(there[known], self.fine_s, column) for column in self.moved.T])
        times = self.times_s[known]
        return _without_drift(times, self.centres[known]), _without_drift(times, moved)


def _window(force: Samples, rate: Samples, path: CameraPath, start: float) -> _TimeWindow | None:
    """The window that begins at a time, None where a path has a gap in it."""
    inside = (path.times_s >= start - 1e-6) & (path.times_s <= start + WINDOW_S + 1e-6)
    times = path.times_s[inside]
    if len(times) < 4 or times[-1] - times[0] < LEAST_WINDOW_S or np.diff(times).max() > LONGEST_GAP_S:
        return None
    near = (force.times_s > times[0] - MOST_OFFSET_S) & (force.times_s < times[-1] + MOST_OFFSET_S)
    fine = force.times_s[near]
    if len(fine) < 4 or fine[0] > times[0] + MOST_OFFSET_S or fine[-1] < times[-1] - MOST_OFFSET_S:
        return None
    if np.diff(fine).max() > LONGEST_GAP_S:
        return None
    rates = np.column_stack([np.interp(fine, rate.times_s, column) for column in rate.values.T])
    # axes may be left-handed in a log: with the wrong sense of turning, gravity turns with the unit
    turned = [_in_fixed_frame(fine, force.values[near], sense * rates) for sense in (1.0, -1.0)]
    still = max(turned, key=lambda row: float(np.linalg.norm(row.mean(axis=0))))
    gravity = float(np.linalg.norm(still.mean(axis=0)))
    moved = _twice_integrated(fine, still)
    return _TimeWindow(times, path.centres[inside], fine, moved, gravity, still.mean(axis=0) / max(gravity, 1e-9))


def _in_fixed_frame(times_s: FloatArray, force: FloatArray, rates: FloatArray) -> FloatArray:
    """(m, 3) specific force in the axes that the unit has at the first of the times (m,)."""
    from scipy.spatial.transform import Rotation

    steps = Rotation.from_rotvec(0.5 * (rates[1:] + rates[:-1]) * np.diff(times_s)[:, None]).as_matrix()
    attitude, turned = np.eye(3), np.empty_like(force)
    for k in range(len(force)):
        turned[k] = attitude @ force[k]
        if k < len(steps):
            attitude = attitude @ steps[k]
    return turned


def _twice_integrated(times_s: FloatArray, acceleration: FloatArray) -> FloatArray:
    """(m, 3) path of accelerations (m, 3), their mean left out, by the trapezoidal rule."""
    step = np.diff(times_s, prepend=times_s[0])[:, None]
    fluctuation = acceleration - acceleration.mean(axis=0)
    speed = np.cumsum(step * (fluctuation + np.roll(fluctuation, 1, axis=0)) / 2, axis=0)
    return np.asarray(np.cumsum(step * (speed + np.roll(speed, 1, axis=0)) / 2, axis=0))


def _without_drift(times_s: FloatArray, path: FloatArray) -> FloatArray:
    """A path (n, 3) less its polynomial of one degree for every two seconds, at least the second."""
    length = times_s[-1] - times_s[0]
    degree = max(2, round(length / SECONDS_PER_DEGREE))
    terms = np.polynomial.legendre.legvander(2 * (times_s - times_s[0]) / length - 1, degree)
    return np.asarray(path - terms @ np.linalg.lstsq(terms, path, rcond=None)[0])


@dataclass(frozen=True, slots=True)
class _Fit:
    """scale, sd_log, swing_m : along gravity; correlation, scale_of_all : of all components."""

    scale: float
    sd_log: float
    correlation: float
    swing_m: float
    scale_of_all: float


def _fit(swings: list[tuple[FloatArray, FloatArray]], up: list[FloatArray]) -> _Fit:
    """Scale, correlation and swing over the windows; up : (3,) of each window, in the axes of the unit's path.

    The deviation is that of a jackknife over the windows' parts, with half of what noise takes from the correlation and
    half of what the horizontal components contradict.
    """
    sums: list[FloatArray] = []  # per part: products, squares of camera and of unit, along gravity and of all
    for (camera, unit), vertical in zip(swings, up, strict=True):
        aligned = camera @ _rotation(camera, unit).T
        for rows in np.array_split(np.arange(len(camera)), PARTS):
            high, moved = aligned[rows] @ vertical, unit[rows] @ vertical
            along = [high @ moved, high @ high, moved @ moved]
            products = (aligned[rows] * unit[rows]).sum(), (aligned[rows] ** 2).sum(), (unit[rows] ** 2).sum()
            sums.append(np.array([*along, *products]))
    total = np.sum(sums, axis=0)
    rest = total - np.array(sums)
    swing = math.sqrt(float(total[2]) / sum(len(unit) for _, unit in swings))
    if min(total) <= 0 or rest.min() <= 0:
        return _Fit(1.0, math.inf, 0.0, swing, 1.0)
    spread = math.sqrt((len(sums) - 1) * float(np.log(rest[:, 2] / rest[:, 0]).var()))
    scale, of_all = float(total[2] / total[0]), float(total[5] / total[3])
    correlation = float(total[3] / math.sqrt(total[4] * total[5]))
    lost = 1 - float(total[0] / math.sqrt(total[1] * total[2]))
    sd_log = math.hypot(spread, 0.5 * lost, 0.5 * math.log(scale / of_all))
    return _Fit(scale, sd_log, correlation, swing, of_all)


def _rotation(camera: FloatArray, unit: FloatArray) -> FloatArray:
    """(3, 3) orthogonal matrix that turns one path (n, 3) onto the other, a reflection if that is nearer.

    Logs whose axes are left-handed, or that state the reaction to gravity with the other sign, mirror the path.
    """
    left, _, right = np.linalg.svd(unit.T @ camera)
    return np.asarray(left @ right)
