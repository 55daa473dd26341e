"""The fit of one class: recovery from damaged rows, borrowing, and the effect of disagreeing sources."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from metric_tree.axes import AXES, axis_assignments
from metric_tree.fit.class_prior import NEW_SOURCE, NewSource, best_mixture, class_prior
from metric_tree.fit.evidence_model import EvidenceModel
from metric_tree.fit.mixture import NormalInverseWishart, Rows, fit_mixture
from metric_tree.fit.moments import VAGUE, correlated_covariance, moments
from metric_tree.fit.rows import ClassRows, without_museums, without_open_numbers

# Published values, written out so that a changed rule fails a test.
SPREAD_FLOOR = 0.03

MEANS = np.log([[2000.0, 900.0, 700.0], [900.0, 650.0, 1100.0]])  # a sofa and an armchair under one name
COVARIANCE = np.array([[0.012, 0.004, 0.003], [0.004, 0.010, 0.002], [0.003, 0.002, 0.008]])
NONE = EvidenceModel(0.0, 0.0)


def two_kinds(n: int, seed: int = 0) -> np.ndarray:
    generator = np.random.default_rng(seed)
    x = MEANS[generator.integers(0, 2, n)] + generator.multivariate_normal(np.zeros(3), COVARIANCE, n)
    x[:, :2] = -np.sort(-x[:, :2], axis=1)
    return x


def class_rows(x, owner=None, sources=None, kinds=None, range_sd=None) -> ClassRows:
    owner = np.arange(len(x)) if owner is None else owner
    n = int(owner[-1]) + 1
    return ClassRows(
        node_id="seat.n.01",
        axes=AXES,
        x=x,
        owner=owner,
        sources=tuple(sources or ["a"] * n),
        kinds=tuple(kinds or ["product"] * n),
        range_sd=np.full((n, 3), np.nan) if range_sd is None else range_sd,
        n=n,
    )


def assert_recovered(prior, tolerance):
    assert len(prior.weights) == 2
    order = np.argsort(-prior.means[:, 0])
    assert prior.weights == pytest.approx([0.5, 0.5], abs=0.06)
    assert prior.means[order] == pytest.approx(MEANS, abs=tolerance)
    spread = np.sqrt(np.diagonal(prior.covariances, axis1=1, axis2=2))
    assert spread == pytest.approx(np.sqrt([np.diag(COVARIANCE)] * 2), abs=1.5 * tolerance)


def test_two_kinds_are_found():
    assert_recovered(class_prior(class_rows(two_kinds(500)), VAGUE, NONE, seed=0, heldout=False), 0.03)


def test_two_kinds_are_found_with_forty_per_cent_blank():
    x = two_kinds(800)
    x[np.random.default_rng(1).random(x.shape) < 0.4] = np.nan
    x = x[~np.isnan(x).all(axis=1)]
    assert_recovered(class_prior(class_rows(x), VAGUE, NONE, seed=0, heldout=False), 0.04)


def test_two_kinds_are_found_with_the_axis_order_hidden():
    x = two_kinds(800)
    axes = np.exp(x)
    extents = -np.sort(-axes, axis=1)
    axes[np.random.default_rng(2).random(len(x)) < 0.6] = np.nan  # the words are missing, the numbers are not
    expanded, owner = axis_assignments(axes, extents, "upright")
    assert (np.bincount(owner) == 3).sum() > 400
    assert_recovered(class_prior(class_rows(np.log(expanded), owner), VAGUE, NONE, seed=0, heldout=False), 0.04)


def test_blanks_that_depend_on_another_axis_do_not_bias_as_dropping_rows_would():
    """Only the shorter half of the rows states the width: the mean of the stated widths is wrong, the fit is not."""
    x = np.random.default_rng(0).multivariate_normal(MEANS[0], correlated_covariance(np.full(3, 0.2), 0.9), 400)
    blank = x.copy()
    blank[x[:, 0] > np.median(x[:, 0]), 1] = np.nan
    prior = class_prior(class_rows(blank), VAGUE, NONE, seed=0, heldout=False)
    dropped = abs(np.nanmean(blank[:, 1]) - x[:, 1].mean())
    assert dropped > 0.1
    assert abs(float(prior.weights @ prior.means[:, 1]) - x[:, 1].mean()) < 0.15 * dropped


def test_spread_never_falls_under_the_floor():
    x = np.tile(np.log([[500.0, 500.0, 900.0]]), (40, 1))
    prior = class_prior(class_rows(x), VAGUE, NONE, seed=0, heldout=False)
    assert np.linalg.eigvalsh(prior.covariances).min() >= SPREAD_FLOOR**2 * (1 - 1e-9)


def test_the_fit_is_the_same_under_a_seed():
    rows = class_rows(two_kinds(200))
    one, other = (class_prior(rows, VAGUE, NONE, seed=0) for _ in range(2))
    assert one.row() == other.row()


def test_a_thin_class_borrows_its_parents_spread_and_says_so():
    belief = NormalInverseWishart(np.log([500.0, 500.0, 900.0]), 0.1, correlated_covariance(np.full(3, 0.2)), 8.0)
    sizes = np.log([[420.0, 400.0, 500.0], [430.0, 400.0, 505.0]])
    thin = class_prior(class_rows(sizes), belief, NONE, seed=0)
    spread = np.sqrt(np.einsum("k,kii->i", thin.weights, thin.covariances))
    assert thin.borrowed == pytest.approx(0.8)
    assert np.all((spread > 0.15) & (spread < 0.35))  # two near-equal rows are no evidence of a spread of two per cent
    assert np.exp(thin.weights @ thin.means) == pytest.approx([425, 400, 502], rel=0.06)
    assert thin.heldout_log_density is None


def test_borrowing_fades_with_rows():
    belief = NormalInverseWishart(VAGUE.mean, 0.1, correlated_covariance(np.full(3, 0.5)), 8.0)
    x = two_kinds(400)[:, :] * 0 + np.random.default_rng(0).multivariate_normal(MEANS[0], COVARIANCE, 400)
    shares = [class_prior(class_rows(x[:n]), belief, NONE, seed=0, heldout=False).borrowed for n in (1, 5, 25, 400)]
    assert shares == sorted(shares, reverse=True)
    assert shares[-1] < 0.05


def test_one_shop_does_not_own_a_class():
    generator = np.random.default_rng(0)
    many = generator.multivariate_normal(MEANS[0], COVARIANCE, 2000)
    few = generator.multivariate_normal(MEANS[0] + 0.5, COVARIANCE, 50)
    x = np.concatenate([many, few])
    prior = class_prior(class_rows(x, sources=["shop"] * 2000 + ["other"] * 50), VAGUE, NONE, seed=0, heldout=False)
    share = (float(prior.weights @ prior.means[:, 0]) - MEANS[0, 0]) / 0.5
    assert 0.2 < share < 0.6  # by rows it would be 0.024


TYPICAL = np.log([[1000.0, 500.0, 700.0]])
RANGE_SD = np.array([[0.1, 0.12, 0.02]])


def with_range(x, sources, kinds) -> ClassRows:
    """Rows next to one curated range."""
    sd = np.vstack([RANGE_SD, np.full((len(x), 3), np.nan)])
    return class_rows(np.concatenate([TYPICAL, x]), sources=["judged", *sources], kinds=["judged", *kinds], range_sd=sd)


def test_a_range_alone_is_published_as_wide_as_ranges_are_off():
    prior = class_prior(class_rows(TYPICAL, kinds=["judged"], range_sd=RANGE_SD), VAGUE, NONE)
    assert prior.quantile(0.5) == pytest.approx([1000, 500, 700])
    # within and between sources together, below the floor too
    assert prior.log_sd() == pytest.approx(np.sqrt(NEW_SOURCE.factor(0, RANGE_SD[0])) * RANGE_SD[0])
    assert prior.share_by_kind == {"judged": 1.0}


def test_a_source_never_seen_widens_a_narrow_class_in_proportion_and_a_wide_one_by_its_offset():
    offset = NewSource(sd=0.25, most=2.0)
    assert offset.factor(0, np.array([0.01, 0.25, 1.0])) == pytest.approx([3.0, 2.0, 1.0625])
    factors = [offset.factor(sources, 0.1) for sources in range(9)]
    assert factors == sorted(factors, reverse=True)
    assert factors[8] == pytest.approx(1 + 2 / 9)
    assert NewSource(0.0).factor(0, 0.3) == 1


def test_two_museum_pieces_do_not_discard_a_range():
    pieces = np.log([[2600.0, 1500.0, 300.0], [2500.0, 1400.0, 280.0]])
    model = EvidenceModel(0.3, 0.05, {"museum": 0.35, "judged": 0.05})
    prior = class_prior(with_range(pieces, ["a", "a"], ["museum"] * 2), VAGUE, model, heldout=False)
    assert prior.quantile(0.5) == pytest.approx([1000, 500, 700], rel=0.15)
    assert np.all(prior.log_sd() < [0.25, 0.25, 0.2])
    assert prior.share_by_kind["judged"] > 0.8


def test_one_real_row_does_not_widen_a_norm():
    prior = class_prior(with_range(TYPICAL + 0.001, ["a"], ["standard"]), VAGUE, NONE, heldout=False)
    assert np.all(prior.log_sd() < 2 * RANGE_SD[0])


def test_a_weak_row_does_not_draw_a_norm_to_its_parent():
    """A cube of 57 mm and an artist's model, among parents a metre wide."""
    wide = NormalInverseWishart(np.log([1000.0, 900.0, 800.0]), 1.0, correlated_covariance(np.full(3, 0.5)), 8.0)
    rows = class_rows(
        np.log([[57.0] * 3, [58.0] * 3]),
        sources=["judged", "models"],
        kinds=["judged", "asset"],
        range_sd=np.array([[0.02] * 3, [np.nan] * 3]),
    )
    prior = class_prior(rows, wide, EvidenceModel(0.3, 0.05), heldout=False, new_source=NewSource(0.0))
    assert prior.quantile(0.5) == pytest.approx([57, 57, 57], rel=0.02)
    assert np.all(prior.log_sd() < 0.03)


