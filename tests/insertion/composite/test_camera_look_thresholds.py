"""Limits of the look of a frame: points and stops of the gain, and the smoothness and squares of the grain."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from insertion.colour import linear_to_srgb
from insertion.composite.camera_look import blur_layer, measure_blur, measure_gain, measure_look
from insertion.scene.point_cloud import ColouredPoints, VisiblePoints

NO_POINTS = VisiblePoints(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0), False)
NO_CLOUD = ColouredPoints(np.zeros((0, 3)), np.zeros((0, 3), np.float32), False)


def gain(n_points: int, linear: float, mean: float) -> float:
    """The gain of a frame of one linear value over a cloud of another."""
    image = np.rint(linear_to_srgb(np.full((20, 20, 3), linear, np.float32))).astype(np.uint8)
    pixels = np.column_stack([np.arange(n_points) % 20, np.arange(n_points) // 20]).astype(float)
    points = VisiblePoints(np.arange(n_points), pixels, np.ones(n_points), False)
    cloud = ColouredPoints(np.zeros((n_points, 3)), np.full((n_points, 3), mean, np.float32), False)
    return float(measure_gain(image, points, cloud)[0])


@pytest.mark.parametrize(("n_points", "expected"), [(29, 1.0), (30, 2.0)])
def test_a_gain_needs_30_points(n_points: int, expected: float) -> None:
    assert gain(n_points, 0.4, 0.2) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(("mean", "expected"), [(0.12, 3.33), (0.08, 4.0), (0.03, 4.0)])
def test_a_gain_is_at_most_two_stops(mean: float, expected: float) -> None:
    assert gain(60, 0.4, mean) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(
    ("linear", "mean", "is_used"),
    [(0.023, 0.2, True), (0.017, 0.2, False), (0.4, 0.88, True), (0.4, 0.92, False)],
)
def test_dark_and_clipped_points_have_no_gain(linear: float, mean: float, is_used: bool) -> None:
    assert (gain(60, linear, mean) != 1) == is_used


def grain_px(smooth_px: float) -> float:
    """The smoothness of grain that was blurred by so many pixels."""
    noise = np.random.default_rng(4).normal(0, 1, (240, 320)).astype(np.float32)
    noise = cv2.GaussianBlur(noise, (0, 0), smooth_px)
    grey = np.clip(np.rint(120 + 5 * noise / noise.std()), 0, 255).astype(np.uint8)
    return measure_look(np.repeat(grey[..., None], 3, axis=2), NO_POINTS, NO_CLOUD).grain_px


def test_grain_is_smooth_by_at_most_1_pixel() -> None:
    assert grain_px(0.8) < 0.97
    assert grain_px(2.2) == pytest.approx(1.0)


@pytest.mark.parametrize(("n_squares", "has_grain"), [(11, False), (12, True)])
def test_grain_needs_12_squares(n_squares: int, has_grain: bool) -> None:
    noise = np.random.default_rng(5).normal(120, 4, (8, 8 * n_squares, 3))
    image = np.clip(np.rint(noise), 0, 255).astype(np.uint8)
    assert bool(measure_look(image, NO_POINTS, NO_CLOUD).grain.any()) == has_grain


@pytest.mark.parametrize(("level", "has_grain"), [(4, False), (5, True), (250, True), (251, False)])
def test_black_and_clipped_pixels_have_no_grain(level: int, has_grain: bool) -> None:
    image = np.full((80, 80, 3), level, np.uint8)
    image[::2, ::2] = 120  # the extreme pixels of every square have this level
    assert bool(measure_look(image, NO_POINTS, NO_CLOUD).grain.any()) == has_grain


def test_blur_is_0_35_to_4_pixels() -> None:
    edge = np.zeros((160, 160), np.float32)
    cv2.circle(edge, (80, 80), 50, 255, -1)
    assert np.linalg.eigvalsh(measure_blur(edge)).min() >= 0.35**2 - 1e-9
    assert np.sqrt(np.linalg.eigvalsh(measure_blur(cv2.GaussianBlur(edge, (0, 0), 3.0))).max()) < 3.9
    assert np.sqrt(np.linalg.eigvalsh(measure_blur(cv2.GaussianBlur(edge, (0, 0), 9.0))).max()) == pytest.approx(4.0)


@pytest.mark.parametrize(("px", "is_blurred"), [(0.14, False), (0.16, True)])
def test_a_blur_of_15_percent_of_a_pixel_is_applied(px: float, is_blurred: bool) -> None:
    """The blur of the renderer, 0.35 pixels, is subtracted."""
    layer = np.zeros((9, 9, 1), np.float32)
    assert (blur_layer(layer, np.eye(2) * (0.35**2 + px**2)) is layer) != is_blurred


@pytest.mark.parametrize(("side", "is_measured"), [(47, False), (50, True)])
def test_a_direction_needs_400_pixels(side: int, is_measured: bool) -> None:
    """A cone has gradients of all six directions; 17 by 17 sampled pixels stand for 433 of each, 16 by 16 for 384."""
    y, x = np.mgrid[:side, :side] - (side - 1) / 2
    blur = measure_blur(np.hypot(x + 0.3, y - 0.2).astype(np.float32))
    assert np.allclose(blur, np.eye(2) * 0.35**2) != is_measured


def grainy(widths: np.ndarray, texture: float = 0.0) -> np.ndarray:
    """White grain (GRAIN_BINS, 3) that is measured in squares of these standard deviations, with stripes."""
    noise = np.random.default_rng(6).normal(0, 1, (8, 8 * len(widths))) * np.repeat(widths, 8)
    noise += texture * np.sin(2 * np.pi * np.arange(8 * len(widths)) / 8)
    image = np.repeat(np.clip(np.rint(120 + noise), 0, 255).astype(np.uint8)[..., None], 3, axis=2)
    return np.asarray(measure_look(image, NO_POINTS, NO_CLOUD).grain)


def test_grain_has_8_levels_of_brightness() -> None:
    assert grainy(np.full(20, 3.0)).shape == (8, 3)


@pytest.mark.parametrize(("n_plain", "is_plain"), [(26, False), (34, True)])
def test_grain_is_that_of_the_plainest_15_percent_of_the_squares(n_plain: int, is_plain: bool) -> None:
    """Of 200 squares, this number has a standard deviation of 2 and the others one of 8."""
    sigma = grainy(np.repeat([2.0, 8.0], [n_plain, 200 - n_plain]))[3, 0]
    assert (sigma < 5) == is_plain


def test_grain_is_at_most_2_6_times_its_finest_differences() -> None:
    """Stripes have no diagonal differences; the plainest 15 % of the squares have fine differences of 1.8.

    Grain of this ratio is as smooth as a blur of 1 pixel, and the squares show 0.5 of its standard deviation.
    """
    assert grainy(np.full(200, 2.0), 25.0)[3, 0] == pytest.approx(2.6 * 1.82 / 0.5, rel=0.05)
