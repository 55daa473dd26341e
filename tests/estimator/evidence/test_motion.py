"""Evidence over the time of a video: an inertial unit, and positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimator.evidence import imu
from estimator.evidence.alignment import align
from estimator.evidence.gps import VideoGps, path_speed
from estimator.evidence.imu import Imu, Inertial, inertial_scale, remove_drift
from estimator.evidence.source import CameraPath
from estimator.records.objects import Measurements
from estimator.telemetry.records import Positions, Samples, Telemetry
from tests.synthetic.evidence import degrees_of, one
from tests.synthetic.telemetry import walk_readings
from tests.synthetic.walk import Walk

#: Metres per scene unit.
SCALE = 0.37
#: From the walk's frame to the scene's.
TURN = Rotation.from_euler("xyz", [0.3, -1.1, 2.0]).as_matrix()


def _path(times: np.ndarray, centres: np.ndarray, every: int = 8, noise_m: float = 0.001) -> CameraPath:
    """The camera's path in another frame and unit, with the noise of a reconstruction."""
    noisy = centres + np.random.default_rng(1).normal(0, noise_m, centres.shape)
    return CameraPath(times[::every], noisy[::every] @ TURN.T / SCALE + [3.0, -2.0, 7.0])


@pytest.mark.parametrize(("seconds", "mirrored"), [(9.0, True), (26.0, False)])
def test_the_swing_of_a_walk_gives_the_scale(seconds: float, mirrored: bool) -> None:
    times, centres, force, rate = walk_readings(seconds, 200.0, 0.02)
    if mirrored:  # a log whose axes are left-handed
        force = Samples(force.times_s, force.values * [1, 1, -1])
        rate = Samples(rate.times_s, rate.values * [1, 1, -1])
    late = 0.13
    found = inertial_scale(
        Samples(force.times_s + late, force.values), Samples(rate.times_s + late, rate.values), _path(times, centres)
    )
    assert isinstance(found, Inertial)
    assert found.scale == pytest.approx(SCALE, rel=0.02)
    assert abs(np.log(found.scale / SCALE)) < 2 * found.sd_log
    assert found.sd_log < 0.03
    assert found.offset_s == pytest.approx(late, abs=0.011)


def test_noise_of_the_cameras_path_is_no_swing() -> None:
    times, centres, force, rate = walk_readings(26.0, 200.0, 0.02)
    found = inertial_scale(force, rate, _path(times, centres, noise_m=0.003))
    assert isinstance(found, Inertial)
    assert found.scale == pytest.approx(SCALE, rel=0.012)


def test_readings_in_units_of_gravity() -> None:
    times, centres, force, rate = walk_readings(10.0, 100.0, 0.02)
    found = inertial_scale(Samples(force.times_s, force.values / 9.80665), rate, _path(times, centres, 4))
    assert isinstance(found, Inertial)
    assert found.scale == pytest.approx(SCALE, rel=0.02)


def test_why_a_unit_says_nothing() -> None:
    times, centres, force, rate = walk_readings(10.0, 100.0, 0.02)
    path = _path(times, centres, 4)
    smooth, flat, still_force, still_rate = walk_readings(10.0, 100.0, 0.0)
    other = centres + np.cumsum(np.random.default_rng(2).normal(0, 0.02, centres.shape), axis=0)
    nothing = Samples(np.empty(0), np.empty((0, 3)))
    reasons = {
        "hardly accelerates|do not agree": inertial_scale(still_force, still_rate, _path(smooth, flat, 4)),
        "do not agree": inertial_scale(force, rate, _path(times, other, 4)),
        "no accelerometer": inertial_scale(nothing, rate, path),
        "no gyroscope": inertial_scale(force, nothing, path),
        "shorter than 4 seconds": inertial_scale(force, rate, CameraPath(path.times_s[:50], path.centres[:50])),
        "at rest": inertial_scale(Samples(force.times_s, force.values * 0.6), rate, path),
        "readings a second": inertial_scale(Samples(times[::10], force.values[::10]), rate, path),
        "no stretch of four seconds": inertial_scale(Samples(force.times_s + 60, force.values), rate, path),
    }
    for words, reason in reasons.items():
        assert isinstance(reason, str), words
        assert any(part in reason for part in words.split("|")), (words, reason)


def test_a_logged_path_in_metres(walk: Walk, nothing: Measurements) -> None:
    times, centres, _, _ = walk_readings(10.0, 30.0, 0.02)
    log = Telemetry(path=Positions(times, centres, geodetic=False))
    row = one(Imu(log, _path(times, centres, 1), "metadata.json").observe(walk.scene, nothing))
    assert row.kind == "imu"
    assert row.scale == pytest.approx(SCALE, rel=0.01)


