"""Thresholds of occluders in numbers on each side: fractions of closer points, supports, points without a mask."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from insertion.composite.occlusion import (
    close_gaps,
    guided_matte,
    occluded_by_mask,
    occluded_by_points,
    on_support,
    stands_on_occluder,
)
from insertion.render.body import Body
from insertion.scene.point_cloud import ColouredPoints, VisiblePoints
from metric_base.arrays import BoolArray, FloatArray

SHAPE = (60, 120)
EVERYWHERE: BoolArray = np.ones(SHAPE, dtype=bool)
DEPTH: NDArray[np.float32] = np.full(SHAPE, 2.0, np.float32)


def spread(n: int, low: tuple[float, float], high: tuple[float, float]) -> FloatArray:
    """(n, 2) pixels in a rectangle."""
    return np.random.default_rng(0).uniform(low, high, (n, 2))


def by_mask(n_left: int, n_right: int, left: float, right: float) -> BoolArray | None:
    """Occluded pixels of a mask over the whole box, with points on its left and right at factors of the depth."""
    pixels = np.vstack([spread(n_left, (5, 20), (25, 40)), spread(n_right, (60, 5), (115, 55))])
    depths = 2.0 * np.repeat([left, right], [n_left, n_right])
    return occluded_by_mask(EVERYWHERE, EVERYWHERE, DEPTH, pixels, depths, np.ones(len(pixels), dtype=bool))


@pytest.mark.parametrize(("n_farther", "is_complete"), [(3, True), (4, False)])
def test_a_mask_with_97_percent_of_closer_points_occludes_completely(n_farther: int, is_complete: bool) -> None:
    found = by_mask(n_farther, 100 - n_farther, 1.5, 0.5)
    assert found is not None
    assert found[20:40, 90].all()
    assert found[20:40, 5:25].all() == is_complete


@pytest.mark.parametrize(("n_closer", "occludes"), [(3, False), (4, True)])
def test_a_mask_with_3_percent_of_closer_points_does_not_occlude(n_closer: int, occludes: bool) -> None:
    found = by_mask(n_closer, 100 - n_closer, 0.5, 1.5)
    assert found is not None
    assert not found[20:40, 90].any()
    assert found.any() == occludes


@pytest.mark.parametrize(("ratio", "votes"), [(0.987, True), (0.989, False), (1.011, False), (1.013, True)])
def test_points_within_1_2_percent_of_the_depth_do_not_vote(ratio: float, votes: bool) -> None:
    found = by_mask(10, 0, ratio, 1.0)
    assert (found is not None) == votes
    assert found is None or bool(found.all()) == (ratio < 1)


@pytest.mark.parametrize(("n", "is_known"), [(3, False), (4, True)])
def test_a_mask_needs_four_points(n: int, is_known: bool) -> None:
    assert (by_mask(n, 0, 0.5, 1.0) is not None) == is_known


@pytest.mark.parametrize(
    ("first", "last", "stands"), [(20, 24, True), (21, 24, True), (22, 24, False), (20, 22, False), (20, 23, True)]
)
def test_a_mask_stands_on_most_of_the_4_pixels_below_it(first: int, last: int, stands: bool) -> None:
    occluded, mask = np.zeros(SHAPE, bool), np.zeros(SHAPE, bool)
    mask[10:20, 30:50] = True
    occluded[first:last] = True
    assert stands_on_occluder(occluded, mask) == stands


def by_points(pixels: FloatArray, factors: FloatArray, max_distance: float = 100.0) -> BoolArray:
    return occluded_by_points(EVERYWHERE, DEPTH, pixels, 2.0 * factors, max_distance)


@pytest.mark.parametrize(("n", "occludes"), [(6, False), (7, True)])
def test_seven_points_occlude_without_a_mask(n: int, occludes: bool) -> None:
    assert by_points(spread(n, (40, 20), (80, 40)), np.full(n, 0.5))[30, 60] == occludes


@pytest.mark.parametrize(("n_closer", "occludes"), [(5, True), (4, False)])
def test_70_percent_of_seven_points_are_closer(n_closer: int, occludes: bool) -> None:
    angle = 2 * np.pi * np.arange(7) / 7 * 3  # neighbours in the list are on different sides
    pixels = np.array([60.5, 30.5]) + 10 * np.column_stack([np.cos(angle), np.sin(angle)])
    assert by_points(pixels, np.repeat([0.5, 1.5], [n_closer, 7 - n_closer]))[30, 60] == occludes


@pytest.mark.parametrize(("factor", "occludes"), [(0.963, True), (0.965, False)])
def test_points_of_a_dense_cloud_are_3_6_percent_closer(factor: float, occludes: bool) -> None:
    assert by_points(spread(40, (40, 10), (80, 50)), np.full(40, factor))[30, 60] == occludes


@pytest.mark.parametrize(("half_angle_deg", "occludes"), [(55.0, True), (46.0, False)])
def test_points_on_one_side_of_a_pixel_do_not_occlude_it(half_angle_deg: float, occludes: bool) -> None:
    """The mean of seven unit vectors over a sector has a length of 0.81 or 0.86."""
    angle = np.radians(np.linspace(-half_angle_deg, half_angle_deg, 7))
    pixels = np.array([60.5, 30.5]) + 20 * np.column_stack([np.cos(angle), np.sin(angle)])
    mean = float(np.linalg.norm(np.column_stack([np.cos(angle), np.sin(angle)]).mean(axis=0)))
    assert (mean < 0.85) == occludes
    assert by_points(pixels, np.full(7, 0.5))[30, 58] == occludes


@pytest.mark.parametrize(("max_distance", "occludes"), [(9.0, False), (11.0, True)])
def test_the_median_distance_of_points_has_a_maximum(max_distance: float, occludes: bool) -> None:
    angle = 2 * np.pi * np.arange(7) / 7
    pixels = np.array([60.5, 30.5]) + 10 * np.column_stack([np.cos(angle), np.sin(angle)])
    assert by_points(pixels, np.full(7, 0.5), max_distance)[30, 60] == occludes


@pytest.mark.parametrize(("width", "is_closed"), [(10, True), (12, False)])
def test_gaps_of_twice_the_reach_are_closed(width: int, is_closed: bool) -> None:
    occluded = np.ones(SHAPE, dtype=bool)
    occluded[:, 50 : 50 + width] = False
    closed = close_gaps(occluded, 5, DEPTH, np.empty((0, 2)), np.empty(0))
    assert closed[30].all() == is_closed


@pytest.mark.parametrize(("factor", "is_open"), [(1.011, False), (1.013, True)])
def test_a_visible_point_behind_the_object_keeps_a_gap_open(factor: float, is_open: bool) -> None:
    occluded = np.ones(SHAPE, dtype=bool)
    occluded[:, 50:56] = False
    closed = close_gaps(occluded, 5, DEPTH, np.array([[52.5, 30.5]]), np.array([2.0 * factor]))
    assert closed[30].all() != is_open


@pytest.mark.parametrize(
    ("height", "sigma", "depth", "is_support"),
    [
        (0.049, 0.0, 1.0, True),  # 5 % of the size of 1
        (0.051, 0.0, 1.0, False),
        (0.119, 0.0, 10.0, True),  # 1.2 % of the depth
        (0.121, 0.0, 10.0, False),
        (0.149, 0.05, 1.0, True),  # 3 standard deviations
        (0.151, 0.05, 1.0, False),
        (0.299, 0.5, 1.0, True),  # at most 30 % of the size
        (0.301, 0.5, 1.0, False),
    ],
)
def test_points_near_the_foot_are_on_the_support(height: float, sigma: float, depth: float, is_support: bool) -> None:
    body = Body((), np.zeros(3), np.eye(3), 1.0)
    cloud = ColouredPoints(np.array([[0.0, 0.0, height]]), np.ones((1, 3), np.float32), False)
    points = VisiblePoints(np.array([0]), np.zeros((1, 2)), np.array([depth]), False)
    assert on_support(body, cloud, points, sigma).tolist() == [is_support]


def test_the_matte_of_a_sharp_edge_is_0_and_1_next_to_it() -> None:
    """A mask ends two pixels before the edge of the image; the matte ends at the edge, within one pixel."""
    image = np.zeros((60, 120, 3), np.uint8)
    image[:, 60:] = 200
    mask = np.zeros(SHAPE, dtype=bool)
    mask[:, 62:] = True
    row = guided_matte(mask, image, 4)[30]
    assert row[:61].max() < 0.001
    assert row[61:63] == pytest.approx([0.206, 0.949], abs=0.008)  # contrast and residual change these two pixels
    assert row[63:].min() > 0.999
