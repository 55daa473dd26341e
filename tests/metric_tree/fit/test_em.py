"""EM against closed forms and brute force: moments, conditional means, densities, counts of parameters."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from metric_tree.fit import mixture as mixture_em
from metric_tree.fit.mixture import Mixture, NormalInverseWishart, Rows, complete_rows, fit_mixture, single_starts

SPREAD = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.02], [0.0, 0.02, 0.05]])
MEAN = np.array([6.0, 5.5, 7.0])
BELIEF = NormalInverseWishart(np.array([5.5, 5.5, 6.5]), 2.0, np.diag([0.1, 0.2, 0.3]), 5.0)
TWO = Mixture(
    np.array([0.3, 0.7]),
    np.array([[6.0, 5.5, 7.0], [5.0, 5.2, 6.0]]),
    np.stack([SPREAD, 0.5 * SPREAD]),
)


def _rows(x: np.ndarray, weights: np.ndarray | None = None) -> Rows:
    """Return rows with one candidate each."""
    return Rows(x, np.arange(len(x)), np.ones(len(x)) if weights is None else weights)


def _sample(n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).multivariate_normal(MEAN, SPREAD, n)


def test_one_component_is_the_posterior_mean_of_a_normal_inverse_wishart() -> None:
    x = _sample(40)
    fitted = fit_mixture(_rows(x), 1, BELIEF)
    mean = (2.0 * BELIEF.mean + x.sum(axis=0)) / 42.0
    about = x - BELIEF.mean
    scatter = about.T @ about - 42.0 * np.outer(mean - BELIEF.mean, mean - BELIEF.mean)
    assert fitted.mixture.means[0] == pytest.approx(mean)
    assert fitted.mixture.covariances[0] == pytest.approx((5.0 * BELIEF.covariance + scatter) / 45.0)
    assert fitted.mixture.weights == pytest.approx([1.0])


def test_weights_count_as_rows() -> None:
    x = _sample(12)
    twice = fit_mixture(_rows(np.concatenate([x, x])), 1, BELIEF).mixture
    uniform = fit_mixture(_rows(np.concatenate([x, x]), np.full(24, 7.0)), 1, BELIEF).mixture
    assert twice.means == pytest.approx(uniform.means)
    assert twice.covariances == pytest.approx(uniform.covariances)


def test_kish_counts_effective_rows() -> None:
    assert _rows(np.zeros((3, 1)), np.array([1.0, 2.0, 3.0])).effective_size == pytest.approx(36 / 14)
    assert _rows(np.zeros((0, 1))).effective_size == 0.0


@pytest.mark.parametrize(("components", "parameters"), [(1, 9), (2, 19)])
def test_parameters_are_counted(components: int, parameters: int) -> None:
    """k means of 3, k covariances of 6, and k - 1 free weights."""
    fitted = fit_mixture(_rows(_sample(60)), components, BELIEF)
    assert fitted.parameters == parameters
    assert fitted.bic(50.0) == pytest.approx(parameters * math.log(50.0) - 2 * fitted.log_likelihood)


def _density(point: np.ndarray, mixture: Mixture) -> np.ndarray:
    """w_k N(x_obs) of each component, by SciPy."""
    seen = np.flatnonzero(~np.isnan(point))
    return np.array([
        weight * multivariate_normal(mean[seen], cov[np.ix_(seen, seen)]).pdf(point[seen])
        for weight, mean, cov in zip(mixture.weights, mixture.means, mixture.covariances, strict=True)
    ])  # fmt: skip


def test_densities_and_responsibilities_with_blanks_and_hidden_order() -> None:
    """Row 0 is complete, row 1 lacks an axis, row 2 has two candidate orders."""
    x = np.array([[6.1, 5.4, 6.9], [np.nan, 5.3, 6.2], [6.0, 5.0, 7.0], [5.0, 6.0, 7.0]])
    rows = Rows(x, np.array([0, 1, 2, 2]), np.ones(3))
    responsibility, log_density = mixture_em.expectation(rows, TWO)
    plain = np.array([_density(point, TWO) for point in x])
    row_density = np.array([plain[0].sum(), plain[1].sum(), plain[2:].sum() / 2])
    assert log_density == pytest.approx(np.log(row_density))
    expected = plain / np.array([row_density[0], row_density[1], 2 * row_density[2], 2 * row_density[2]])[:, None]
    assert responsibility == pytest.approx(expected)


def test_a_blank_is_completed_by_its_conditional_mean() -> None:
    single = Mixture(np.ones(1), MEAN[None], SPREAD[None])
    x, known = complete_rows(_rows(np.array([[np.nan, 5.9, 6.8]])), single)
    gain = SPREAD[0, 1:] @ np.linalg.inv(SPREAD[1:, 1:])
    assert x[0] == pytest.approx([MEAN[0] + gain @ (np.array([5.9, 6.8]) - MEAN[1:]), 5.9, 6.8])
    assert known[0] == pytest.approx([0, 1, 1])


def test_one_step_with_blanks_adds_the_conditional_covariance() -> None:
    """The maximisation of Ghahramani and Jordan, written out for one component and one blank axis."""
    x = np.array([[6.2, 5.1], [6.0, np.nan], [5.7, 5.6]])
    mean, cov = np.array([6.0, 5.4]), np.array([[0.05, 0.02], [0.02, 0.08]])
    belief = NormalInverseWishart(np.array([5.9, 5.3]), 1.5, np.diag([0.1, 0.1]), 3.0)
    rows = _rows(x)
    made = mixture_em.maximisation(rows, Mixture(np.ones(1), mean[None], cov[None]), np.ones((3, 1)), belief)
    gain = cov[1, 0] / cov[0, 0]
    full = x.copy()
    full[1, 1] = mean[1] + gain * (x[1, 0] - mean[0])
    rest = np.diag([0.0, cov[1, 1] - gain * cov[0, 1]])
    new = (1.5 * belief.mean + full.sum(axis=0)) / 4.5
    about = full - belief.mean
    scatter = about.T @ about + rest - 4.5 * np.outer(new - belief.mean, new - belief.mean)
    assert made.means[0] == pytest.approx(new)
    assert made.covariances[0] == pytest.approx((3.0 * belief.covariance + scatter) / 6.0)


@given(st.integers(0, 2**32 - 1), st.floats(0.001, 0.5))
def test_the_floor_raises_only_what_is_below_it(seed: int, floor: float) -> None:
    half = np.random.default_rng(seed).normal(size=(3, 3)) * 0.2
    covariance = half @ half.T
    raised = mixture_em.raise_to_floor(covariance, floor)
    before, after = np.linalg.eigvalsh(covariance), np.linalg.eigvalsh(raised)
    assert after == pytest.approx(np.maximum(before, floor**2), rel=1e-6, abs=1e-12)
    assert raised == pytest.approx(raised.T)


def test_rows_are_taken_and_moved_whole() -> None:
    x = np.arange(10.0).reshape(5, 2)
    rows = Rows(x, np.array([0, 0, 1, 2, 2]), np.array([1.0, 2.0, 3.0]))
    some = rows.subset(np.array([0, 2]))
    assert some.x.tolist() == x[[0, 1, 3, 4]].tolist()
    assert some.owner.tolist() == [0, 0, 1, 1]
    assert some.weights.tolist() == [1.0, 3.0]
    moved = rows.shift(np.array([[1.0, 0.0], [0.0, 1.0], [2.0, 2.0]]))
    assert moved.x.tolist() == (x - [[1, 0], [1, 0], [0, 1], [2, 2], [2, 2]]).tolist()
    assert rows.starts.tolist() == [0, 2, 3]
    assert rows.candidates.tolist() == [2, 1, 2]


def test_patterns_part_the_candidates_by_what_is_missing() -> None:
    x = np.array([[1.0, np.nan], [1.0, 2.0], [np.nan, 2.0], [3.0, np.nan]])
    patterns = {tuple(axes): (index.tolist(), missing.tolist()) for index, axes, missing, *_ in _rows(x).patterns}
    assert patterns == {(0,): ([0, 3], [1]), (0, 1): ([1], []), (1,): ([2], [0])}


@pytest.mark.parametrize("seed", range(5))
def test_seeds_part_all_rows_by_the_nearest(seed: int) -> None:
    x = np.concatenate([_sample(10, seed), _sample(10, seed + 1) + 50.0])
    part = mixture_em.nearest_seed(x, np.ones(20), 2, np.random.default_rng(seed))
    assert set(part.tolist()) == {0, 1}
    assert len(set(part[:10].tolist())) == 1  # k-means++ picks its second seed far from the first
    assert part[0] != part[10]


@pytest.mark.parametrize(("mean_rows", "count"), [(0.9, 3), (1.0, 1)])
def test_a_prior_with_the_weight_of_a_row_determines_the_axes(mean_rows: float, count: int) -> None:
    """Two rows with two candidates each: else each rank of candidate is a start, too."""
    x = np.array([[6.0, 5.0], [5.0, 6.0], [6.1, 5.1], [5.1, 6.1]])
    rows = Rows(x, np.array([0, 0, 1, 1]), np.ones(2))
    assert len(single_starts(rows, NormalInverseWishart(np.zeros(2), mean_rows, np.eye(2), 8.0))) == count


def test_a_mixture_starts_from_parts_along_the_main_axis(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three groups are found in a step; a start from all rows but those of a group would need many."""
    for name in ("STARTS", "SHORT_RUN", "ITERATIONS"):
        monkeypatch.setattr(mixture_em, name, 1)
    x = (np.repeat([0.0, 1.0, 10.0], 5) + 0.01 * np.tile(np.arange(-2, 3), 3))[:, None]
    belief = NormalInverseWishart(np.ones(1), 0.01, np.full((1, 1), 0.001), 8.0)
    means = fit_mixture(Rows(x, np.arange(15), np.ones(15)), 3, belief).mixture.means
    assert sorted(means[:, 0].tolist()) == pytest.approx([0.0, 1.0, 10.0], abs=0.02)