def test_positions_of_a_video(walk: Walk, nothing: Measurements) -> None:
    times, centres, _, _ = walk_readings(20.0, 30.0, 0.02)
    drift = np.cumsum(np.random.default_rng(3).normal(0, 0.01, centres.shape), axis=0)
    positions = Positions(times[::3], degrees_of((centres + drift)[::3]), geodetic=True, accuracy_m=4.0)
    nothing = replace(nothing, up=replace(nothing.up, vector=TURN[:, 2]))
    row = one(VideoGps(positions, _path(times, centres, 1), "clip.mp4").observe(walk.scene, nothing))
    assert row.kind == "gps_video"
    assert row.scale == pytest.approx(SCALE, rel=0.05)
    assert 0.015 < row.sd_log < 0.06  # the drift of a receiver, not the noise of many positions
    short = CameraPath(times[:60], _path(times, centres, 1).centres[:60])
    assert "too short" in str(one(VideoGps(positions, short, "clip.mp4").observe(walk.scene, nothing)).reason)


@pytest.mark.parametrize(("end_s", "assumption"), [(46.0, None), (44.0, "cover only 73% of the frames"), (90.0, None)])
def test_positions_of_few_frames_are_stated(
    walk: Walk, nothing: Measurements, end_s: float, assumption: str | None
) -> None:
    times = np.arange(0, 60, 0.1)
    curve = np.column_stack([times, np.sin(times), np.cos(times)])
    logged = np.arange(0, end_s, 0.1)
    metres = np.column_stack([np.interp(logged, times, column) for column in curve.T])
    source = VideoGps(Positions(logged, metres, geodetic=False), CameraPath(times, curve), "clip.csv")
    row = one(source.observe(walk.scene, nothing))
    assert row.scale == pytest.approx(1)
    _, _, partial = str(row.assumption).partition("taken as metres")
    assert partial == "" if assumption is None else assumption in partial


@pytest.mark.parametrize(("speed", "is_skipped"), [(1.4, False), (345.0, False), (355.0, True), (1400.0, True)])
def test_a_recording_is_not_faster_than_an_aeroplane(
    walk: Walk, nothing: Measurements, speed: float, is_skipped: bool
) -> None:
    times = np.arange(0, 60, 0.1)
    curve = np.column_stack([times, np.sin(times), np.cos(times)])
    metres = speed / path_speed(times, curve) * curve
    source = VideoGps(Positions(times, metres, geodetic=False), CameraPath(times, curve), "clip.csv")
    row = one(source.observe(walk.scene, nothing))
    assert (row.scale is None) == is_skipped
    assert not is_skipped or "faster than aeroplanes: wrong units or times?" in str(row.reason)
    assert row.assumption == (None if is_skipped else "taken as metres")


@pytest.mark.parametrize(
    ("factor", "every", "seconds", "words"),
    [
        (0.91, 1, 10.0, "at rest"),
        (0.925, 1, 10.0, None),
        (1.075, 1, 10.0, None),
        (1.085, 1, 10.0, "at rest"),
        (1.0, 3, 10.0, None),
        (1.0, 5, 10.0, "readings a second"),
        (1.0, 1, 3.9, "shorter than 4 seconds"),
        (1.0, 1, 4.1, None),
    ],
)
def test_readings_that_give_a_scale(factor: float, every: int, seconds: float, words: str | None) -> None:
    """9.0 to 10.6 m/s^2 at rest, 25 readings a second (33 and 20 here), a path of four seconds."""
    times, centres, force, rate = walk_readings(10.0, 100.0, 0.02)
    path = _path(times, centres, 4)
    keep = path.times_s - path.times_s[0] <= seconds
    force = Samples(force.times_s[::every], factor * force.values[::every])
    found = inertial_scale(force, rate, CameraPath(path.times_s[keep], path.centres[keep]))
    if words is None:
        assert not isinstance(found, str)
    else:
        assert isinstance(found, str)
        assert words in found


@pytest.mark.parametrize(("n_missing", "is_complete"), [(11, True), (12, False)])
def test_a_path_has_no_gap_of_half_a_second(n_missing: int, is_complete: bool) -> None:
    """25 frames a second; without 11 and 12 of them, two frames are 0.48 and 0.52 s apart."""
    times, centres, force, rate = walk_readings(10.0, 100.0, 0.02)
    path = _path(times, centres, 4)
    keep = np.ones(len(path.times_s), dtype=bool)
    keep[125 : 125 + n_missing] = False
    found = inertial_scale(force, rate, CameraPath(path.times_s[keep], path.centres[keep]))
    assert (not isinstance(found, str)) == is_complete


def test_a_logged_path_agrees_if_it_extends_over_three_residuals(walk: Walk, nothing: Measurements) -> None:
    times, centres, _, _ = walk_readings(10.0, 10.0, 0.02)
    path = _path(times, centres, 1)
    noise = np.random.default_rng(0).normal(0, 1, centres.shape)
    nearest = {True: np.inf, False: np.inf}
    for error in np.geomspace(0.6, 3.0, 16):
        logged = centres + error * noise
        alignment = align(path.centres, logged)
        row = one(Imu(Telemetry(path=Positions(times, logged, geodetic=False)), path, "a").observe(walk.scene, nothing))
        ratio = 0.0 if alignment is None else alignment.extent / alignment.residual
        agrees = row.scale is not None
        assert agrees == (ratio >= 3)
        nearest[agrees] = min(nearest[agrees], abs(ratio - 3))
    assert max(nearest.values()) < 0.5  # the series comes close to the threshold on both sides


