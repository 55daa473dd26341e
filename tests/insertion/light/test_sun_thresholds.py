"""Thresholds of the sun in numbers on each side: halves of the casters, darkness, cells and pixels of the ground."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.records.objects import SupportPlane
from estimator.records.scene import Camera, View
from insertion.colour import linear_to_srgb
from insertion.light import sun
from insertion.scene.point_cloud import ColouredPoints
from metric_base.arrays import BoolArray, FloatArray

GROUND = SupportPlane(np.eye(3), 0.0, 0.01, 100, np.zeros(2), 1.0, np.ones((2, 2), dtype=bool))
N_AZIMUTHS = 36


def images(
    focal: float,
    light: Callable[[FloatArray], FloatArray] = lambda at: np.full(at.shape[:-1], 0.3),
    height: float = 1.0,
) -> Any:
    """One image of 640 by 480 pixels from above; `light` is the linear value at positions (..., 2) on the ground."""
    camera = Camera("PINHOLE", 640, 480, np.array([focal, focal, 320.0, 240.0]))
    down = np.diag([1.0, -1.0, -1.0])
    no_points = np.empty((0, 2)), np.empty(0, np.int64)
    view = View("0.png", camera, down, -down @ np.array([0, 0, height]), *no_points)
    x, y = np.meshgrid(np.arange(640) + 0.5, np.arange(480) + 0.5)
    at = np.stack([x - 320, 240 - y], axis=-1) / focal * height
    image = np.rint(linear_to_srgb(np.repeat(light(at)[..., None], 3, axis=-1).astype(np.float32))).astype(np.uint8)
    return SimpleNamespace(rows=(0,), image=lambda _: image, scene=SimpleNamespace(views=[view]))


def cloud(points: FloatArray) -> ColouredPoints:
    return ColouredPoints(points, np.full(points.shape, 0.3, np.float32), False)


def grid(half: tuple[float, float], step: float, right: float | None = None) -> FloatArray:
    """Points of the ground, up to x = `right`."""
    x, y = np.meshgrid(
        np.arange(-half[0], half[0] if right is None else right, step), np.arange(-half[1], half[1], step)
    )
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def ground_map(shown: Any, points: FloatArray, is_ground: BoolArray | None = None) -> Any:
    kept = np.ones(len(points), bool) if is_ground is None else is_ground
    return sun._ground_map(cloud(points), shown, GROUND, kept, 1.0)


# -------------------------------------------------------------------------------------------------- accepted directions
def found(
    monkeypatch: pytest.MonkeyPatch, first: int, second: int, scores: FloatArray, darkening: float = 1.0, n: int = 200
) -> tuple[FloatArray | None, list[FloatArray]]:
    """The sun if the halves of the casters have these best directions, and the casters of each call."""
    calls: list[FloatArray] = []

    def correlate(_: Any, casters: FloatArray, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        calls.append(casters)
        best = np.zeros(len(directions))
        best[(first, second, 0)[len(calls) - 1]] = 1.0
        return (best, best) if len(calls) < 3 else (scores, np.full(len(directions), darkening))

    monkeypatch.setattr(sun, "_ground_map", lambda *_: object())
    monkeypatch.setattr(sun, "_correlate_shadows", correlate)
    points = np.column_stack([np.linspace(-5, 5, n), np.zeros(n), np.full(n, 0.5)])
    return sun.sun_direction(cloud(points), images(100.0), GROUND), calls


def only(*entries: tuple[int, float]) -> FloatArray:
    """Scores of the directions, the azimuths of the lowest elevation first."""
    scores = np.zeros(6 * N_AZIMUTHS)
    for index, score in entries:
        scores[index] = score
    return scores


@pytest.mark.parametrize(("difference", "is_found"), [(30, True), (40, False)])
def test_both_halves_of_the_casters_have_an_azimuth_within_35_degrees(
    monkeypatch: pytest.MonkeyPatch, difference: int, is_found: bool
) -> None:
    direction, _ = found(monkeypatch, 4, 4 + difference // 10, only((4, 1.0)))
    assert (direction is not None) == is_found


def test_halves_of_the_casters_are_alternate_quarters(monkeypatch: pytest.MonkeyPatch) -> None:
    _, (first, second, every) = found(monkeypatch, 0, 0, only((0, 1.0)))
    ranks = np.round((first[:, 0] + 5) / 10 * 199).astype(int)
    assert sorted(ranks.tolist()) in ([*range(50, 100), *range(150, 200)], [*range(50), *range(100, 150)])
    assert (len(first), len(second), len(every)) == (100, 100, 200)


@pytest.mark.parametrize(("darkening", "is_found"), [(0.69, False), (0.71, True)])
def test_shadows_take_half_of_the_light(monkeypatch: pytest.MonkeyPatch, darkening: float, is_found: bool) -> None:
    assert (found(monkeypatch, 0, 0, only((0, 1.0)), darkening)[0] is not None) == is_found


def test_directions_with_80_percent_of_the_best_score_are_averaged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Azimuths 0 (weight 0.2), 10 (0.1) and 20 (nothing); an azimuth of 30 degrees is too far."""
    direction, _ = found(monkeypatch, 0, 0, only((0, 1.0), (1, 0.9), (2, 0.79), (3, 0.99)))
    assert direction is not None
    angle = np.radians(10.0)
    expected = np.array([0.2 + 0.1 * np.cos(angle), 0.1 * np.sin(angle)])
    assert np.arctan2(direction[1], direction[0]) == pytest.approx(np.arctan2(expected[1], expected[0]), abs=1e-6)


