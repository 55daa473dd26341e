"""Limits of a plain background, in Lab units on each side."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from metric_tree.cutouts import plain
from metric_tree.cutouts.plain import Background, background, difference_mask, shadow_mask, with_curved_light

SHAPE = (200, 200)
GREY = np.array([90.0, 0.0, 0.0])


def lab(noise: float = 0.0, seed: int = 1) -> NDArray[np.float32]:
    """A grey image (200, 200, 3) with noise."""
    return (GREY + np.random.default_rng(seed).normal(0, noise, (*SHAPE, 3))).astype(np.float32)


def ground(noise: float = 0.0) -> Background:
    return Background(lab(), noise, 1.0)


@pytest.mark.parametrize(("fraction", "noise", "is_plain"), [(0.75, 3, True), (0.74, 3, False), (0.75, 3.1, False)])
def test_a_plain_background_has_three_quarters_of_the_border_and_little_noise(
    fraction: float, noise: float, is_plain: bool
) -> None:
    assert Background(lab(), noise, fraction).is_plain == is_plain


@pytest.mark.parametrize(("noise", "tolerance"), [(0.0, 5.0), (1.25, 5.0), (1.5, 6.0)])
def test_the_tolerance_is_5_or_4_deviations(noise: float, tolerance: float) -> None:
    assert ground(noise).tolerance == pytest.approx(tolerance)


@pytest.mark.parametrize(("difference", "follows"), [(4.9, True), (5.1, False)])
def test_a_pixel_within_5_units_follows_the_border(difference: float, follows: bool) -> None:
    image = lab()
    image[:, 90:110, 0] -= difference  # a strip that crosses the border twice
    assert (background(image).fraction == 1.0) == follows


def test_noise_of_the_border_is_measured_and_follows() -> None:
    found = background(lab(2.0))
    assert found.noise == pytest.approx(1.5, abs=0.3)  # of the three quarters with the least noise
    assert found.fraction > 0.95


@pytest.mark.parametrize(("side", "is_hole"), [(4, False), (5, True)])
def test_a_hole_has_20_of_40000_pixels(side: int, is_hole: bool) -> None:
    distance = np.zeros(SHAPE, np.float32)
    distance[50:150, 50:150] = 30.0
    distance[100 : 100 + side, 100 : 100 + side] = 0.0
    assert bool(difference_mask(distance, ground())[101, 101]) != is_hole


@pytest.mark.parametrize(("n", "is_part"), [(3, False), (4, True)])
def test_a_part_has_4_of_40000_pixels(n: int, is_part: bool) -> None:
    distance = np.zeros(SHAPE, np.float32)
    distance[60, 60 : 60 + n] = 30.0
    assert bool(difference_mask(distance, ground()).any()) == is_part


@pytest.mark.parametrize(
    ("loss", "hue", "is_shadow"), [(0.44, 4.9, True), (0.46, 0.0, False), (0.2, 5.1, False), (-0.05, 0.0, False)]
)
def test_a_shadow_is_dark_by_at_most_45_percent_without_a_hue(loss: float, hue: float, is_shadow: bool) -> None:
    image, outside = lab(), np.ones(SHAPE, bool)
    outside[50:150, 50:150] = False
    ramp = np.minimum(np.arange(100) + 1, 100 - np.arange(100))
    rise = np.minimum(np.minimum(ramp[:, None], ramp) / 20, 1.0)  # over 20 pixels
    image[50:150, 50:150] += rise[..., None] * np.array([-loss * GREY[0], hue, 0.0], np.float32)
    assert bool(shadow_mask(image, lab(), outside)[100, 100]) == is_shadow


@pytest.mark.parametrize(("step", "is_soft"), [(4.9, True), (5.1, False)])
def test_the_edge_of_a_shadow_changes_by_5_units_per_pixel(step: float, is_soft: bool) -> None:
    image, outside = lab(), np.ones(SHAPE, bool)
    outside[60:140, 60:140] = False
    depth = np.minimum(np.minimum(np.arange(80) + 1, 80 - np.arange(80)), 7)  # a ramp of seven pixels
    image[60:140, 60:140, 0] -= step * np.minimum(depth[:, None], depth)
    assert bool(shadow_mask(image, lab(), outside)[63, 100]) == is_soft


@pytest.mark.parametrize(("n", "is_fitted"), [(99, False), (100, True)])
def test_the_light_is_fitted_to_at_least_100_pixels_of_the_background(n: int, is_fitted: bool) -> None:
    image = np.tile(GREY, (20, 20, 1)).astype(np.float32)
    image[5:] += 50.0
    image[:5, :] += 1.0
    image[0, n - 100 :] += 50.0 if n < 100 else 0.0
    fitted = with_curved_light(image, Background(np.tile(GREY, (20, 20, 1)).astype(np.float32), 0.0, 1.0))
    assert (abs(float(fitted.lab[2, 2, 0]) - 91.0) < 0.1) == is_fitted


def test_the_edge_of_a_large_image_is_that_of_the_image_and_not_of_the_small_copy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(plain, "COPY_SIDE_PX", 40)
    picture = np.full((120, 160, 3), 250, np.uint8)
    picture[31:90, 41:122] = (150, 40, 30)
    found = plain.Plain().foreground(picture)
    rows, columns = (np.flatnonzero((found.alpha > 0).any(axis=axis)) for axis in (1, 0))
    assert (rows[0], rows[-1], columns[0], columns[-1]) == (31, 89, 41, 121)