@pytest.mark.parametrize(("gap_s", "words"), [(0.95, None), (1.05, "0 positions along the path, 4 needed")])
def test_positions_between_frames_less_than_a_second_apart_are_used(
    walk: Walk, nothing: Measurements, gap_s: float, words: str | None
) -> None:
    times = np.arange(0, 30, gap_s)
    centres = np.column_stack([times, np.sin(times), np.cos(times)])
    positions = Positions(times, 2 * centres, geodetic=False)
    row = one(VideoGps(positions, CameraPath(times, centres), "clip.csv").observe(walk.scene, nothing))
    assert row.reason == words
    assert words or row.scale == pytest.approx(2.0)


@pytest.mark.parametrize(("n", "is_used"), [(3, False), (4, True)])
def test_four_positions_of_a_video_give_a_scale(walk: Walk, nothing: Measurements, n: int, is_used: bool) -> None:
    times = np.linspace(0, 3, 31)
    centres = 10 * np.column_stack([times, np.sin(times), np.cos(times)])
    positions = Positions(times[:: 30 // n][:n], 2 * centres[:: 30 // n][:n], geodetic=False)
    row = one(VideoGps(positions, CameraPath(times, centres), "clip.csv").observe(walk.scene, nothing))
    assert (row.scale is not None) == is_used


@pytest.mark.parametrize(
    ("swing_m", "correlation", "words"),
    [
        (0.0042, 0.97, None),
        (0.0038, 0.97, "swings by 3.8 mm up and down, 4 mm needed"),
        (0.0042, 0.95, "correlate by 0.95, 0.96 needed"),
    ],
)
def test_a_walk_swings_and_agrees_with_its_path(
    swing_m: float, correlation: float, words: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    times, centres, force, rate = walk_readings(5.0, 100.0, 0.02)
    monkeypatch.setattr(imu, "fit_swings", lambda *_: (2.0, 0.03, correlation, swing_m))
    found = inertial_scale(force, rate, _path(times, centres, 4))
    if isinstance(found, str):
        assert words is not None
        assert words in found
    else:
        assert words is None
        assert (found.scale, found.sd_log) == (2.0, pytest.approx(np.hypot(0.03, 0.01)))


@pytest.mark.parametrize(("reading", "words"), [(1.9, "reads 18.6"), (2.1, "reads 2.1")])
def test_readings_below_two_are_multiples_of_gravity(reading: float, words: str) -> None:
    times, centres, force, rate = walk_readings(5.0, 100.0, 0.0)
    values = force.values * (reading / np.median(np.linalg.norm(force.values, axis=1)))
    assert words in str(inertial_scale(Samples(force.times_s, values), rate, _path(times, centres, 4)))


@pytest.mark.parametrize(("late_s", "is_found"), [(0.46, True), (0.56, False)])
def test_the_clocks_differ_by_half_a_second(late_s: float, is_found: bool) -> None:
    times, centres, force, rate = walk_readings(8.0, 100.0, 0.02)
    force, rate = Samples(force.times_s + late_s, force.values), Samples(rate.times_s + late_s, rate.values)
    path = _path(times, centres, 4)
    middle = (path.times_s > 1) & (path.times_s < 7)
    found = inertial_scale(force, rate, CameraPath(path.times_s[middle], path.centres[middle]))
    is_right = isinstance(found, Inertial) and abs(found.offset_s - late_s) < 0.02
    assert is_right == is_found


@pytest.mark.parametrize(
    ("seconds", "starts"),
    [(8.0, [0]), (10.0, [0]), (13.0, [0, 3]), (20.0, [0, 5, 10]), (31.0, [0, 5.25, 10.5, 15.75, 21])],
)
def test_windows_of_ten_seconds_overlap_by_half(
    seconds: float, starts: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    found: list[float] = []
    monkeypatch.setattr(imu, "time_window", lambda _force, _rate, _path, start: found.append(start))
    times = np.arange(0, seconds + 0.01, 0.02)
    readings = Samples(times, np.ones((len(times), 3)))
    assert "no stretch" in str(inertial_scale(readings, readings, CameraPath(times, np.zeros((len(times), 3)))))
    assert found == pytest.approx(starts, abs=0.03)


@pytest.mark.parametrize(("degree", "is_removed"), [(5, True), (6, False)])
def test_a_drift_has_a_degree_per_two_seconds(degree: int, is_removed: bool) -> None:
    times = np.linspace(0, 10, 101)
    path = np.outer((times / 10) ** degree, [1.0, 2.0, 3.0])
    assert bool(np.abs(remove_drift(times, path)).max() < 1e-9) == is_removed
    square = np.outer(times**2, [1.0, 2.0, 3.0])
    assert np.abs(remove_drift(times / 10, square)).max() < 1e-9  # the degree is 2 at least
