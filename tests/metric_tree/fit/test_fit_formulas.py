"""The formulas of the fit against slow versions: moments, likelihoods, ridge, contexts, weights, ranges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from metric_tree.context import Context
from metric_tree.fit import class_prior, contexts, evidence_model, intraclass_correlation, moments
from metric_tree.fit.evidence_model import EvidenceModel
from metric_tree.fit.inner_priors import child_frequencies, plain_name_weights
from metric_tree.fit.mixture import Fitted, Mixture, NormalInverseWishart, Rows, single_starts
from metric_tree.fit.random_effects import (
    between_covariance,
    no_source_means,
    source_means,
    with_min_eigenvalue,
    with_statements,
)
from metric_tree.fit.rows import (
    ClassRows,
    Statements,
    class_belief,
    nanmean,
    statements_of,
    take_rows,
    weighted_rows,
    within_range,
    without_museums,
)
from metric_tree.prior import Prior

# Published values, written out so that a changed rule fails a test.
BIAS_SD = {"product": 0.05, "asset": 0.3, "museum": 0.3, "judged": 0.2, "default": 0.3}
CERTAIN_ROWS = 1000000.0
MEAN_HALF_ROWS = 5.0
MIN_LOG_SD = 0.005
MIN_WITHIN_SD = 0.01
MIXED_SD = 1.0
MIXED_SHARE = 0.05
STATED_ROWS = 20.0
STATED_SHARED = 0.35

NAN = np.nan
NO_AXES = np.zeros(3, dtype=bool)


def test_a_matrix_is_made_positive_along_its_axes() -> None:
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    raised = with_min_eigenvalue(turn @ np.diag([2.0, -1.0]) @ turn.T, 0.1)
    assert raised == pytest.approx(turn @ np.diag([2.0, 0.1]) @ turn.T)


def test_moments_of_source_means_by_their_formula() -> None:
    means = np.array([[1.0, 2.0], [1.4, 2.3], [0.7, NAN], [5.0, 5.0]])
    rows = np.array([[4.0, 9.0], [9.0, 4.0], [16.0, 0.0], [50.0, 50.0]])
    trust = np.array([1.0, 1.0, 1.0, 0.0])
    within = np.array([[0.01, 0.002], [0.002, 0.02]])
    found = np.zeros((2, 2))
    for i, j, own in ((0, 0, [0, 1, 2]), (0, 1, [0, 1]), (1, 1, [0, 1])):
        n = np.sqrt(rows[own, i] * rows[own, j])
        a = n / (1 + n / MEAN_HALF_ROWS)
        one, two = (means[own, k] - (a * means[own, k]).sum() / a.sum() for k in (i, j))
        noise = within[i, j] * ((a - a**2 / a.sum()) / n).sum()
        found[i, j] = found[j, i] = ((a * one * two).sum() - noise) / (a.sum() - (a**2).sum() / a.sum())
    assert between_covariance(means, rows, trust, within) == pytest.approx(with_min_eigenvalue(found, 0.0))
    assert between_covariance(means[:1], rows[:1], trust[:1], within).tolist() == [[0, 0], [0, 0]]


def test_the_means_rows_and_spreads_of_sources() -> None:
    """Nine rows of one source by weight, one of another that does not state the second axis."""
    generator = np.random.default_rng(0)
    x = np.concatenate([generator.normal([2.0, 3.0], [0.1, 0.2], (9, 2)), [[2.5, 3.1]]])
    known = np.ones((10, 2))
    known[9, 1] = 0.0
    weights = np.array([1.0] * 8 + [0.5, 2.0])
    one = source_means(x, known, weights, ["a"] * 9 + ["b"], ["product"] * 9 + ["museum"], np.diag([0.04, 0.04]))
    own = np.array([1.0] * 8 + [0.5])
    assert one.means[0] == pytest.approx(own @ x[:9] / 8.5)
    assert one.means[1] == pytest.approx([2.5, NAN], nan_ok=True)
    assert one.rows == pytest.approx(np.array([[8.5**2 / 8.25] * 2, [1.0, 0.0]]))
    assert (one.sources, one.kinds, one.freedom) == (("a", "b"), ("product", "museum"), 0.0)
    rows = 8.5**2 / 8.25
    variance = own @ (x[:9] - one.means[0]) ** 2 / 8.5 * rows / (rows - 1)
    assert one.spreads == pytest.approx([np.sqrt(variance.mean()), NAN], nan_ok=True)
    offset = x[:9] - one.means[0]
    scatter = (own[:, None] * offset).T @ offset  # a single row equals its mean
    typical = (weights**2).sum() / weights.sum()
    free = np.array([[8.5 * (1 - 1 / rows)] * 2] * 2)
    within = (scatter + typical * np.diag([0.04, 0.04])) / (free + typical)
    assert one.within == pytest.approx(with_min_eigenvalue(within, MIN_WITHIN_SD**2))
    few = source_means(x[:7], known[:7], weights[:7], ["a"] * 7, ["product"] * 7, np.eye(2))
    assert np.isnan(few.spreads).all()
    stated = with_statements(
        one, Statements(("n",), ("statistic",), np.array([[2.2, NAN]]), np.full((1, 2), NAN), NO_AXES)
    )
    assert stated.rows[-1].tolist() == [CERTAIN_ROWS, 0.0]
    assert (stated.sources, stated.kinds, stated.freedom) == (("a", "b", "n"), ("product", "museum", "statistic"), 1.0)
    assert stated.between[0, 0] > 0
    assert with_statements(one, Statements((), (), np.empty((0, 2)), np.empty((0, 2)), NO_AXES)) is one
    none = no_source_means(np.eye(2))
    assert (none.within.tolist(), none.between.tolist(), none.means.shape) == (
        np.eye(2).tolist(),
        [[0, 0], [0, 0]],
        (0, 2),
    )


def test_a_model_of_kinds_says_biases_errors_and_covariances() -> None:
    model = EvidenceModel(
        share=0.4, spread=0.1, excess={"asset": 0.2, "statistic": 0.03}, bias={"asset": -0.1},
        family_bias={"asset f": 0.04}, family={"f": 2.0},
    )  # fmt: skip
    assert model.bias_of("asset", "f") == pytest.approx(-0.06)
    assert (model.bias_of("asset", "g"), model.bias_of("product", "f")) == pytest.approx((-0.1, 0.0))
    wrong = MIXED_SHARE * MIXED_SD**2
    assert model.error_sd("asset") == pytest.approx(np.sqrt(0.04 + wrong))
    assert model.error_sd("museum") == pytest.approx(np.sqrt(wrong))
    assert (model.error_sd("statistic"), model.error_sd("product")) == pytest.approx((0.03, 0.0))
    within = np.array([[0.04, 0.01], [0.01, 0.09]])
    assert model.between(within) == pytest.approx(0.4 * within + 0.01 * np.array([[1, 0.5], [0.5, 1]]))
    assert model.between(within, "f") == pytest.approx(2 * model.between(within))
    other = EvidenceModel(
        share=0.1, spread=0.4, excess={"asset": 0.8}, bias={"asset": 0.1, "museum": 0.2}, family={"g": 0.5}
    )
    mixed = model.towards(other, 0.5)
    assert (mixed.share, mixed.spread) == pytest.approx((0.2, 0.2))
    assert mixed.excess == pytest.approx({"asset": 0.4, "statistic": np.sqrt(0.03 * MIN_LOG_SD)})
    assert mixed.bias == pytest.approx({"asset": 0.0, "museum": 0.2})
    assert mixed.family == pytest.approx({"f": np.sqrt(2.0), "g": 0.5})
    assert mixed.family_bias == pytest.approx({"asset f": 0.02})
    assert model.towards(other, 1.0).share == pytest.approx(0.4)
    assert replace(model, share=0.123456).record()["share"] == 0.1235
    assert EvidenceModel(**model.record()) == model


def test_a_restricted_likelihood_is_that_of_differences() -> None:
    """Integrated over the class mean under a flat prior, up to the constants of 2 pi."""
    means, variances = np.array([[0.1, 0.4, -0.3]]), np.array([[0.02, 0.05, 0.1]])
    present = np.array([[1.0, 1.0, 0.0]])
    mu = np.linspace(-3, 4, 200_001)
    dense = np.exp(
        sum(-0.5 * (np.log(v) + (m - mu) ** 2 / v) for m, v in zip(means[0, :2], variances[0, :2], strict=True))
    )
    whole = np.log(dense.sum() * (mu[1] - mu[0]) / np.sqrt(2 * np.pi))
    assert evidence_model.restricted_likelihood(means, variances, present)[0] == pytest.approx(whole, abs=1e-6)
    plain, mixed = evidence_model.sense_likelihoods(means, variances, present)
    assert plain[0] == pytest.approx(whole + np.log(1 - MIXED_SHARE), abs=1e-6)
    wide = evidence_model.restricted_likelihood(means, variances + MIXED_SD**2, present)
    assert mixed == pytest.approx(wide + np.log(MIXED_SHARE))


def _table() -> evidence_model.SourceTable:
    generator = np.random.default_rng(3)
    lines, names = 40, ["product", "asset", "measured"]
    kind = np.tile([0, 1, 2, 0], (lines, 1))
    family = np.arange(lines) % 2
    mu = generator.normal(6, 1, lines)
    means = mu[:, None] + np.where(kind == 1, 0.2 + 0.1 * family[:, None], 0.0) + generator.normal(0, 0.02, (lines, 4))
    present = np.ones((lines, 4))
    present[::5, 3] = 0.0
    within = np.full(lines, 0.01)
    noise = np.full((lines, 4), 0.0004)
    return evidence_model.SourceTable(means, noise, present, within, kind, family, names, ["f", "g"])


def test_biases_are_the_ridge_regression_with_class_means_out() -> None:
    table = _table()
    start = EvidenceModel(share=0.3, spread=0.02, excess={})
    model = evidence_model.with_biases(start, table)
    assert model.bias["asset"] == pytest.approx(0.25, abs=0.05)
    assert model.bias_of("asset", "g") - model.bias_of("asset", "f") == pytest.approx(0.1, abs=0.03)
    assert abs(model.bias["product"]) < 0.03
    assert "measured" not in model.bias
    variances = table.variances(start)
    assert variances == pytest.approx(0.3 * 0.01 + 0.02**2 + 0.0004)
    excess = table.variances(replace(start, excess={"asset": 0.1}, family={"g": 3.0}))
    assert excess[0] == pytest.approx([0.0038, 0.0138, 0.0038, 0.0038])
    assert excess[1, 0] == pytest.approx(3 * 0.0034 + 0.0004)
    offsets = table.biases(model)
    assert offsets[1] == pytest.approx([model.bias_of(table.kinds[k], "g") for k in table.kind[1]])

    # the normal equations hold: the penalty's slope is that of the weighted squares
    def height(one: EvidenceModel) -> float:
        means = table.means - table.biases(one)
        weight = table.present / variances
        mu = (weight * means).sum(axis=1) / weight.sum(axis=1)
        prior = sum((value / BIAS_SD[key]) ** 2 for key, value in one.bias.items())
        prior += sum((value / (BIAS_SD[key.split()[0]] / 2)) ** 2 for key, value in one.family_bias.items())
        return float((trust[:, None] * weight * (means - mu[:, None]) ** 2).sum() + prior)

    plain, mixed = evidence_model.sense_likelihoods(table.means, variances, table.present)
    trust = 1 / (1 + np.exp(mixed - plain))
    best = height(model)
    for step in (-0.01, 0.01):
        for key in model.bias:
            assert height(replace(model, bias={**model.bias, key: model.bias[key] + step})) > best
        for key in model.family_bias:
            assert height(replace(model, family_bias={**model.family_bias, key: model.family_bias[key] + step})) > best


def test_ratios_of_spread_lean_on_ten_classes_of_no_difference() -> None:
    one = no_source_means(np.eye(1))
    known = replace(
        one, sources=("a", "b", "c", "d"), kinds=("product", "measured", "asset", "museum"),
        spreads=np.array([0.1, 0.4, 0.4, NAN]),
    )  # fmt: skip
    ratios = evidence_model.spread_ratios([known, known, one])
    assert ratios == pytest.approx({"asset": 2 * np.log(0.4 / 0.2) / 12, "museum": 0.0})


def test_sameness_by_the_mean_squares() -> None:
    generator = np.random.default_rng(0)
    rooms = np.repeat(np.arange(30), 3)[:-1]
    x = generator.normal(0, 0.1, 30)[rooms] + generator.normal(0, 0.1, 89)
    one = intraclass_correlation.axis_correlation(np.append(x, NAN), np.append(rooms, 99).astype(str))
    assert one is not None
    counts = np.bincount(rooms)
    means = np.bincount(rooms, x) / counts
    msb = (counts * (means - x.mean()) ** 2).sum() / 29
    msw = ((x - means[rooms]) ** 2).sum() / (89 - 30)
    n0 = (89 - (counts**2).sum() / 89) / 29
    share = (msb - msw) / (msb + (n0 - 1) * msw)
    assert one.value == pytest.approx(share, rel=1e-9)
    variance = 2 * 88 * (1 - share) ** 2 * (1 + (n0 - 1) * share) ** 2 / (n0**2 * 59 * 29)
    assert one.sd == pytest.approx(np.sqrt(variance))
    few = intraclass_correlation.axis_correlation(np.zeros(14), np.repeat(np.arange(7), 2).astype(str))
    assert few is None


def test_classes_shrink_by_how_much_they_differ() -> None:
    classes = {
        "a": intraclass_correlation.IntraclassCorrelation(0.2, 0.1),
        "b": intraclass_correlation.IntraclassCorrelation(0.6, 0.2),
        "c": intraclass_correlation.IntraclassCorrelation(0.9, 0.05),
    }
    shrunk, other = intraclass_correlation.shrunk_correlations(classes)
    share, variance = np.array([0.2, 0.6, 0.9]), np.array([0.01, 0.04, 0.0025])
    weight = 1 / variance
    mean = (weight * share).sum() / weight.sum()
    between = ((weight * (share - mean) ** 2).sum() - 2) / (weight.sum() - (weight**2).sum() / weight.sum())
    weight = 1 / (variance + between)
    mean = (weight * share).sum() / weight.sum()
    assert other.value == pytest.approx(mean)
    assert other.sd == pytest.approx(np.sqrt(between + 1 / weight.sum()))
    for one, own, var in zip("abc", share, variance, strict=True):
        assert shrunk[one].value == pytest.approx((own / var + mean / between) / (1 / var + 1 / between))
        assert shrunk[one].sd == pytest.approx(np.sqrt(1 / (1 / var + 1 / between)))
    assert intraclass_correlation.shrunk_correlations({"a": classes["a"], "b": classes["b"]})[0] == {}


def _context(
    source: str, offset: list[float], variance: list[float], region: str | None = "DE", year: float | None = 2001.0
) -> Context:
    return Context(source, region, year, np.array(offset), np.array(variance))


def test_contexts_of_children_by_their_weight_and_what_they_leave_out() -> None:
    shared = np.array([0.04, 0.09])
    own = [(0.3, _context("s", [0.1, NAN], [0.01, NAN])), (0.5, _context("s", [0.3, 0.2], [0.02, 0.03], year=2004.0))]
    one = contexts.combined_context(own, shared)
    assert one is not None
    assert one.offset == pytest.approx([(0.3 * 0.1 + 0.5 * 0.3) / 0.8, 0.2])
    assert one.variance == pytest.approx(
        [(0.09 * 0.01 + 0.25 * 0.02) / 0.64 + 0.2 / 0.8 * 0.04, 0.03 + 0.5 / 0.5 * 0.09], abs=1e-6
    )
    assert one.year == pytest.approx((0.3 * 2001 + 0.5 * 2004) / 0.8)
    assert (one.source, one.region) == ("s", "DE")
    assert contexts.combined_context([(0.19, own[0][1])], shared) is None
    thin = contexts.combined_context([(0.2, own[0][1]), (0.1, _context("s", [NAN, 0.2], [NAN, 0.1]))], shared)
    assert thin is not None
    assert np.isnan(thin.offset[1])
    assert thin.offset[0] == pytest.approx(0.1)
    children = [
        _prior((_context("s", [0.1], [0.01], year=2004.0), _context("t", [0.2], [0.01], None, None))),
        _prior((_context("s", [0.3], [0.01], year=2005.0),)),
    ]
    groups = contexts.inner_contexts(children, np.array([0.5, 0.5]), shared[:1])
    assert [(one.source, one.region, one.year) for one in groups] == [
        ("s", "DE", 2004),
        ("s", "DE", 2005),
        ("t", None, None),
    ]
    rounded = contexts.combined_context([(1.0, _context("s", [0.1234567, NAN], [0.0, 0.0]))], shared)
    assert rounded is not None
    assert (rounded.offset[0], rounded.variance[0]) == pytest.approx((0.12346, 1e-6), rel=1e-9)
    assert np.isnan(rounded.variance[1])


def _prior(some: tuple[Context, ...]) -> Prior:
    one = np.array([[0.01]])
    return Prior(
        "a", ("length",), np.ones(1), np.zeros((1, 1)), one[None], one, 9, 3, {"product": 1.0}, 0.0, contexts=some
    )


def test_how_common_children_are_by_their_witnesses() -> None:
    counts = [{"shop": 30, "rooms": 90}, {"shop": 70, "rooms": 10}, {}]
    trust = {"shop": 0.5, "rooms": 1.0}
    weight = np.array([1.0 * 100 / 110, 0.5 * 100 / 110])
    shares = np.array([[0.9, 0.3], [0.1, 0.7], [0.0, 0.0]]) @ weight / weight.sum()
    alike = max(0.1, 0.5 / (0.5 + weight.sum()))
    assert child_frequencies(counts, trust) == pytest.approx(alike / 3 + (1 - alike) * shares)
    assert child_frequencies(counts, trust, np.array([1.0, 0.0, 1.0])) == pytest.approx(
        alike * np.array([0.5, 0, 0.5]) + (1 - alike) * shares
    )
    assert child_frequencies([{}, {}], trust).tolist() == [0.5, 0.5]
    common = np.array([0.5, 0.3, 0.2])
    children = ["a.n.01/other", "b.n.01", "c.n.01"]
    assert plain_name_weights("a.n.01", children, common) == pytest.approx([0.8, 0.2 * 0.6, 0.2 * 0.4])
    assert plain_name_weights("a.n.01", children, np.array([0.9, 0.06, 0.04])) == pytest.approx([0.9, 0.06, 0.04])
    assert plain_name_weights("a.n.01", children, common, {"b.n.01": 2.0, "c.n.01": 6.0}) == pytest.approx(
        [0, 0.25, 0.75]
    )
    assert plain_name_weights("a.n.01", children, common, None, [False, False, True]) == pytest.approx([0.8, 0.0, 0.2])
    assert plain_name_weights("a.n.01", ["a_seat.n.01", "b.n.01", "c.n.01"], common) == pytest.approx([0, 0.6, 0.4])
    assert plain_name_weights("a.n.01", ["b.n.01", "c.n.01"], common[1:]) == pytest.approx(common[1:])


def _rows(
    kind: list[str], values: list[list[float]], sd: float | np.ndarray = NAN, owner: list[int] | None = None
) -> ClassRows:
    count = len(kind)
    return ClassRows(
        "a", ("length", "width", "height"), np.array(values), np.array(owner or range(len(values))),
        tuple(f"s{k % 2}" for k in range(count)), tuple(kind), np.full((count, 3), sd), count,
    )  # fmt: skip


def test_rows_are_taken_with_their_candidates() -> None:
    rows = _rows(["product", "museum", "asset"], [[1, 2, 3], [4, 5, 6], [5, 4, 6], [7, NAN, NAN]], owner=[0, 1, 1, 2])
    some = take_rows(rows, np.array([1, 2]))
    assert (some.owner.tolist(), some.x[:, 0].tolist()) == ([0, 0, 1], [4, 5, 7])
    assert (some.sources, some.kinds, some.n) == (("s1", "s0"), ("museum", "asset"), 3)
    assert without_museums(rows).kinds == ("product", "asset")
    assert without_museums(take_rows(rows, np.array([1, 2]))).kinds == ("museum", "asset")
    assert not rows.is_stated
    judged = _rows(["product", "judged"], [[1, 2, 3], [4, 5, 6]], 0.2)
    kept, sources, kind = weighted_rows(judged)
    assert (sources, kind, len(kept.x)) == (["s0"], ["product"], 1)
    assert _rows(["judged", "norm"], [[1, 2, 3], [4, 5, 6]]).is_stated


def test_what_ranges_state_source_by_source() -> None:
    rows = _rows(
        ["judged", "product", "judged", "statistic"], [[1, 2, NAN], [9, 9, 9], [3, NAN, NAN], [5, 5, 5]], sd=0.2
    )
    stated = statements_of(rows)
    assert (stated.names, stated.kinds) == (("s0", "s1"), ("judged", "statistic"))
    np.testing.assert_allclose(stated.means, [[2, 2, NAN], [5, 5, 5]])
    assert stated.spread == pytest.approx([0.2] * 3)
    hidden = _rows(["judged", "judged"], [[1, 2, NAN], [2, 1, NAN], [3, 3, 3]], 0.2, owner=[0, 0, 1])
    assert statements_of(hidden).means == pytest.approx(np.array([[3, 3, 3]]))
    assert nanmean(np.array([[1.0, NAN, 2.0], [3.0, NAN, NAN]])) == pytest.approx([2, NAN, 2], nan_ok=True)
    belief = NormalInverseWishart(np.zeros(3), 2.0, np.diag([0.04, 0.09, 0.01]), 8.0)
    own = class_belief(belief, stated)
    assert own.mean == pytest.approx([3.5, 3.5, 5])
    assert own.mean_rows == pytest.approx(max(2.0, (1 - STATED_SHARED) / STATED_SHARED))
    assert np.diagonal(own.covariance) == pytest.approx([(1 - STATED_SHARED) * 0.04] * 3)
    assert own.covariance_rows == STATED_ROWS
    height = _rows(["judged", "product"], [[NAN, NAN, 3], [1, 2, NAN]], sd=np.array([NAN, NAN, 0.2]))
    lone = class_belief(belief, statements_of(height))
    assert lone.covariance_rows == belief.covariance_rows
    assert np.diagonal(lone.covariance) == pytest.approx([0.04, 0.09, (1 - STATED_SHARED) * 0.04])
    bounded = within_range(np.diag([0.04, 0.001, 0.02]), stated)
    assert np.diagonal(bounded) == pytest.approx([STATED_SHARED * 0.04, 0.001, STATED_SHARED * 0.04])


def test_a_fit_starts_at_the_belief_and_at_each_rank_of_candidates() -> None:
    x = np.array([[1.0, 2.0], [2.0, 1.0], [3.0, NAN], [5.0, NAN]])
    hidden = Rows(x, np.array([0, 0, 1, 2]), np.array([1.0, 2.0, 1.0]))
    unsure = NormalInverseWishart(np.array([9.0, 8.0]), 0.1, np.eye(2), 8.0)
    belief, first, second = (start.means[0].tolist() for start in single_starts(hidden, unsure))
    assert (belief, first) == ([9, 8], pytest.approx([(1 + 2 * 3 + 5) / 4, 2.0]))
    assert second == pytest.approx([(2 + 2 * 3 + 5) / 4, 1.0])
    plain = Rows(x[2:], np.array([0, 1]), np.ones(2))
    assert len(single_starts(plain, unsure)) == 1
    assert len(single_starts(hidden, replace(unsure, mean_rows=5.0))) == 1


def test_a_stated_range_stands_for_ten_whole_rows() -> None:
    rows = _rows(["product", "museum"], [[1, 2, 3], [4, 5, 6]])
    ranged = replace(rows, range_sd=np.full((2, 3), 0.1))
    assert rows.weights[1] / ranged.weights[1] == pytest.approx((3 + 11) / (3 + 1))
    assert rows.weights[0] == ranged.weights[0]


def test_sizes_beyond_three_robust_deviations_are_clipped_before_a_correlation() -> None:
    """Ten rooms with two equal objects each; the outlier is clipped to 3 times 0.02, the minimum deviation."""
    rooms = np.repeat(np.arange(10), 2).astype(str)
    near, far = (np.r_[np.zeros(18), size, 0.0] for size in (3 * 0.02, 5.0))
    one, other = (intraclass_correlation.axis_correlation(x, rooms) for x in (near, far))
    assert one == other
    x = np.repeat([-0.1, 0.1], 10) + np.r_[np.zeros(19), 3 * 1.4826 * 0.1 - 0.1]
    limited, beyond = x.copy(), x.copy()
    beyond[-1] += 3.0
    one, other = (intraclass_correlation.axis_correlation(each, rooms) for each in (limited, beyond))
    assert one is not None
    assert other is not None
    assert other.value == pytest.approx(one.value)


def test_a_correlation_is_at_most_099_and_classes_differ_by_five_hundredths() -> None:
    rooms = np.repeat(np.arange(10), 2).astype(str)
    same = intraclass_correlation.axis_correlation(np.repeat(np.linspace(-1, 1, 10), 2), rooms)
    assert same is not None
    assert same.value == 0.99
    classes = dict.fromkeys("abc", intraclass_correlation.IntraclassCorrelation(0.5, 0.1))
    shrunk, other = intraclass_correlation.shrunk_correlations(classes)
    assert other.sd == pytest.approx(np.sqrt(0.05**2 + (0.1**2 + 0.05**2) / 3))
    assert shrunk["a"].sd == pytest.approx(np.sqrt(1 / (1 / 0.1**2 + 1 / 0.05**2)))
    none, default = intraclass_correlation.shrunk_correlations({"a": same})
    assert (none, default) == ({}, intraclass_correlation.IntraclassCorrelation(0.45, 0.2))


def test_a_prior_of_any_class() -> None:
    assert moments.VAGUE.covariance == pytest.approx(0.33**2 * (0.6 + 0.4 * np.eye(3)))


@pytest.mark.parametrize(("mass", "axes"), [([3.0, 0.51, 0.49], [0, 1]), ([0.2, 0.1, 0.0], [0])])
def test_an_axis_is_published_from_half_a_row(mass: list[float], axes: list[int]) -> None:
    assert class_prior.published_axes(np.array(mass)).tolist() == axes


@pytest.mark.parametrize(("effective", "components"), [(17.9, 3), (18.1, 1)])
def test_student_s_t_is_published_up_to_30_degrees_of_freedom(effective: float, components: int) -> None:
    belief = NormalInverseWishart(np.zeros(2), 1.0, np.eye(2), 10.0)
    single = Mixture(np.ones(1), np.zeros((1, 2)), np.eye(2)[None])
    fitted = Fitted(single, 0.0)
    assert len(class_prior.predictive_mixture(fitted, belief, effective).weights) == components


def test_contexts_are_of_the_thirty_largest_sources_with_a_minimum_of_noise() -> None:
    """The noise of a context is at least 1e-4 of the disagreement."""
    means = [
        contexts.ContextMean(f"s{k:02}", "DE", None, np.zeros(1), np.array([100.0 + k if k else 1e9]))
        for k in range(40)
    ]
    (line,) = contexts.context_lines(means, np.array([0.04]), np.array([0.01]))
    assert len(line.means) == 30
    assert line.noise.min() == 1e-4
    assert line.noise[1] == pytest.approx(4.0 / 139)
