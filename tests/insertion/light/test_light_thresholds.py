"""Thresholds of the light, in numbers on each side: sky, clipped pixels, white surfaces, positions without a lamp."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from estimator.records.scene import Camera, Scene, View
from insertion.colour import srgb_to_linear
from insertion.footage.footage import SceneImages
from insertion.light.direction_samples import sky_pixels
from insertion.light.environment_estimate import (
    OutdoorLight,
    environment_at,
    is_outdoors,
    raise_ceiling,
    sky_light,
)
from insertion.light.environment_map import HEIGHT, WIDTH, map_directions, solid_angles
from insertion.light.lamp_candidates import is_visibly_free
from insertion.scene.occupancy import occupancy_of
from insertion.scene.point_cloud import ColouredPoints
from metric_base.arrays import FloatArray

UP = np.array([0.0, 0.0, 1.0])
#: Rows of a camera that looks along y, and of one that looks down.
ALONG_Y = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
DOWN = np.diag([1.0, -1.0, -1.0])


class Still(SceneImages):
    """One image of 640 by 480 pixels of a camera with a focal length of 500 pixels."""

    def __init__(self, pixels: NDArray[np.uint8], rotation: FloatArray, centre: tuple[float, float, float]) -> None:
        camera = Camera("PINHOLE", 640, 480, np.array([500.0, 500, 320, 240]))
        empty = (np.empty((0, 2)), np.empty(0, dtype=np.int64))
        view = View("still", camera, rotation, -rotation @ np.array(centre), *empty)
        self.scene = Scene(Path("memory"), "colmap", (view,), np.empty((0, 3)))
        self.rows, self._pixels = (0,), pixels

    def image(self, row: int) -> NDArray[np.uint8]:
        assert row == 0
        return self._pixels


def cloud(points: FloatArray) -> ColouredPoints:
    return ColouredPoints(points, np.ones((len(points), 3), np.float32), False)


def floor(height: float = 0.0) -> ColouredPoints:
    flat = np.random.default_rng(0).uniform((-3, -3), (3, 3), (3000, 2))
    return cloud(np.column_stack([flat, np.full(len(flat), height)]))


@pytest.mark.parametrize(
    ("colour", "is_sky"),
    [
        ((0.52, 0.5, 0.5), True),
        ((0.53, 0.5, 0.5), False),  # red over blue is 1.06
        ((0.151, 0.151, 0.151), True),
        ((0.149, 0.149, 0.149), False),
        ((0.91, 0.5, 0.1), True),
        ((0.89, 0.5, 0.1), False),
    ],
)
def test_sky_is_blue_and_bright_or_clipped(colour: tuple[float, float, float], is_sky: bool) -> None:
    assert bool(sky_pixels(np.array(colour, np.float32), np.array(0.3), np.array(50.0))) == is_sky


@pytest.mark.parametrize(("n_rows", "is_outside"), [(22, True), (21, False)])
def test_five_percent_of_sky_make_a_scene_outdoors(n_rows: int, is_outside: bool) -> None:
    """Every sixth row is sampled from the fourth one: 22 rows contain 4 of the 80 sampled ones."""
    pixels = np.full((480, 640, 3), (200, 120, 60), np.uint8)
    pixels[:n_rows] = (100, 150, 250)
    points = np.column_stack([np.linspace(-1, 1, 50), np.full(50, 4.0), np.full(50, -1.0)])
    assert is_outdoors(cloud(points), Still(pixels, ALONG_Y, (0, 0, 0)), UP) == is_outside


def test_unseen_directions_within_4_cells_of_an_object_are_no_sky() -> None:
    coverage, sky = np.zeros((HEIGHT, WIDTH)), np.zeros((HEIGHT, WIDTH))
    coverage[20:30, 50:60] = 1.0  # an object in front of the sky
    coverage[5:25, 100:110] = sky[5:25, 100:110] = 1.0
    radiance = np.full((HEIGHT, WIDTH, 3), 0.4) * coverage[..., None]
    known = sky_light(radiance, coverage, sky, 0.1, None)[1]
    assert known[25, [62, 63, 64, 65]].tolist() == [0, 0, 1, 1]
    assert known[25, [47, 46, 45, 44]].tolist() == [0, 0, 1, 1]


def test_the_sky_is_smoothed_over_6_rows_of_elevation() -> None:
    """Half of the sky is seen, with twice the radiance in its lower half; the ground is black."""
    seen = np.zeros((HEIGHT, WIDTH))
    seen[: HEIGHT // 2, : WIDTH // 2] = 1.0
    level = np.where(np.arange(HEIGHT) < HEIGHT // 4, 1.0, 2.0) * (np.arange(HEIGHT) < HEIGHT // 2)
    complete = sky_light(np.ones(3) * (level[:, None] * seen)[..., None], seen, seen, 0.0, None)[0]
    rows = (np.arange(HEIGHT) < HEIGHT // 2).astype(float)
    middle = slice(4, HEIGHT // 2 - 4)
    sums, counts = (gaussian_filter1d(values, 6.0, mode="constant")[middle] for values in (level, rows))
    np.testing.assert_allclose(complete[middle, WIDTH * 3 // 4, 1], sums / counts, rtol=1e-6)


def test_a_white_surface_has_an_albedo_of_65_percent() -> None:
    filled, seen = np.full((HEIGHT, WIDTH, 3), 0.1), np.zeros((HEIGHT, WIDTH))
    seen[HEIGHT // 2 :] = 1.0
    raised = raise_ceiling(filled, seen, 0.12, UP)
    weight = np.maximum(map_directions()[..., 2], 0) * solid_angles()[:, None]
    assert (weight * raised[..., 1]).sum() == pytest.approx(np.pi * 0.12 / 0.65, rel=1e-3)


@pytest.mark.parametrize(("n_rows", "level"), [(2, 100), (3, 140)])
def test_white_is_the_brightest_surface_without_3_percent_of_highlights(n_rows: int, level: int) -> None:
    """Of 80 sampled rows, 2 or 3 are bright; the floor is below the object, and no light from above is seen."""
    pixels = np.full((480, 640, 3), 100, np.uint8)
    pixels[: 6 * n_rows] = 140
    still = Still(pixels, DOWN, (0, 0, 3))
    environment = environment_at(np.array([0, 0, 1.0]), 0.2, np.eye(3), floor(), still)
    white = float(srgb_to_linear(np.array([level], np.uint8))[0])
    assert environment.irradiance(UP) == pytest.approx(np.full(3, np.pi * white / 0.65), rel=0.02)


@pytest.mark.parametrize(("level", "gain"), [(250, 1.0), (251, 6.0)])
def test_clipped_directions_are_6_times_as_bright(level: int, gain: float) -> None:
    """The linear value of level 250 is 0.956, that of 251 is 0.965."""
    still = Still(np.full((480, 640, 3), level, np.uint8), DOWN, (0, 0, 3))
    environment = environment_at(np.array([0, 0, 1.0]), 0.2, np.eye(3), floor(), still)
    linear = float(srgb_to_linear(np.array([level], np.uint8))[0])
    assert environment.irradiance(-UP) == pytest.approx(np.full(3, gain * np.pi * linear), rel=0.02)


def test_the_sun_has_half_a_degree_and_is_far() -> None:
    pixels = np.full((480, 640, 3), (200, 190, 180), np.uint8)
    pixels[:200] = (100, 130, 200)
    sun = np.array([0.0, 0.6, 0.8])
    still = Still(pixels, ALONG_Y, (0, -2, 1.5))
    outdoors = OutdoorLight(sun, occupancy_of(floor()))
    light = environment_at(np.zeros(3), 0.5, np.eye(3), floor(), still, outdoors).lamps
    assert light is not None
    np.testing.assert_allclose(light.positions, [np.array([0, 0, 0.25]) + 5000 * sun], rtol=1e-9)
    assert light.size == pytest.approx([46.5])


def free(
    depth: float = 3.0, n: int = 5, radius_px: float = 10.0, level: int = 100, bright_px: int | None = None
) -> bool:
    """Whether a position on the optical axis is free; n points of a wall at depth 4 are around it."""
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    radius = radius_px / 500 * 4
    wall = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, 4.0)])
    pixels = np.full((480, 640, 3), level, np.uint8)
    if bright_px is not None:
        pixels[240, 320 + bright_px] = 255
    return bool(is_visibly_free(np.array([[0.0, 0, depth]]), cloud(wall), Still(pixels, np.eye(3), (0, 0, 0)))[0])


def test_a_position_at_90_percent_of_the_depth_of_five_points_is_free() -> None:
    assert [free(depth) for depth in (3.59, 3.61)] == [True, False]
    assert [free(n=n) for n in (4, 5)] == [False, True]
    assert [free(radius_px=radius) for radius in (29.9, 30.1)] == [True, False]


def test_a_position_next_to_clipped_pixels_may_hold_a_lamp() -> None:
    assert [free(level=level) for level in (244, 245)] == [True, False]
    assert [free(bright_px=offset) for offset in (12, 13, -12, -13)] == [False, True, False, True]