def test_rows_of_heights_alone_do_not_move_the_other_axes():
    """Sixty boxes, and two hundred heights of another source, a third lower: the length is determined by the boxes."""
    generator = np.random.default_rng(0)
    boxes = np.log([[500.0, 480.0, 900.0]]) + generator.multivariate_normal(np.zeros(3), COVARIANCE, 60)
    heights = np.full((200, 3), np.nan)
    heights[:, 2] = np.log(600.0) + generator.normal(0, 0.2, 200)
    sources = ["shop"] * 60 + ["rooms"] * 200
    rows = class_rows(np.concatenate([boxes, heights]), sources=sources, kinds=["product"] * 260)
    model = EvidenceModel(0.3, 0.05)
    alone = class_prior(class_rows(boxes, sources=sources[:60]), VAGUE, model, heldout=False).quantile(0.5)
    assert class_prior(rows, VAGUE, model, heldout=False).quantile(0.5)[:2] == pytest.approx(alone[:2], rel=0.04)


def test_a_range_says_which_axis_a_number_is_of():
    lone = np.array([[np.nan, np.nan, np.log(690.0)]])
    rows = with_range(np.repeat(lone, 4, axis=0), [f"s{n}" for n in range(4)], ["product"] * 4)
    axes = np.log([[690.0, np.nan, np.nan], [np.nan, 690.0, np.nan], [np.nan, np.nan, 690.0]])
    x = np.concatenate([rows.x[:1], np.tile(axes, (4, 1))])
    hidden = replace(rows, x=x, owner=np.r_[0, np.repeat(np.arange(1, 5), 3)])
    assert class_prior(hidden, VAGUE, NONE, heldout=False).quantile(0.5) == pytest.approx([1000, 500, 700], rel=0.1)


