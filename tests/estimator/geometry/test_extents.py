"""The extent rule: invariance, bias on synthetic shapes, honesty of its sigma; the footprint on L-shapes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.geometry.box import footprint_axes, smallest_rectangle_axes
from estimator.geometry.extents import edges, extent_sigma, level_top
from tests.synthetic.shapes import sampled_box, sampled_cylinder


def extents(points, noise=0.0):
    low, high = edges(points, noise)
    return high - low


@given(st.integers(0, 1000), st.floats(1e-4, 1e4), st.floats(-1e3, 1e3))
@settings(max_examples=25, deadline=None)
def test_extents_scale_and_shift_with_the_points(seed, scale, shift):
    points = np.random.default_rng(seed).uniform(size=(200, 3))
    low, high = edges(points)
    low_moved, high_moved = edges(points * scale + shift)
    assert np.allclose(low_moved, low * scale + shift, rtol=1e-6, atol=1e-6 * (scale + abs(shift)))
    assert np.allclose(high_moved, high * scale + shift, rtol=1e-6, atol=1e-6 * (scale + abs(shift)))


@pytest.mark.parametrize("count", [100, 400, 3000])
@pytest.mark.parametrize("shape", [sampled_box, sampled_cylinder])
def test_bias_on_clean_surfaces_is_under_two_per_cent(count, shape):
    random = np.random.default_rng(count)
    size = np.array([0.5, 0.5, 0.9])
    measured = np.mean([extents(shape(size, count, random)) for _ in range(40)], axis=0)
    assert np.abs(np.log(measured / size)).max() < 0.02


def test_noise_is_taken_off_where_it_is_known():
    random = np.random.default_rng(0)
    size = np.array([0.6, 0.4, 0.5])
    points = sampled_box(size, 4000, random) + random.normal(0, 0.01, (4000, 3))
    plain, corrected = extents(points), extents(points, 0.01)
    assert np.abs(np.log(corrected / size)).mean() < np.abs(np.log(plain / size)).mean()


def test_a_side_that_fades_out_evenly_keeps_its_whole_length():
    """A wall without end faces: the share that is cut off at either end is put back."""
    random = np.random.default_rng(7)
    ratios = [extents(random.uniform(size=(1000, 1)))[0] for _ in range(40)]
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.006)


@pytest.mark.parametrize("sigma", [0.005, 0.01])
def test_noise_lengthens_an_object_with_end_faces_and_is_taken_off(sigma):
    """A sixth of the points on either end face: without the correction the extent is 3.5 standard deviations long."""
    random = np.random.default_rng(8)
    ratios = []
    for _ in range(30):
        which, inner = random.random(1000), random.random(1000)
        clean = np.where(which < 1 / 6, 0.0, np.where(which < 1 / 3, 1.0, inner))
        ratios.append(extents((clean + random.normal(0, sigma, 1000))[:, None], sigma)[0])
    assert np.mean(ratios) - 1 < 2.6 * sigma


def test_one_flying_point_in_two_hundred_moves_nothing_much():
    random = np.random.default_rng(1)
    points = sampled_box(np.ones(3), 400, random)
    wild = np.vstack([points, [[30, 30, 30], [-30, -30, -30]]])
    assert np.abs(np.log(extents(wild) / extents(points))).max() < 0.03


def test_sigma_covers_the_error_of_made_shapes():
    """Over shapes and counts the error stays within two stated standard deviations nine times in ten."""
    random = np.random.default_rng(2)
    inside = []
    for _ in range(150):
        size = random.uniform(0.1, 1.0, 3)
        size[1] = size[0]
        count = int(random.choice([30, 100, 1000]))
        points = (sampled_box if random.random() < 0.5 else sampled_cylinder)(size, count, random)
        found = extents(points)
        sigma = np.linalg.norm(extent_sigma(points, found, 0.0), axis=0)
        inside.append(np.abs(np.log(found / size)) < 2 * sigma)
    assert np.mean(inside) > 0.9


def test_sigma_grows_with_fewer_points_noise_and_fading_edges():
    random = np.random.default_rng(3)
    many, few = sampled_box(np.ones(3), 3000, random), sampled_box(np.ones(3), 30, random)
    plain = extent_sigma(many, np.ones(3), 0.0)
    assert (extent_sigma(few, np.ones(3), 0.0) > plain).all()
    assert (extent_sigma(many, np.ones(3), 0.1) > plain).all()
    fading = np.where(many > 0.4, many + random.exponential(0.2, many.shape), many)
    assert (extent_sigma(fading, np.ones(3), 0.0)[1] > plain[1]).all()


def angle_of(axes):
    return float(np.degrees(np.arctan2(axes[0, 1], axes[0, 0])) % 90)


@pytest.mark.parametrize("turn", [0.0, 17.0, 45.0, 80.0])
def test_footprint_of_a_rectangle(turn):
    random = np.random.default_rng(4)
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    points = sampled_box(np.array([1.0, 0.5, 1]), 2000, random)[:, :2] @ np.array([[c, s], [-s, c]])
    off = abs(angle_of(footprint_axes(points)) - turn)
    assert min(off, 90 - off) <= 1.5


def test_an_l_of_two_walls_is_not_turned_to_its_hypotenuse():
    """Two sides of a box seen from its corner: the minimum rectangle has the same area both ways, closeness tells."""
    random = np.random.default_rng(5)
    wins = 0
    for _ in range(20):
        along = np.column_stack([random.uniform(0, 1, 300), random.normal(0, 0.01, 300)])
        across = np.column_stack([random.normal(0, 0.01, 200), random.uniform(0, 0.6, 200)])
        angle = angle_of(footprint_axes(np.vstack([along, across])))
        wins += min(angle, 90 - angle) < 4
    assert wins == 20


def test_papers_rectangle_is_the_smallest():
    random = np.random.default_rng(6)
    points = random.uniform([0, 0], [2, 1], (500, 2))
    axes = smallest_rectangle_axes(points)
    assert np.allclose(axes @ axes.T, np.eye(2))
    areas = []
    for degrees in np.arange(0, 90, 1.0):
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        areas.append(np.prod(np.ptp(points @ np.array([[c, -s], [s, c]]), axis=0)))
    assert np.prod(np.ptp(points @ axes.T, axis=0)) <= min(areas) * 1.001


def test_no_edge_has_less_noise_than_the_rule_of_quantiles_and_more_points_never_give_it_more() -> None:
    """Two bare faces have no fade: the rule's own error is left, and less of sampling with more points."""
    faces = np.repeat([[0.0, 0, 0], [1, 1, 1]], 5000, axis=0)
    sigmas = [extent_sigma(faces[:: 10_000 // n], np.ones(3), 0.0).max() for n in (10, 100, 1000, 10_000)]
    assert all(sigma > 0.015 for sigma in sigmas)
    assert sigmas == sorted(sigmas, reverse=True)
    assert sigmas[-1] == pytest.approx(0.015, rel=0.05)


def test_a_table_ends_at_its_top_and_not_with_what_lies_on_it() -> None:
    random = np.random.default_rng(3)
    legs, top, books = random.uniform(0, 0.7, 60), random.normal(0.74, 0.004, 100), random.uniform(0.75, 0.95, 40)
    assert level_top(np.concatenate([legs, top, books]), 0.0, 0.95) == pytest.approx(0.74, abs=0.01)
    # a front without a top has no peak
    assert level_top(random.uniform(0, 0.95, 200), 0.0, 0.95) is None
    assert level_top(top[:3], 0.0, 0.95) is None


@pytest.mark.parametrize(("height", "is_found"), [(0.42, False), (0.53, True)])
def test_a_level_top_is_in_the_upper_half_of_an_object(height, is_found):
    """A shelf at this height of a unit box, with a few points up to its upper end."""
    random = np.random.default_rng(0)
    heights = np.concatenate([random.uniform(0, 1, 60), random.normal(height, 0.002, 100)])
    top = level_top(heights, 0.0, 1.0)
    assert (top is not None) == is_found
    if is_found:
        assert top == pytest.approx(height, abs=0.01)


ENDS = np.array([[0.0], [0.02], [0.96], [1.0]])  # quantiles of a side of length 1 that fades by 0.02 and 0.04


def test_edges_are_extrapolated_by_half_a_fade_and_a_hundred_points_miss_a_hundredth():
    low, high = edges(np.zeros((100, 1)), 0.0, ENDS)
    extent = 1.0 + (0.02 + 0.04) / 2
    assert (low[0], high[0]) == pytest.approx((-0.01 - extent / 200, 1.02 + extent / 200), abs=1e-12)
    far = np.array([[0.0], [0.2], [0.5], [1.0]])
    low, high = edges(np.zeros((10**9, 1)), 0.0, far)
    assert (low[0], high[0]) == pytest.approx((-0.025, 1.025), abs=1e-8), "a fade is at most a twentieth"


@pytest.mark.parametrize("noise", [0.01, 0.1, 0.2])
def test_noise_widens_an_extent_by_up_to_twice_21_standard_deviations(noise):
    """observed = E + 2 c noise with c = 0.6 + 1.5 noise / (noise + 0.3 E)."""
    observed = 1.0 + 2 * noise * (0.6 + 1.5 * noise / (noise + 0.3))
    low, high = edges(np.zeros((10**9, 1)), noise, np.array([[0.0], [0.0], [observed], [observed]]))
    assert high[0] - low[0] == pytest.approx(max(1.0, observed / 2), abs=1e-6)


def test_formula_of_the_standard_deviation_of_edges():
    sigma = extent_sigma(np.zeros((20, 1)), np.array([2.0]), 0.1, ENDS)
    common = 0.015**2 + 0.25**2 / 20 + (3 / 20) ** 2 + 0.05**2 / 2
    assert sigma[:, 0] == pytest.approx(np.sqrt([common + (0.6 * 0.01) ** 2, common + (0.6 * 0.02) ** 2]))


@pytest.mark.parametrize(
    ("top", "upper", "lower", "is_found"),
    [
        ([0.8] * 6, 0, 0, True),  # MIN_TOP_POINTS
        ([0.8] * 5, 0, 0, False),
        ([0.8] * 20, 0, 179, True),  # MIN_TOP_FRACTION of 0.1
        ([0.8] * 20, 0, 181, False),
        ([0.8] * 25, 75, 0, True),  # MIN_TOP_RATIO of 2 to a uniform density of 0.12
        ([0.8] * 23, 77, 0, False),
        ([0.8] * 3 + [0.855] * 3, 0, 0, True),  # TOP_WINDOW of 0.06
        ([0.8] * 3 + [0.865] * 3, 0, 0, False),
    ],
)
def test_both_sides_of_the_thresholds_of_a_level_top(top, upper, lower, is_found):
    """Points at the top, points evenly distributed below it in the upper half, and points in the lower half."""
    heights = np.concatenate([top, np.linspace(0.51, 0.73, upper), np.full(lower, 0.25)])
    assert (level_top(heights, 0.0, 1.0) is not None) == is_found


def test_a_level_top_is_the_upper_quartile_of_its_window():
    assert level_top(0.8 + 0.005 * np.arange(9), 0.0, 1.0) == pytest.approx(0.83)
