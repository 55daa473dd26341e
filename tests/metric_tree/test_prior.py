"""The prior: density, marginals, quantiles, samples, and its row."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from metric_base.errors import InputError
from metric_tree.context import Context, ContextModel, Effect, Where
from metric_tree.prior import Prior, UnknownDimension, has_distinct_components
from metric_tree.tree import Tree
from tests.synthetic import minitree
from tests.synthetic.priors import prior as synthetic_prior

# Published values, written out so that a changed rule fails a test.
FLOOR_SD = 0.03

AXES = ("length", "width", "height")


def random_prior(seed: int, k: int = 3) -> Prior:
    generator = np.random.default_rng(seed)
    factors = generator.normal(0, 0.2, (k, 3, 3))
    shared = generator.normal(0, 0.1, (3, 3))
    return Prior(
        node_id="chair.n.01",
        dims=AXES,
        weights=generator.dirichlet(np.ones(k)),
        means=generator.normal(6.0, 0.5, (k, 3)),
        covariances=np.einsum("kij,klj->kil", factors, factors) + 0.03**2 * np.eye(3),
        shared_covariance=shared @ shared.T,
        n=40,
        n_sources=2,
        share_by_kind={"product": 0.75, "asset": 0.25},
        borrowed=0.1,
        heldout_log_density=-0.5,
    )


@given(seed=st.integers(0, 10_000), point=st.tuples(*[st.floats(5.0, 7.0)] * 2))
@settings(max_examples=15, deadline=None)
def test_marginal_density_is_the_joint_integrated(seed, point):
    prior = random_prior(seed)
    grid = np.linspace(1.0, 11.0, 6001)  # ln mm, far beyond every component
    joint = np.column_stack([np.full_like(grid, point[0]), grid, np.full_like(grid, point[1])])
    integrated = np.trapezoid(np.exp(prior.log_density(np.exp(joint))), grid)
    marginal = prior.marginal(("length", "height")).log_density(np.exp(np.array([point])))
    assert np.exp(marginal[0]) == pytest.approx(integrated, rel=1e-6, abs=1e-12)


def test_density_over_log_mm_integrates_to_one():
    grid = np.linspace(1.0, 11.0, 4001)
    one = random_prior(3).marginal(("width",))
    assert np.trapezoid(np.exp(one.log_density(np.exp(grid)[:, None])), grid) == pytest.approx(1, abs=1e-9)


@given(seed=st.integers(0, 10_000), q=st.floats(0.001, 0.999))
@settings(max_examples=25, deadline=None)
def test_quantile_inverts_the_distribution_function(seed, q):
    prior = random_prior(seed)
    for axis, size in zip(AXES, prior.quantile(q), strict=True):
        one = prior.marginal((axis,))
        grid = np.linspace(-2.0, np.log(size), 20_001)
        below = np.trapezoid(np.exp(one.log_density(np.exp(grid)[:, None])), grid)
        assert below == pytest.approx(q, abs=2e-5)


def test_interval_holds_its_level_of_samples():
    prior = random_prior(5)
    sizes, interval = prior.sample(20_000, seed=1), prior.interval(0.9)
    inside = ((sizes > interval[:, 0]) & (sizes < interval[:, 1])).mean(axis=0)
    assert inside == pytest.approx(np.full(3, 0.9), abs=0.01)


def test_sample_has_the_moments_of_the_mixture():
    prior = random_prior(7)
    logs = np.log(prior.sample(200_000, seed=2))
    mean = prior.weights @ prior.means
    offset = prior.means - mean
    covariance = np.einsum("k,kij->ij", prior.weights, prior.covariances + prior.shared_covariance)
    covariance += np.einsum("k,ki,kj->ij", prior.weights, offset, offset)
    assert logs.mean(axis=0) == pytest.approx(mean, abs=0.01)
    assert np.cov(logs.T) == pytest.approx(covariance, abs=0.01)


def test_sample_is_the_same_under_a_seed():
    prior = random_prior(7)
    assert np.array_equal(prior.sample(5, seed=3), prior.sample(5, seed=3))
    assert not np.array_equal(prior.sample(5, seed=3), prior.sample(5, seed=4))


def test_marginal_takes_the_order_given_and_names_what_exists():
    prior = random_prior(1)
    turned = prior.marginal(("height", "length"))
    assert turned.dims == ("height", "length")
    assert turned.quantile(0.5) == pytest.approx(prior.quantile(0.5)[[2, 0]])
    assert turned.heldout_log_density is None
    for wrong in (("depth",), (), ("length", "length")):
        with pytest.raises(UnknownDimension, match="length, width, height"):
            prior.marginal(wrong)
    with pytest.raises(KeyError):
        prior.marginal(("extent1",))


def test_row_and_back():
    prior = random_prior(9)
    again = Prior.of_row(prior.row() | {"share_by_kind": list(prior.share_by_kind.items())})
    sizes = prior.sample(10, seed=0)
    assert np.array_equal(again.log_density(sizes), prior.log_density(sizes))
    assert again.row() == prior.row()


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("family", "normal", "family: expected lognormal-mixture; found normal"),
        ("weights", [0.5, 0.1, 0.1], "weights: expected sum 1"),
        ("means", [[1.0, 2.0]], "means: expected shape"),
        ("shared_covariance", [[0.0]], "shared_covariance: expected shape"),
    ],
)
def test_a_damaged_row_is_told_in_one_line(field, value, message):
    with pytest.raises(InputError, match=message):
        Prior.of_row(random_prior(1).row() | {field: value})


@pytest.mark.parametrize("level", [0.0, 1.0, -1.0, float("nan")])
def test_levels_outside_zero_and_one_are_refused(level):
    with pytest.raises(InputError, match="between 0 and 1"):
        random_prior(1).interval(level)
    with pytest.raises(InputError, match="between 0 and 1"):
        random_prior(1).quantile(level)


@pytest.mark.parametrize("value", [float("nan"), 1e300])
def test_a_prior_of_no_size_is_refused(value: float, tmp_path: Path) -> None:
    content = minitree.rows()
    content["priors.parquet"][0]["means"] = [[value] * len(content["priors.parquet"][0]["dims"])]
    row = content["priors.parquet"][0]
    tree = Tree(minitree.release(tmp_path / "release", content))
    with pytest.raises(InputError, match="means"):
        tree.prior(row["node_id"], tuple(row["dims"]))


def test_the_error_that_a_scene_shares_has_a_floor_in_every_direction():
    prior = replace(random_prior(0), shared_covariance=np.diag([0.04, 0.0, 0.0001]))
    np.testing.assert_allclose(prior.disagreement(), np.diag([0.04, FLOOR_SD**2, FLOOR_SD**2]))
    unknown = replace(prior, shared_covariance=np.zeros((3, 3))).disagreement()
    assert np.all(np.linalg.eigvalsh(unknown) > FLOOR_SD**2)
    assert unknown[0, 1] > 0  # the axes of an object are wrong together


@pytest.mark.parametrize(
    ("ratio", "sd", "weight", "is_distinct"),
    [
        (1.52, 0.05, 0.5, True),
        (1.48, 0.05, 0.5, False),  # a ratio of the sizes below 1.5
        (2.0, 0.34, 0.5, True),  # Ashman's D of 2.04
        (2.0, 0.35, 0.5, False),  # 1.98
        (2.0, 0.05, 0.11, True),
        (2.0, 0.05, 0.09, False),  # a rare component
    ],
)
def test_components_are_distinct_by_size_separation_and_weight(ratio, sd, weight, is_distinct):
    prior = synthetic_prior("made", [[100.0] * 3, [100.0 * ratio] * 3])
    covariances = np.tile(sd**2 * np.ones((3, 3)), (2, 1, 1))
    prior = replace(prior, covariances=covariances, weights=np.array([weight, 1 - weight]))
    assert has_distinct_components(prior) == is_distinct


def test_the_error_of_sources_that_agree_is_eight_per_cent_together_and_five_alone() -> None:
    """In any direction it is at least 3 %; the tolerance of a norm is unchanged."""
    one = synthetic_prior("a", [[100.0, 200.0, 300.0]], shared=0.02)
    assert one.disagreement() == pytest.approx(0.08**2 + 0.05**2 * np.eye(3))
    wide = replace(one, shared_covariance=np.diag([0.04, 0.01, 0.0001]))
    assert wide.disagreement() == pytest.approx(np.diag([0.04, 0.01, 0.03**2]))
    assert replace(one, tier="norm").disagreement() is one.shared_covariance


@pytest.mark.parametrize(("log_mm", "is_valid"), [(22.9, True), (23.1, False), (-22.9, True), (-23.1, False)])
def test_a_mean_is_at_most_23_in_logarithms_of_millimetres(log_mm: float, is_valid: bool) -> None:
    prior = random_prior(1)
    means = prior.means.copy()
    means[0, 0] = log_mm
    with nullcontext() if is_valid else pytest.raises(InputError, match="means"):
        assert Prior.of_row(prior.row() | {"means": means.tolist()}).means[0, 0] == log_mm


@pytest.mark.parametrize(("offset", "note"), [(0.0045, "length unchanged"), (0.0056, "length +0.6%")])
def test_a_note_reports_changes_from_half_a_per_cent(offset: float, note: str, monkeypatch: pytest.MonkeyPatch) -> None:
    effect = Effect(np.full(1, offset), np.ones(1))
    monkeypatch.setattr("metric_tree.context.context_effect", lambda *_: effect)
    one = Context("a", "DE", 2011.0, np.zeros(1), np.ones(1))
    prior = replace(random_prior(1).marginal(("length",)), contexts=(one,))
    there = prior.in_context(Where("DE", 2011.0), ContextModel(0.2, 0.1, 0.1, 0.5, 12.0))
    assert there.note == f"DE, 2011: {note} against the plain prior"
    elsewhere = prior.in_context(Where("JP", None), ContextModel(0.2, 0.1, 0.1, 0.5, 12.0))
    assert elsewhere.note == "JP: nothing known, so that the plain prior holds; known: DE, 2011"


def test_a_row_whose_arrays_are_none_is_one_line() -> None:
    for change in ({"means": [[1.0], [2.0, 3.0]]}, {"share_by_kind": None}):
        with pytest.raises(InputError, match=r"chair\.n\.01: prior: expected arrays of numbers; found "):
            Prior.of_row(random_prior(1).row() | change)