def test_numbers_of_no_axis_are_left_out_where_anything_else_speaks():
    x = np.log([[350.0, 240.0, 20.0], [250.0, np.nan, np.nan], [np.nan, 250.0, np.nan]])
    rows = replace(class_rows(x[:2], sources=["a", "rooms"]), x=x, owner=np.array([0, 1, 1]))
    assert without_open_numbers(rows).sources == ("a",)
    alone = without_open_numbers(rows)
    assert without_open_numbers(alone) is alone
    lone = replace(class_rows(x[1:2], sources=["rooms"]), x=x[1:], owner=np.array([0, 0]))
    assert without_open_numbers(lone) is lone


@pytest.mark.parametrize(
    ("kinds", "left"), [(["product"], 1), (["judged"], 1), (["asset"] * 3, 3), (["asset"], 3), (["museum"], 3)]
)
def test_museums_speak_where_nothing_else_does(kinds: list[str], left: int):
    whole = [*kinds, "museum", "museum"]
    x = np.log([[100.0, 90.0, 80.0]] * len(whole))
    assert len(without_museums(class_rows(x, sources=whole, kinds=whole)).kinds) == left


def test_many_products_outweigh_a_range():
    x = np.log([2000.0, 900.0, 800.0]) + np.random.default_rng(0).normal(0, 0.15, (300, 3))
    sources = [f"s{number % 6}" for number in range(300)]
    prior = class_prior(with_range(x, sources, ["product"] * 300), VAGUE, EvidenceModel(0.3, 0.05), heldout=False)
    assert prior.quantile(0.5) == pytest.approx([1850, 850, 790], rel=0.1)
    assert prior.log_sd() == pytest.approx([0.17, 0.17, 0.17], abs=0.05)