@pytest.mark.parametrize(("n", "is_found"), [(99, False), (100, True)])
def test_100_points_cast_shadows(monkeypatch: pytest.MonkeyPatch, n: int, is_found: bool) -> None:
    assert (found(monkeypatch, 0, 0, only((0, 1.0)), n=n)[0] is not None) == is_found


# ----------------------------------------------------------------------------------------------------- cells and pixels
def test_a_cell_of_the_ground_is_12_percent_of_the_camera_height_wide() -> None:
    made = ground_map(images(160.0), grid((2, 1.5), 0.1))
    assert made.cell == pytest.approx(0.12)
    assert made.known.shape == (34, 25)


def test_slow_changes_of_the_paint_are_removed_over_10_cells() -> None:
    """A dark disc of 10 cells keeps the factor exp(-1/2) of its darkness in its centre, if the ground is large."""
    made = ground_map(
        images(50.0, lambda at: np.where(np.hypot(*np.moveaxis(at, -1, 0)) < 1.2, 0.1, 0.3)), grid((6.4, 4.8), 0.2)
    )
    darkness = np.full(made.known.shape, np.nan)
    darkness[made.known] = made.darkness
    centre = tuple(((np.zeros(2) - made.corner) / made.cell).astype(int))
    around = darkness[centre[0] - 1 : centre[0] + 2, centre[1] - 1 : centre[1] + 2]
    assert np.nanmedian(around) == pytest.approx(np.log(3.0) * np.exp(-0.5), rel=0.08)


def test_black_ground_has_a_linear_value_of_0_4_percent() -> None:
    """The smoothing, which is subtracted, takes 0.36 of the logarithm of the ratio."""
    made = ground_map(images(160.0, lambda at: np.where(at[..., 0] < 0, 0.0, 0.4)), grid((2, 1.5), 0.1))
    assert np.ptp(made.darkness) == pytest.approx(np.log(0.4 / 0.004) - 0.36, abs=0.12)


def test_the_three_nearest_points_of_a_pixel_are_on_the_ground() -> None:
    """70 % of the points are on the ground; with two or four points, 96 or 66 % of the cells were known."""
    points = np.random.default_rng(0).uniform((-2, -1.5, 0), (2, 1.5, 0), (4000, 3))
    made = ground_map(images(160.0), points, np.random.default_rng(1).uniform(size=4000) < 0.7)
    assert made.known.mean() == pytest.approx(0.84, abs=0.06)


def test_ground_is_within_60_pixels_of_a_point() -> None:
    """The points end at x = 0, and the pixels of the ground 1.5 further; a cell has 4.8 pixels."""
    made = ground_map(images(40.0), grid((8, 6), 0.05, 0.0))
    assert made.known.shape[0] in (77, 78, 79)


def test_the_shadow_of_a_point_has_a_standard_deviation_of_1_cell() -> None:
    """A dark cell and its neighbour, half as dark, below one point, on 40 by 40 cells."""
    elevation, azimuth = (
        k.ravel() for k in np.radians(np.meshgrid(sun.ELEVATIONS_DEG, sun.AZIMUTHS_DEG, indexing="ij"))
    )
    directions = np.column_stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    darkness = np.zeros((40, 40))
    darkness[20, 20], darkness[21, 20] = 1.0, 0.5
    ground = sun._GroundMap(
        np.full(2, -2.0), 0.1, np.ones((40, 40), dtype=bool), darkness.ravel(), 0.3 * darkness.ravel()
    )
    caster = np.array([[0.05, 0.05, 0.0]]) + 0.8 * directions[40]
    scores, _ = sun._correlate_shadows(ground, caster, directions)
    assert scores.argmax() == 40
    assert scores.max() == pytest.approx(1.28, abs=0.1)  # 1.57 and 1.02 for standard deviations of 0.77 and 1.3
