"""Distances between the points of groups of masks, on each side of the limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from estimator.association.proximity import GroupClouds, close_groups, relative_distance
from metric_base.arrays import FloatArray


def _distance(one: FloatArray, two: FloatArray) -> float:
    points = (one, two)
    clouds = GroupClouds(lambda mask: points[mask])
    return relative_distance(clouds.of((0,)), clouds.of((1,)))


@pytest.mark.parametrize(
    ("counts", "is_close"),
    [
        ((10, 3), True),
        ((9, 3), False),  # MIN_LARGER_POINTS
        ((10, 2), False),  # MIN_SMALLER_POINTS
        ((3, 10), True),
        ((2, 10), False),
        ((10, 0), False),
        ((9, 9), False),
        ((10, 10), True),
    ],
)
def test_groups_are_compared_if_they_have_three_and_ten_points(counts: Sequence[int], is_close: bool) -> None:
    boxes = np.tile(np.array([[0.0, 0, 0], [1, 1, 1]]), (2, 1, 1))
    assert close_groups(boxes, np.array(counts), 0).tolist() == ([1] if is_close else [])


@pytest.mark.parametrize(("gap", "is_close"), [(0.9, True), (2.9, True), (3.1, False)])
def test_groups_are_compared_within_the_larger_diagonal(gap: float, is_close: bool) -> None:
    boxes = np.array([[[0.0, 0, 0], [1, 2, 2]], [[1 + gap, 0, 0], [1.5 + gap, 1, 1]]])
    for index in (0, 1):
        assert close_groups(boxes, np.array([20, 20]), index).tolist() == ([1 - index] if is_close else [])


@pytest.mark.parametrize(
    ("gap", "relative"),
    [(0.0, 0.0), (0.14, 0.14 / 0.15), (0.149, 0.149 / 0.15), (0.151, np.inf), (0.2, np.inf)],
)
def test_distance_is_relative_to_15_percent_of_the_larger_diagonal(gap: float, relative: float) -> None:
    """A line of a length of 1 with points every 0.01, and three points beside its end."""
    line = np.column_stack([np.linspace(0, 1, 101), np.zeros((101, 2))])
    others = np.array([[1 + gap, 0.0, 0]] * 3)
    assert _distance(line, others) == pytest.approx(relative)
    assert _distance(others, line) == pytest.approx(relative)


def test_the_threshold_is_at_least_the_spacing_of_the_larger_cloud() -> None:
    """Three points half a unit apart: the threshold is 0.5, not 15 % of 1; with points 0.1 apart it is 0.15."""
    others = np.array([[1.3, 0.0, 0]] * 3)
    assert _distance(np.array([[0.0, 0, 0], [0.5, 0, 0], [1, 0, 0], [1, 0, 0.5]]), others) == pytest.approx(0.6)
    assert _distance(np.column_stack([np.linspace(0, 1, 11), np.zeros((11, 2))]), others) == np.inf


def test_an_empty_cloud_is_close_to_nothing_and_a_point_to_itself() -> None:
    point = np.ones((1, 3))
    assert _distance(point, np.empty((0, 3))) == np.inf
    assert _distance(point, point) == 0
    assert _distance(point, np.add(point, [0.9e-9, 0, 0])) == pytest.approx(0.9, rel=1e-6)  # MIN_DISTANCE of 1e-9 units
    assert _distance(point, np.add(point, [1.1e-9, 0, 0])) == np.inf


@pytest.mark.parametrize(("count", "n_kept"), [(399, 399), (400, 400), (401, 201), (801, 267)])
def test_a_cloud_has_400_points(count: int, n_kept: int) -> None:
    cloud = GroupClouds(lambda _: np.zeros((count, 3))).of((0,))
    assert (len(cloud.points), cloud.count) == (n_kept, count)
