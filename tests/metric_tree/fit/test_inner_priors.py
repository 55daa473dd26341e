"""Priors of inner nodes: merged components keep the moments of the replaced ones."""

from __future__ import annotations

import numpy as np
import pytest

from metric_tree.fit.inner_priors import child_frequencies, inner_priors
from metric_tree.fit.mixture import Mixture, merge_costs, merged_moments, reduce_mixture
from tests.synthetic.priors import prior


def _mixture(k: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    halves = generator.normal(size=(k, 2, 2)) * 0.2
    return (
        generator.dirichlet(np.ones(k)),
        generator.normal(size=(k, 2)),
        halves @ halves.transpose(0, 2, 1) + 0.01 * np.eye(2),
    )


def _moments(weights: np.ndarray, means: np.ndarray, covariances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of a whole mixture."""
    total = weights.sum()
    mean = weights @ means / total
    about = means - mean
    second = np.einsum("k,kde->de", weights, covariances) + np.einsum("k,kd,ke->de", weights, about, about)
    return mean, second / total


def test_a_pair_keeps_the_moments_of_its_two() -> None:
    weights, means, covariances = _mixture(4)
    total, mean, covariance = merged_moments(weights, means, covariances, 1)
    for j in (0, 2, 3):
        both = [1, j]
        expected = _moments(weights[both], means[both], covariances[both])
        assert total[j] == pytest.approx(weights[both].sum())
        assert mean[j] == pytest.approx(expected[0])
        assert covariance[j] == pytest.approx(expected[1])


def test_the_cost_of_a_merge_is_runnalls_bound() -> None:
    """Runnalls (2007), equation 21: half of the increase of the log determinants; never with itself."""
    weights, means, covariances = _mixture(3)
    cost = merge_costs(weights, means, covariances, 0)
    assert np.isinf(cost[0])
    for j in (1, 2):
        both = [0, j]
        merged = _moments(weights[both], means[both], covariances[both])[1]
        parts = sum(weights[i] * np.log(np.linalg.det(covariances[i])) for i in both)
        assert cost[j] == pytest.approx(0.5 * (weights[both].sum() * np.log(np.linalg.det(merged)) - parts))


@pytest.mark.parametrize("components", [1, 2, 3])
def test_a_reduced_mixture_keeps_mean_and_covariance(components: int) -> None:
    weights, means, covariances = _mixture(6)
    reduced = reduce_mixture(Mixture(weights, means, covariances), components)
    assert len(reduced.weights) == components
    before, after = _moments(weights, means, covariances), _moments(reduced.weights, reduced.means, reduced.covariances)
    assert after[0] == pytest.approx(before[0])
    assert after[1] == pytest.approx(before[1])


def test_a_tenth_of_the_weight_is_equal_whatever_the_witnesses() -> None:
    counts = [{f"s{k}": 10_000 for k in range(9)}, {}]
    assert child_frequencies(counts, dict.fromkeys(counts[0], 1.0)) == pytest.approx([0.95, 0.05], abs=1e-3)


@pytest.mark.parametrize(("weight", "dims"), [(0.09, 1), (0.11, 2)])
def test_an_axis_has_a_prior_of_its_own_if_a_tenth_more_of_the_children_states_it(weight: float, dims: int) -> None:
    whole = prior("a", [[600.0, 500.0, 900.0]])
    single = whole.marginal(("height",))
    found = inner_priors("n", [[whole], [single]], np.array([1 - weight, weight]), whole.dims)
    assert [one.dims for one in found] == [whole.dims, ("height",)][:dims]