def test_a_hundred_boxes_of_one_room_weigh_as_one():
    x = np.log([[500.0, 480.0, 900.0]]) + np.random.default_rng(0).normal(0, 0.1, (120, 3))
    x[:100] += 0.5
    share = np.r_[np.full(100, 0.01), np.ones(20)]
    rows = replace(class_rows(x, sources=["rooms"] * 120, kinds=["measured"] * 120), row_share=share)
    assert class_prior(rows, VAGUE, NONE, heldout=False).quantile(0.5) == pytest.approx([512, 492, 922], rel=0.04)


def test_many_strong_rows_silence_models_and_museums():
    products = np.log([[1700.0, 480.0, 250.0]]) + np.random.default_rng(3).normal(0, 0.05, (40, 3))
    statuettes = np.log([[400.0, 200.0, 150.0]] * 3)
    rows = class_rows(
        np.concatenate([products, statuettes]),
        sources=["survey"] * 40 + ["museum"] * 3,
        kinds=["measured"] * 40 + ["museum"] * 3,
    )
    prior = class_prior(rows, VAGUE, NONE, seed=0)
    assert prior.share_by_kind == {"measured": 1.0}
    assert prior.quantile(0.5) == pytest.approx([1700, 480, 250], rel=0.05)


def test_axes_that_nobody_states_are_not_published():
    x = np.log([[400.0, 300.0, np.nan]] * 4)
    assert class_prior(class_rows(x), VAGUE, NONE, seed=0).dims == ("length", "width")


def test_moments_tell_which_axes_are_known():
    found = moments(class_rows(np.log([[400.0, 300.0, np.nan]] * 4)))
    assert found.known == pytest.approx([4, 4, 0])


def test_likelihood_never_falls_with_a_component():
    x = two_kinds(150)
    rows = Rows(x, np.arange(len(x)), np.ones(len(x)))
    likelihoods = [fit_mixture(rows, k, VAGUE).log_likelihood for k in (1, 2, 3)]
    assert likelihoods[0] < likelihoods[1] <= likelihoods[2] + 1.0


def test_five_groups_of_sizes_have_four_components() -> None:
    chance = np.random.default_rng(0)
    x = np.concatenate([centre + 0.02 * chance.standard_normal((20, 1)) for centre in range(5)])
    belief = NormalInverseWishart(np.array([2.0]), 0.1, np.array([[1e-3]]), 8.0)
    assert best_mixture(Rows(x, np.arange(100), np.ones(100)), belief, 0)[1] == 4


@pytest.mark.parametrize(("stated", "sd"), [(0.0008, 0.001), (0.0012, 0.0012)])
def test_the_tolerance_of_a_norm_is_at_least_a_thousandth(stated: float, sd: float) -> None:
    x = np.log([[300.0, 200.0, 100.0]])
    rows = class_rows(x, kinds=["norm"], range_sd=np.full((1, 3), stated))
    assert class_prior(rows, VAGUE, EvidenceModel()).log_sd() == pytest.approx([sd] * 3)
