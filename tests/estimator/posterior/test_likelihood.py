"""One object's likelihood against the definition, integrated by brute force."""

from __future__ import annotations

import math
import tracemalloc
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from estimator.posterior import axis_assignments, object_likelihood
from estimator.posterior.axis_assignments import LOG_BOX, TRUNCATION_MIXTURE, VERTICAL, Layout, variants
from estimator.posterior.object_likelihood import (
    COLUMNS,
    ROWS,
    ObjectEvidence,
    inverse,
    measurement_arrays,
    rows,
    usable,
)
from estimator.posterior.posterior import object_curves
from metric_base.arrays import FloatArray
from metric_tree.prior import Prior
from tests.synthetic.priors import evidence, prior

# Published values, written out so that a changed rule fails a test.
OUTLIER_PROBABILITY = 0.1

CHAIR = prior("chair.n.01", [(560, 540, 950), (700, 640, 1100)])


@pytest.fixture
def no_gross_errors(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The plain mixture: dimensions are cut or measured as their sigma states."""
    monkeypatch.setattr(axis_assignments, "GROSS_ERROR_PROBABILITY", 0.0)
    variants.cache_clear()
    object_likelihood.layout_table.cache_clear()
    yield
    variants.cache_clear()
    object_likelihood.layout_table.cache_clear()


def _curves(items: Sequence[ObjectEvidence], u: FloatArray) -> FloatArray:
    """Return the likelihood (n, g) of each object."""
    return object_curves(rows(measurement_arrays(items)), u)


def _density(of: Prior, y: FloatArray, u: float, order: tuple[int, ...], sigma: float) -> float:
    """Plain mixture density of log extents y assigned to the prior's axes by `order`, relative to the outlier's."""
    x = y[list(order)] + u + math.log(1000)
    total = 0.0
    for weight, mean, covariance in zip(of.weights, of.means, of.covariances, strict=True):
        spread = covariance + of.shared_covariance + sigma**2 * np.eye(3)
        total += weight * multivariate_normal(mean, spread).pdf(x)
    return total * LOG_BOX**3


@pytest.mark.usefixtures("no_gross_errors")
@given(st.floats(-2, 2), st.lists(st.floats(0.4, 2.5), min_size=3, max_size=3), st.floats(0.01, 0.2))
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_curve_is_the_mixture_on_the_line(u: float, stretch: list[float], sigma: float) -> None:
    sizes = np.array([0.6, 0.55, 1.0]) * stretch
    sizes[:2] = np.sort(sizes[:2])[::-1]
    # far from equal sides, so that one order is certain
    sizes[0] = max(sizes[0], sizes[1] * 2.4)
    item = evidence(CHAIR, sizes, sigma=sigma)
    found = _curves([item], np.array([u, u + 1e-3]))[0, 0]
    expected = (1 - OUTLIER_PROBABILITY) * _density(CHAIR, np.log(sizes), u, (0, 1, 2), sigma) + OUTLIER_PROBABILITY
    assert found == pytest.approx(expected, rel=2e-3)


@pytest.mark.usefixtures("no_gross_errors")
def test_errors_that_go_together_are_in_the_density() -> None:
    sizes, sigma = np.array([1.4, 0.5, 1.1]), 0.15
    noise = sigma**2 * np.array([[1.0, 0.9, 0.5], [0.9, 1.0, 0.2], [0.5, 0.2, 1.0]])
    alone = evidence(CHAIR, sizes, sigma=sigma)
    item = replace(alone, object=replace(alone.object, covariance=noise))
    expected = 0.0
    for weight, mean, covariance in zip(CHAIR.weights, CHAIR.means, CHAIR.covariances, strict=True):
        spread = covariance + CHAIR.shared_covariance + noise
        expected += weight * multivariate_normal(mean, spread).pdf(np.log(1000 * sizes)) * LOG_BOX**3
    found = _curves([item], np.array([0.0, 1e-3]))[0, 0]
    assert found == pytest.approx((1 - OUTLIER_PROBABILITY) * expected + OUTLIER_PROBABILITY, rel=2e-3)


@pytest.mark.usefixtures("no_gross_errors")
def test_free_box_sums_all_orders() -> None:
    sizes = np.array([1.0, 0.6, 0.5])
    item = evidence(CHAIR, sizes, vertical_known=False)
    found = _curves([item], np.array([-0.05, 0.0]))[0, 1]
    total = sum(_density(CHAIR, np.log(sizes), 0.0, order, 0.03) for order in permutations(range(3)))
    assert found == pytest.approx((1 - OUTLIER_PROBABILITY) * total + OUTLIER_PROBABILITY, rel=2e-3)


@pytest.mark.usefixtures("no_gross_errors")
def test_lying_object_may_stand() -> None:
    book = prior("book.n.01", [(240, 170, 25)])
    standing = evidence(book, (0.17, 0.025, 0.24), pose="flat")
    found = _curves([standing], np.array([-0.02, 0.0]))[0, 1]
    # length stands up; width and height lie, in either order of the sorted sides
    total = VERTICAL["flat"][0] * (
        _density(book, np.log([0.17, 0.025, 0.24]), 0.0, (2, 0, 1), 0.03)
        + _density(book, np.log([0.17, 0.025, 0.24]), 0.0, (2, 1, 0), 0.03)
    )
    assert found == pytest.approx((1 - OUTLIER_PROBABILITY) * total + OUTLIER_PROBABILITY, rel=2e-3)
    upright = _curves([evidence(book, (0.17, 0.025, 0.24))], np.array([-0.02, 0.0]))[0, 1]
    assert upright < 2 * OUTLIER_PROBABILITY


@pytest.mark.usefixtures("no_gross_errors")
def test_a_pose_is_a_probability_and_any_pose_knows_no_vertical() -> None:
    assert all(sum(chances) == pytest.approx(1.0) for chances in VERTICAL.values())
    book = prior("book.n.01", [(240, 170, 25)])
    sizes = [(0.24, 0.17, 0.025), (0.17, 0.025, 0.24), (0.24, 0.025, 0.17)]
    u = np.linspace(-0.1, 0.1, 5)
    one, *others = (_curves([evidence(book, size, pose="any")], u)[0] for size in sizes)
    for other in others:
        assert other == pytest.approx(one, rel=1e-3)


def test_missing_dimension_is_marginalised() -> None:
    item = evidence(CHAIR, (math.nan, math.nan, 1.0))
    found = _curves([item], np.array([-0.01, 0.0]))[0, 1]
    total = 0.0
    for weight, mean, covariance in zip(CHAIR.weights, CHAIR.means, CHAIR.covariances, strict=True):
        sd = math.sqrt(covariance[2, 2] + CHAIR.shared_covariance[2, 2] + 0.03**2)
        z = (math.log(1000.0) - mean[2]) / sd
        total += weight * math.exp(-(z**2) / 2) / (sd * math.sqrt(2 * math.pi))
    assert found == pytest.approx((1 - OUTLIER_PROBABILITY) * total * LOG_BOX + OUTLIER_PROBABILITY, rel=2e-3)


def test_cut_side_is_rather_short_than_long() -> None:
    """A truncated height of 2 chairs is stronger evidence against a chair than half a chair."""
    u = np.linspace(-2, 2, 401)
    whole = _curves([evidence(CHAIR, (0.56, 0.54, 0.5), sigma=0.03)], u)[0]
    cut = _curves([evidence(CHAIR, (0.56, 0.54, 0.5), sigma=0.03, cut=(False, False, True))], u)[0]
    assert u[cut.argmax()] == pytest.approx(0.05, abs=0.08)  # length and width are right at scale one
    assert cut.max() > 2 * whole.max()
    tall = _curves([evidence(CHAIR, (0.56, 0.54, 2.0), sigma=0.03, cut=(False, False, True))], u)[0]
    assert tall.max() < cut.max() / 2


@given(
    st.sampled_from(["upright", "flat", "any"]),
    st.booleans(),
    st.lists(st.booleans(), min_size=3, max_size=3),
    st.lists(st.booleans(), min_size=3, max_size=3),
)
def test_variants_are_a_distribution(pose: str, vertical: bool, missing: list[bool], cut: list[bool]) -> None:
    if all(missing):
        missing = [False, *missing[1:]]
    layout = Layout(
        pose, vertical, False, (missing[0], missing[1], missing[2]), (cut[0], cut[1], cut[2]), (True,) * 3, False
    )
    ways = variants(layout)
    assert (ways.shift >= 0).all()
    assert np.array_equal(np.sort(ways.measured, axis=1), np.tile([0, 1, 2], (len(ways.measured), 1)))
    # the weights of the shifts of an assignment sum to its weight
    plain = variants(Layout(pose, vertical, False, layout.missing, (False,) * 3, (True,) * 3, bool(cut[0] or cut[1])))
    sums = [
        (
            np.exp(of.log_weight - math.log(LOG_BOX) * of.active.sum(axis=1)) * (1 + np.exp(of.log_gross).sum(axis=1))
        ).sum()
        for of in (ways, plain)
    ]
    assert sums[0] == pytest.approx(sums[1], rel=1e-9)


def test_one_gross_error_is_borne() -> None:
    """A chair with half its height keeps its scale by the other two sides; with two such sides it is an outlier."""
    u = np.linspace(-1.5, 1.5, 601)
    one = _curves([evidence(CHAIR, (0.56, 0.54, 0.48), sigma=0.02)], u)[0]
    assert abs(u[one.argmax()]) < 0.2  # a joint fit would say 0.4
    two = _curves([evidence(CHAIR, (1.4, 0.54, 0.48), sigma=0.02)], u)[0]
    assert two.max() < one.max() / 5


def test_shifts_sum_to_one() -> None:
    assert sum(weight for weight, *_ in TRUNCATION_MIXTURE) == pytest.approx(1)


def test_a_low_score_makes_an_outlier_likelier() -> None:
    clear = rows(measurement_arrays([evidence(CHAIR, (0.6, 0.5, 1.0))]))
    close = rows(measurement_arrays([evidence(CHAIR, (0.6, 0.5, 1.0), score=0.3)]))
    assert close.log_floor[0] > clear.log_floor[0]


def test_usable_dimensions_are_those_of_the_prior() -> None:
    keyboard = prior("keyboard.n.01", [(440, 150)], dims=("length", "width"))
    assert usable([evidence(keyboard, (0.4, math.nan, 0.03))]).tolist() == [[True, False, False]]
    sorted_prior = prior("stone.n.01", [(90, 60, 40)], dims=("extent1", "extent2", "extent3"))
    assert usable([evidence(sorted_prior, (0.09, 0.04, 0.06))]).all()
    assert usable([]).shape == (0, 3)


def test_sorted_prior_sorts_the_object() -> None:
    stone = prior("stone.n.01", [(90, 60, 40)], dims=("extent1", "extent2", "extent3"))
    u = np.linspace(-1, 1, 201)
    lying = _curves([evidence(stone, (0.09, 0.06, 0.04))], u)
    standing = _curves([evidence(stone, (0.06, 0.04, 0.09))], u)
    assert np.allclose(lying, standing)


def test_one_dimension_in_ten_may_have_a_gross_error() -> None:
    upright = Layout("upright", True, False, (False,) * 3, (False,) * 3, (True,) * 3, horizontal_close=False)
    table = variants(upright)
    assert np.exp(table.log_gross) == pytest.approx(0.1 / 0.7)
    assert np.exp(table.log_weight - 3 * math.log(LOG_BOX)) == pytest.approx(0.7)
    single = variants(replace(upright, modelled=(False, False, True)))
    assert np.isneginf(single.log_gross).all()  # a single dimension with a gross error is an outlier
    cut = variants(replace(upright, truncated=(False, True, False)))
    assert np.isneginf(cut.log_gross[cut.measured == 1]).all()


def test_a_truncated_side_has_its_length_or_is_too_short() -> None:
    """Six in ten have it within 15 %; the others are 30 % too short, within a factor of 2.2."""
    sides = variants(
        Layout("upright", True, False, (True, True, False), (False, False, True), (True,) * 3, horizontal_close=False)
    )
    active = sides.active[:, 2]
    weight = np.exp(sides.log_weight[active])
    rows = np.column_stack([weight / weight.sum(), sides.shift[active, 2], np.sqrt(sides.variance[active, 2])])
    assert np.unique(rows.round(9), axis=0) == pytest.approx(np.array([[0.4, 0.3, 0.8], [0.6, 0.05, 0.15]]))


@pytest.mark.parametrize(("score", "probability"), [(1.0, 0.1), (0.4, 0.64), (0.0, 0.991)])
def test_the_probability_of_an_outlier_by_its_score(score: float, probability: float) -> None:
    assert measurement_arrays([evidence(CHAIR, (0.6, 0.5, 1.0), score=score)]).outlier[0] == pytest.approx(probability)


@pytest.mark.parametrize(("log_ratio", "is_uncertain"), [(0.42, True), (0.43, False)])
def test_the_order_of_horizontal_sides_is_uncertain_within_three_standard_deviations(
    log_ratio: float, is_uncertain: bool
) -> None:
    """Each side has a standard deviation of 0.1, their difference one of 0.141."""
    item = evidence(CHAIR, (math.exp(log_ratio), 1.0, 1.0), sigma=0.1)
    assert bool(measurement_arrays([item]).code[0] & 1 << 6) == is_uncertain


def test_a_gross_error_has_a_standard_deviation_of_four_tenths() -> None:
    """The precision of a component with a gross error is the inverse of its covariance plus the variance 0.4^2."""
    components = rows(measurement_arrays([evidence(CHAIR, (0.56, 0.54, 0.48), sigma=0.02)]))
    covariances = np.linalg.inv(components.precision.transpose(2, 0, 1))
    plain = CHAIR.covariances[0] + CHAIR.shared_covariance + 0.02**2 * np.eye(3)
    wrong_height = plain + np.diag([0, 0, 0.4**2])
    assert np.abs(covariances - plain).max(axis=(1, 2)).min() < 1e-12
    found = np.flatnonzero(np.abs(covariances - wrong_height).max(axis=(1, 2)) < 1e-12)
    residual = CHAIR.means[0] - np.log([560, 540, 480])
    expected = math.log(0.9 * 0.1 * CHAIR.weights[0]) + 3 * math.log(LOG_BOX)
    expected += multivariate_normal(np.zeros(3), wrong_height).logpdf(residual)
    assert np.isclose(components.log_constant[found], expected).sum() == 1


def test_components_of_many_objects_are_computed_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Most components of an object with an unknown vertical are negligible, and are dropped after each block."""
    of = prior("a", [[1800, 900, 750], [1200, 600, 720]])
    generator = np.random.default_rng(1)
    sizes = np.sort(np.exp(generator.normal(0, 0.4, (400, 3))))[:, ::-1]
    objects = measurement_arrays([evidence(of, row, vertical_known=False) for row in sizes])
    results, peaks = [], []
    for block in (64, 400):
        monkeypatch.setattr(object_likelihood, "BLOCK_OBJECTS", block)
        rows(objects)  # fills the caches
        tracemalloc.start()
        results.append(rows(objects))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert all(np.array_equal(blocks, whole) for blocks, whole in zip(*results, strict=True))
    assert peaks[0] < 0.6 * peaks[1]


def test_inverse_and_determinant_of_packed_matrices() -> None:
    factors = np.random.default_rng(3).normal(size=(20, 3, 3))
    matrices = factors @ factors.transpose(0, 2, 1) + 0.1 * np.eye(3)
    found, log_det = inverse(matrices[:, ROWS, COLUMNS].T)
    assert found.transpose(2, 0, 1) == pytest.approx(np.linalg.inv(matrices))
    assert log_det == pytest.approx(np.linalg.slogdet(matrices)[1])
