"""Evidence by known answers: rays that meet, paths that stretch, drifts that go, maps and positions."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import orthogonal_procrustes
from scipy.spatial.transform import Rotation

from estimator.evidence import gps, imu
from estimator.evidence.alignment import align, least_squares, minimal_samples
from estimator.evidence.depth_maps import frame_sd, view_log_ratio
from estimator.evidence.markers import triangulate
from estimator.evidence.source import CameraPath
from estimator.records.scene import Camera, View
from metric_base.arrays import FloatArray
from tests.synthetic.telemetry import walk_readings

# Published values, written out so that a changed rule fails a test.
DRIFT_FRACTION = 0.1
END_TO_END = 0.41
FRAME_PRIOR_COUNT = 3
FRAME_SD = 0.1
METRES_PER_DILUTION = 2.5
TYPICAL_ACCURACY_M = 5.0

CAMERA = Camera("PINHOLE", 640, 480, np.array([500.0, 500, 320, 240]))


def _looking(eye: tuple[float, float, float]) -> View:
    """A camera that looks along +z from a place."""
    return View("a", CAMERA, np.eye(3), -np.array(eye), np.empty((0, 2)), np.empty(0, dtype=np.int64))


def _pixels(views: list[View], point: np.ndarray) -> np.ndarray:
    local = np.array([point + view.translation for view in views])
    return np.asarray(500 * local[:, :2] / local[:, 2:] + [320, 240])


def test_a_point_is_where_rays_meet_and_the_worst_is_left_out() -> None:
    views = [_looking((x, 0, 0)) for x in (0.0, 0.5, 1.0, 1.5)]
    point = np.array([0.4, -0.2, 3.0])
    pixels = _pixels(views, point)
    assert triangulate(views, pixels, 0.005) == pytest.approx(point)
    assert triangulate(views, _pixels(views, -point), 0.005) is None, "behind the cameras"
    wrong = pixels + np.array([[0, 0], [0, 60], [0, 0], [0, 0]])
    assert triangulate(views, wrong, 0.005) == pytest.approx(point)
    assert triangulate(views[:2], wrong[:2], 0.005) is None
    assert (
        triangulate([views[0], _looking((0.02, 0, 0))], _pixels([views[0], _looking((0.02, 0, 0))], point), 0.005)
        is None
    )


def test_a_path_is_known_between_near_frames() -> None:
    path = CameraPath(np.array([1.0, 1.4, 3.0, 3.2]), np.array([[0.0, 0, 0], [4, 0, 0], [5, 8, 0], [5, 9, 0]]))
    places, rows = path.interpolate(np.array([0.9, 1.0, 1.1, 2.0, 3.1, 3.2, 3.3]), 1.0)
    assert rows.tolist() == [1, 2, 4, 5]
    assert places == pytest.approx(np.array([[0.0, 0, 0], [1, 0, 0], [5, 8.5, 0], [5, 9, 0]]))
    assert len(CameraPath(np.array([1.0]), np.zeros((1, 3))).interpolate(np.array([1.0]), 1.0)[1]) == 0


def test_an_alignment_has_its_scale_error_and_extent() -> None:
    generator = np.random.default_rng(0)
    source = generator.normal(0, 1, (40, 3))
    turn = Rotation.from_euler("xyz", [0.3, 1.0, -2.0]).as_matrix()
    noise = generator.normal(0, 0.02, (40, 3))
    target = 2.5 * source @ turn.T + [3, -1, 2] + noise
    one = least_squares(source, target, np.ones(40, bool))
    assert one is not None
    assert one.scale == pytest.approx(2.5, rel=0.005)
    assert one.rotation == pytest.approx(turn, abs=0.01)
    assert one.residual == pytest.approx(0.02, rel=0.15)
    centred = target - target.mean(axis=0)
    assert one.extent == pytest.approx(np.sqrt((centred**2).sum() / 40))
    assert one.sd_log == pytest.approx(one.residual / (one.extent * np.sqrt(40)))
    target[:15] += generator.normal(0, 5, (15, 3))
    robust = align(source, target)
    assert robust is not None
    assert robust.scale == pytest.approx(2.5, rel=0.01)
    assert not robust.inliers[:15].any()
    assert robust.inliers[15:].mean() > 0.9
    assert align(source[:2], target[:2]) is None
    assert align(np.zeros((5, 3)), target[:5]) is None
    assert minimal_samples(3).tolist() == [[0, 1, 2]]
    assert all(len(set(row)) == 3 for row in minimal_samples(5).tolist())


def test_a_stretched_copy_is_seen() -> None:
    walk = np.random.default_rng(0).normal(0, 1, (60, 3)) * [5, 3, 0.01]
    same = least_squares(walk, 2 * walk, np.ones(60, bool))
    assert same is not None
    noisy = 2 * walk + np.random.default_rng(1).normal(0, 0.01, walk.shape)
    for factor, stretch in ((1.0, None), (1.05, None), (1.08, 1.08), (1.5, 1.5)):
        target = noisy * [factor, 1, 1]
        fit = least_squares(walk, target, np.ones(60, bool))
        assert fit is not None
        seen = gps.stretch_ratio(walk, target, fit.residual)
        assert seen == (None if stretch is None else pytest.approx(stretch, rel=0.01))
    line = walk * [1, 0.001, 1]
    assert gps.stretch_ratio(line, 2 * line * [1, 3, 1], 1.0) is None


def test_the_tilt_of_positions_is_as_sure_as_their_path_is_wide() -> None:
    walk = np.random.default_rng(0).normal(0, 1, (50, 3)) * [10, 10, 0]
    fit = least_squares(walk, walk, np.ones(50, bool))
    assert fit is not None
    sure = replace(fit, residual=0.5)
    own = walk - walk.mean(axis=0)
    information = (own**2).sum() * np.eye(3) - own.T @ own
    expected = np.degrees(np.sqrt(np.trace(np.linalg.inv(information)[:2, :2]) * 0.25))
    assert gps.tilt_sigma(walk, sure, None) == pytest.approx(expected)
    drift = 50 * np.hypot(0.5, DRIFT_FRACTION * 4.0) ** 2
    assert gps.tilt_sigma(walk, sure, 4.0) == pytest.approx(expected * np.sqrt(drift / 0.25))


def test_exif_says_degrees_and_how_good_they_are() -> None:
    tags: dict[int, Any] = {1: "S", 2: (48, 30, 36), 3: "W", 4: (11, 15, 0), 5: b"\x01", 6: 120.0}
    assert gps.exif_position(tags) == pytest.approx([-(48 + 0.5 + 0.01), -11.25, -120.0])
    assert gps.exif_position(tags | {1: "N", 3: "E", 5: 0}) == pytest.approx([48.51, 11.25, 120.0])
    assert gps.exif_position({2: (1, 2, 3)}) is None
    assert gps.exif_accuracy({}) == TYPICAL_ACCURACY_M
    assert gps.exif_accuracy({0x1F: 3.0, 0x0B: 9.0}) == 3.0
    assert gps.exif_accuracy({0x0B: 2.0}) == 2.0 * METRES_PER_DILUTION
    assert gps.exif_accuracy({0x1F: -1.0}) == TYPICAL_ACCURACY_M


def test_the_scales_of_pictures_are_shrunk_to_what_is_usual() -> None:
    ratios = np.array([0.1, 0.5, 0.3, 0.3, 0.2])
    own = 1.4826 * np.median(np.abs(ratios - 0.3))
    assert frame_sd(ratios) == pytest.approx(
        np.sqrt((4 * own**2 + FRAME_PRIOR_COUNT * FRAME_SD**2) / (4 + FRAME_PRIOR_COUNT)), rel=0.01
    )
    assert frame_sd(ratios[:1]) == pytest.approx(FRAME_SD)


def test_the_ratio_of_a_map_is_read_at_its_own_pixels() -> None:
    """A map of half the size, whose left half is in other metres than its right half."""
    generator = np.random.default_rng(0)
    points = np.column_stack([generator.uniform(-1, 1, (90, 2)), np.full(90, 2.0)])
    points = points[np.abs(points[:, 0]) > 0.05]
    view, scene = _looking((0, 0, 0)), SimpleNamespace(points=points)
    depth = np.full((240, 320), 3.0)
    depth[:, :160] = 5.0
    left = points[:, 0] < 0
    wanted = np.median(np.where(left, np.log(2.5), np.log(1.5))[np.abs(points[:, 1]) < 0.96])
    assert view_log_ratio(view, scene, depth) == pytest.approx(wanted)  # type: ignore[arg-type]
    own = replace(view, keypoints=np.zeros((25, 2)), point_index=np.flatnonzero(left)[:25])
    assert view_log_ratio(own, scene, depth) == pytest.approx(np.log(2.5))  # type: ignore[arg-type]
    inside = np.flatnonzero(left & (np.abs(points[:, 1]) < 0.9))
    for count, is_known in ((19, False), (20, True)):
        few = replace(view, keypoints=np.zeros((count, 2)), point_index=inside[:count])
        assert (view_log_ratio(few, scene, depth) is not None) == is_known  # type: ignore[arg-type]
    assert view_log_ratio(view, scene, np.where(depth > 4, np.nan, depth)) == pytest.approx(np.log(1.5))  # type: ignore[arg-type]


def test_a_force_in_axes_that_do_not_turn() -> None:
    times = np.linspace(0, 2, 401)
    rate = np.array([0.0, 0.0, 0.7])
    turn = Rotation.from_rotvec(times[:, None] * rate)
    fixed = np.array([1.0, 2.0, 9.8])
    seen = turn.inv().apply(np.tile(fixed, (401, 1)))
    assert imu.force_in_fixed_frame(times, seen, np.tile(rate, (401, 1))) == pytest.approx(
        np.tile(fixed, (401, 1)), abs=1e-9
    )


def test_a_swing_is_integrated_twice_and_drift_goes() -> None:
    times = np.linspace(0, 10, 2001)
    swing = np.column_stack([0.02 * np.sin(2 * np.pi * 1.5 * times), 0 * times, 0.01 * np.cos(2 * np.pi * 2 * times)])
    acceleration = -((2 * np.pi * np.array([1.5, 0, 2])) ** 2) * swing
    moved = imu.double_integral(times, acceleration + np.array([0.3, -0.1, 9.8]))
    left, true = imu.remove_drift(times, moved), imu.remove_drift(times, swing)
    assert np.abs(left - true).max() < 3e-4
    drift = np.polynomial.polynomial.polyval(times, [1, -2, 0.3, 0.1])[:, None] * [1, 2, 3]
    assert imu.remove_drift(times, swing + drift) == pytest.approx(true, abs=1e-9)
    short = times <= 3
    assert imu.remove_drift(times[short], drift[short] * 0 + times[short, None] ** 2) == pytest.approx(0, abs=1e-9)


def test_the_scale_of_swings_is_that_along_gravity() -> None:
    generator = np.random.default_rng(0)
    times = np.linspace(0, 10, 300)
    unit = np.column_stack([np.sin(3 * times), np.cos(2 * times), np.sin(5 * times + 1)])
    turn = Rotation.from_euler("xyz", [0.5, -1.0, 0.3]).as_matrix()
    up = np.array([0.0, 0.0, 1.0])
    camera = (unit / 0.4) @ turn
    scale, sd_log, correlation, swing_m = imu.fit_swings([(camera, unit)] * 2, [up, up])
    assert (scale, correlation) == pytest.approx((0.4, 1.0))
    assert sd_log == pytest.approx(0, abs=1e-6)
    assert swing_m == pytest.approx(np.sqrt((unit[:, 2] ** 2).mean()))
    tilted = unit + np.column_stack([0.3 * unit[:, 2], 0 * times, 0 * times])
    noisy = camera + generator.normal(0, 0.3, camera.shape)
    _, sd_log, correlation, _ = imu.fit_swings([(noisy, tilted)], [up])
    assert correlation < 0.99
    aligned = noisy @ orthogonal_procrustes(noisy, tilted)[0]
    lost = 1 - aligned[:, 2] @ tilted[:, 2] / np.sqrt((aligned[:, 2] ** 2).sum() * (tilted[:, 2] ** 2).sum())
    assert sd_log >= 0.5 * lost > 0
    _, sd_log, correlation, _ = imu.fit_swings([(0 * camera, unit)], [up])
    assert (correlation, sd_log) == (0.0, math.inf)


@pytest.mark.parametrize(("sd_log", "is_used"), [(0.18, True), (0.22, False)])
def test_positions_are_used_up_to_a_standard_deviation_of_a_fifth(sd_log: float, is_used: bool) -> None:
    """Exact copies of the path, of a receiver whose drift alone gives the scale this standard deviation."""
    walk = np.random.default_rng(0).normal(0, 1, (40, 3)) * [30, 20, 1]
    extent = math.sqrt(float(((walk - walk.mean(axis=0)) ** 2).sum() / len(walk)))
    accuracy_m = sd_log * extent / (END_TO_END * DRIFT_FRACTION)
    (row,) = gps.position_evidence("gps", "walk", walk, walk, accuracy_m, None)
    assert (row.scale is not None) == is_used
    if row.reason is not None:
        assert "too short for its positions" in row.reason


@pytest.mark.parametrize(("correlation", "agrees"), [(0.97, True), (0.95, False)])
def test_both_sides_of_the_correlation_of_unit_and_camera(
    monkeypatch: pytest.MonkeyPatch, correlation: float, agrees: bool
) -> None:
    times, centres, force, rate = walk_readings(10.0, 100.0, 0.02)
    monkeypatch.setattr(imu, "fit_swings", lambda *_: (1.0, 0.01, correlation, 0.05))
    found = imu.inertial_scale(force, rate, CameraPath(times[::4], centres[::4]))
    assert isinstance(found, str) != agrees
    if isinstance(found, str):
        assert "correlate by 0.95, 0.96 needed" in found


@pytest.mark.parametrize(("noise", "is_used"), [(0.45, True), (0.75, False)])
def test_a_path_is_at_least_three_times_as_long_as_the_errors_of_its_positions(noise: float, is_used: bool) -> None:
    """Independent errors of a path whose extent is 1.7 in all directions: ratios of about 4 and 2.4."""
    generator = np.random.default_rng(0)
    walk = generator.normal(0, 1, (400, 3))
    metres = walk + generator.normal(0, noise, (400, 3))
    found = align(walk, metres)
    assert found is not None
    assert (found.extent / found.residual > 3) == is_used
    assert 2 < found.extent / found.residual < 5
    (row,) = gps.position_evidence("gps", "table", walk, metres, None, None)
    assert (row.scale is not None) == is_used


@pytest.mark.parametrize(("swing_m", "is_used"), [(0.0035, False), (0.0045, True)])
def test_a_camera_swings_by_four_millimetres_or_more(
    monkeypatch: pytest.MonkeyPatch, swing_m: float, is_used: bool
) -> None:
    times, centres, force, rate = walk_readings(10.0, 100.0, 0.02)
    monkeypatch.setattr(imu, "fit_swings", lambda *_: (1.0, 0.01, 0.98, swing_m))
    found = imu.inertial_scale(force, rate, CameraPath(times[::4], centres[::4]))
    assert isinstance(found, str) != is_used


def test_inliers_of_an_alignment_are_within_three_median_residuals() -> None:
    """All pairs have a residual of 1, except one below the limit of 3 and one above."""
    generator = np.random.default_rng(0)
    source = generator.normal(0, 100, (400, 3))
    direction = generator.normal(0, 1, (400, 3))
    residual = np.ones((400, 1))
    residual[:2, 0] = 2.7, 3.3
    fit = align(source, source + residual * direction / np.linalg.norm(direction, axis=1, keepdims=True))
    assert fit is not None
    assert fit.inliers[:2].tolist() == [True, False]


def test_inliers_of_exact_pairs_are_within_a_millionth_of_the_extent() -> None:
    source = np.random.default_rng(0).uniform(0, 1, (40, 3))
    source[:2] = [0, 0, 0], [1, 1, 1]
    target = source.copy()
    target[2:4, 0] += [0.9e-6, 1.1e-6]
    fit = align(source, target)
    assert fit is not None
    assert fit.inliers[2:4].tolist() == [True, False]


def _reason(cameras: FloatArray, metres: FloatArray) -> str | None:
    (row,) = gps.position_evidence("gps", "walk", cameras, metres, None, None)
    return row.reason


def test_positions_at_one_place_or_that_contradict_the_cameras_give_no_scale() -> None:
    generator = np.random.default_rng(0)
    cameras = generator.normal(0, 10, (40, 3))
    assert _reason(cameras, 2 * cameras) is None
    assert _reason(cameras, np.zeros((40, 3))) == "the positions or the cameras are at one place"
    assert _reason(np.zeros((40, 3)), cameras) == "the positions or the cameras are at one place"


@pytest.mark.parametrize(("n_wrong", "is_used"), [(19, True), (21, False)])
def test_most_positions_agree_with_the_cameras(n_wrong: int, is_used: bool) -> None:
    """Of 40 exact positions; the others are far away, each elsewhere."""
    cameras = np.random.default_rng(0).normal(0, 10, (40, 3))
    metres = 2 * cameras
    metres[:n_wrong] += np.random.default_rng(1).normal(0, 300, (n_wrong, 3))
    assert (_reason(cameras, metres) is None) == is_used


def test_an_alignment_needs_three_pairs_that_are_not_mirrored_to_a_point() -> None:
    source = np.random.default_rng(0).normal(0, 1, (9, 3))
    assert least_squares(source, source, np.arange(9) < 3) is not None
    assert least_squares(source, source, np.arange(9) < 2) is None
    assert least_squares(source, np.zeros((9, 3)), np.ones(9, bool)) is None


def test_the_speed_of_a_path_shorter_than_a_second_is_unknown() -> None:
    times = np.arange(11) / 10
    metres = np.column_stack([3 * times, 0 * times, 0 * times])
    assert gps.path_speed(times, metres) == pytest.approx(3.0)
    assert gps.path_speed(times[:10], metres[:10]) == 0.0
    assert gps.path_speed(times[:0], metres[:0]) == 0.0


def test_a_speed_is_that_over_a_second() -> None:
    """Back and forth once in a second, and 2 metres a second along."""
    times = np.arange(61) / 20
    swing = np.sin(2 * np.pi * times)
    assert gps.path_speed(times, np.column_stack([2 * times, 5 * swing, 0 * times])) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("position", "is_projected"),
    [
        ([0.99e5, 0.0, 0.0], False),
        ([1.01e5, 0.0, 0.0], True),
        ([6_378_137.0 * 1.009, 0.0, 0.0], False),  # as far from the centre of the Earth as its surface, within 1 %
        ([6_378_137.0 * 1.011, 0.0, 0.0], True),
        ([6_378_137.0 * 0.991, 0.0, 0.0], False),
        ([6_378_137.0 * 0.989, 0.0, 0.0], True),
        ([0.0, 6_378_137.0 * 3.14, 0.0], True),
        ([0.0, 6_378_137.0 * 3.15, 0.0], False),  # beyond the poles of the projection
    ],
)
def test_large_coordinates_are_projected_unless_they_are_geocentric(position: list[float], is_projected: bool) -> None:
    assumption = gps.taken_as_metres([np.array(position)])
    assert ("Web Mercator" in assumption) == is_projected
