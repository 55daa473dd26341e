"""Removal of outliers keeps the points of the object and removes stray points."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.geometry.box import forest_inliers, neighbour_inliers
from tests.synthetic.shapes import sampled_box, sampled_cylinder


@pytest.mark.parametrize("count", [60, 400, 3000])
@pytest.mark.parametrize("shape", [sampled_box, sampled_cylinder])
def test_strays_go_and_the_object_stays(count, shape):
    random = np.random.default_rng(count)
    own = shape(np.array([0.6, 0.6, 1.0]), count, random)
    strays = random.normal([0, 4, 0], 0.5, (max(1, count // 40), 3))
    kept = neighbour_inliers(np.vstack([own, strays]))
    assert kept[:count].mean() > 0.985
    assert kept[count:].mean() < 0.2


def test_a_chairs_feet_without_its_legs_are_kept():
    """Methods.md: keeping only the largest cluster halved chairs."""
    random = np.random.default_rng(0)
    seat = np.add(sampled_box(np.array([0.45, 0.45, 0.5]), 1500, random), [0, 0, 0.7])
    feet = np.concatenate(
        [np.add(sampled_box(np.full(3, 0.05), 25, random), [x, y, 0]) for x in (-0.2, 0.2) for y in (-0.2, 0.2)]
    )
    kept = neighbour_inliers(np.vstack([seat, feet]))
    assert kept[1500:].mean() > 0.9


def test_a_small_far_cluster_goes():
    random = np.random.default_rng(1)
    own = sampled_box(np.array([0.3, 0.3, 0.3]), 800, random)
    wall = np.add(sampled_box(np.array([0.1, 0.01, 0.1]), 30, random), [0, 0.6, 0])
    kept = neighbour_inliers(np.vstack([own, wall]))
    assert not kept[800:].any()
    assert kept[:800].mean() > 0.98


@given(st.integers(0, 500), st.floats(1e-3, 1e3))
@settings(max_examples=20, deadline=None)
def test_the_unit_does_not_matter(seed, scale):
    random = np.random.default_rng(seed)
    points = np.vstack([sampled_box(np.ones(3), 150, random), random.normal(0, 3, (8, 3))])
    one, two = neighbour_inliers(points), neighbour_inliers(points * scale)
    assert (one != two).sum() <= 2  # a point on a cell's border may change sides by rounding


def test_few_or_coinciding_points_are_all_kept():
    assert neighbour_inliers(np.empty((0, 3))).shape == (0,)
    assert neighbour_inliers(np.zeros((5, 3))).all()
    assert neighbour_inliers(np.zeros((50, 3))).all()
    assert forest_inliers(np.zeros((5, 3))).all()


def test_the_papers_forest_is_repeatable_and_harsher():
    random = np.random.default_rng(2)
    points = np.vstack([sampled_box(np.ones(3), 400, random), random.normal(0, 4, (10, 3))])
    one, two = forest_inliers(points), forest_inliers(points)
    assert (one == two).all()
    assert one[400:].mean() < 0.3
    assert one[:400].mean() < neighbour_inliers(points)[:400].mean()


@pytest.mark.parametrize(("distance", "count", "is_kept"), [(0.55, 60, True), (0.85, 60, False), (0.85, 130, True)])
def test_a_small_cluster_is_kept_within_seven_tenths_of_the_diagonal(distance, count, is_kept):
    """A cluster with fewer than a tenth of the points beside a cube with a diagonal of 1."""
    random = np.random.default_rng(0)
    side = 1 / np.sqrt(3)
    cube = sampled_box(np.full(3, side), 1000, random)
    cube -= cube.min(axis=0)
    other = np.add(random.uniform(-0.02, 0.02, (count, 3)), [side + distance + 0.02, side / 2, side / 2])
    points = np.vstack([cube, other])
    assert bool(neighbour_inliers(points)[-count:].mean() > 0.5) == is_kept


@pytest.mark.parametrize(("count", "is_kept"), [(19, True), (20, False)])
def test_outliers_are_removed_from_twenty_points(count, is_kept):
    """MIN_POINTS: the last point is ten sides of the object away."""
    points = sampled_box(np.full(3, 0.3), count, np.random.default_rng(0))
    points[-1] = [3, 0, 0]
    kept = neighbour_inliers(points)
    assert kept[-1] == is_kept
    assert kept.all() == is_kept
