"""Objects of one class: shared errors, information of many objects, and invariances of the result."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.posterior.class_hypotheses import (
    bias_probability,
    hypotheses,
)
from estimator.posterior.class_likelihood import ClassHypotheses
from estimator.posterior.object_likelihood import ObjectEvidence
from estimator.posterior.posterior import Posterior, posterior
from estimator.posterior.shared_error import split_error
from metric_tree.prior import Prior
from tests.synthetic.priors import evidence, prior

# Published values, written out so that a changed rule fails a test.
BIAS_PROBABILITY = 0.3
MAX_OBJECTS_PER_CLASS = 100
ONE_KIND_FRACTION = 0.9
RELATED_FRACTION = 0.5

CHAIR = prior("chair.n.01", [(560, 540, 950), (700, 640, 1100)])
DESK = prior("desk.n.01", [(1300, 680, 740)], spread=0.1)
BOTTLE = prior("bottle.n.01", [(85, 80, 260), (75, 73, 200), (95, 90, 330)], spread=0.08, shared=0.1)
CATALOGUED = prior("car.n.01", [(4600, 1820, 1500)], spread=0.06, shared=0.04, in_place=0.0)
PERSON = prior("person.n.01", [(1700,)], spread=0.06, shared=0.04, dims=("height",))


def drawn(of: Prior, n: int, seed: int, share: float = 0.0, sigma: float = 0.03) -> list[ObjectEvidence]:
    """Objects at scale one; `share` of the spread within the class is common to them."""
    generator = np.random.default_rng(seed)
    kind = generator.choice(len(of.weights), p=of.weights)
    lower = np.linalg.cholesky(of.covariances[kind])
    common = generator.standard_normal(len(of.dims)) * math.sqrt(share)
    error = generator.multivariate_normal(np.zeros(len(of.dims)), of.shared_covariance)
    items = []
    for number in range(n):
        own = generator.standard_normal(len(of.dims)) * math.sqrt(1 - share)
        x = of.means[kind] + error + lower @ (common + own) + generator.normal(0, sigma, len(of.dims))
        sizes = np.exp(x) / 1000
        sizes[:2] = np.sort(sizes[:2])[::-1]
        items.append(evidence(of, sizes, sigma=sigma, name=str(number)))
    return items


def width(answer: Posterior) -> float:
    return math.log(answer.interval[1] / answer.interval[0])


def test_hypotheses_are_a_distribution() -> None:
    for free, of in itertools.product((False, True), (BOTTLE, CATALOGUED)):
        ways = hypotheses(of, free)
        assert sum(math.exp(way.log_weight) for way in ways) == pytest.approx(1)
        for way in ways:
            assert way.prior.weights.sum() == pytest.approx(1)
            assert np.linalg.eigvalsh(way.error.covariance).min() > 0


def test_hypotheses_keep_the_spread_of_one_object() -> None:
    """Moving variance from the objects to their shared error does not affect a single object."""

    def spread(prior_of: Prior, shared: np.ndarray) -> np.ndarray:
        mean = prior_of.weights @ prior_of.means
        offset = prior_of.means - mean
        return np.asarray(
            np.einsum("k,kij->ij", prior_of.weights, prior_of.covariances)
            + np.einsum("k,ki,kj->ij", prior_of.weights, offset, offset)
            + shared
        )

    assorted, related, *kinds = [way for way in hypotheses(BOTTLE) if not way.is_mislabelled]
    plain = spread(BOTTLE, assorted.error.covariance)
    assert spread(related.prior, related.error.covariance) == pytest.approx(plain)
    weights = np.exp([way.log_weight for way in kinds])
    means = np.array([way.prior.means[0] for way in kinds])
    offset = means - weights @ means / weights.sum()
    covariances = [way.prior.covariances[0] + way.error.covariance for way in kinds]
    mixed = np.einsum("k,kij->ij", weights, covariances) + np.einsum("k,ki,kj->ij", weights, offset, offset)
    assert mixed / weights.sum() == pytest.approx(plain)


@pytest.mark.parametrize("stated", [0.1, 0.4, 0.8])
def test_a_stated_sameness_is_the_mean_share(stated: float) -> None:
    plain = [row for row in hypotheses(replace(BOTTLE, sameness=stated)) if not row.is_mislabelled]
    assorted, related, *kinds = np.exp([row.log_weight for row in plain])
    weights = np.array([assorted, related, sum(kinds)]) / (assorted + related + sum(kinds))
    assert weights @ [0.0, RELATED_FRACTION, ONE_KIND_FRACTION] == pytest.approx(stated, abs=1e-6)


def test_identical_objects_know_little_more_than_one() -> None:
    """Ten copies of a bottle have the information of one, except for the noise of its measurement."""
    can = prior("can.n.01", [(80, 78, 200)], spread=0.2, shared=0.03)
    one = drawn(can, 1, seed=3)
    copies = [replace(one[0], object=replace(one[0].object, id=str(n))) for n in range(10)]
    independent = drawn(can, 10, seed=4)
    assert width(posterior(copies)) > 0.5 * width(posterior(one))
    assert width(posterior(independent)) < 0.95 * width(posterior(copies))


@pytest.mark.parametrize("count", [40, 400])
def test_many_objects_do_not_make_certainty(count: int) -> None:
    few, many = posterior(drawn(CHAIR, 25, seed=1)), posterior(drawn(CHAIR, count, seed=1))
    assert width(many) > 0.7 * width(few)
    assert len(many.weight) == count
    assert (many.weight > 0.3).mean() > 0.9


@pytest.mark.parametrize("count", [1, 5, 100])
def test_a_reading_of_the_axes_is_not_learned_from_numbers(count: int) -> None:
    """Which side of a free box is a person's height stays open, however many persons there are."""
    generator = np.random.default_rng(2)
    sizes = np.array([1.7, 0.5, 0.3]) * np.exp(generator.normal(0, [0.06, 0.05, 0.04], (count, 3)))
    items = [evidence(PERSON, size, vertical_known=False, name=str(n)) for n, size in enumerate(sizes)]
    answer = posterior(items)
    assert answer.status != "resolved"
    assert max(mode.mass for mode in answer.modes) < 0.9


def test_a_wrong_sense_does_not_rule_the_scene() -> None:
    """Eight 'desks' that are toys, half the size and all equal, against three chairs and two bottles."""
    right = [*drawn(CHAIR, 3, 0), *drawn(BOTTLE, 2, 1)]
    toys = [evidence(DESK, np.array([1.3, 0.68, 0.74]) * 0.4, name=f"toy {n}") for n in range(8)]
    answer = posterior([*right, *toys])
    assert answer.modes[0].scale == pytest.approx(posterior(right).modes[0].scale, rel=0.05)
    assert answer.weight[-8:].max() < 0.1


def test_coverage_when_a_scene_has_one_kind() -> None:
    """Twelve classes of scenes, nine tenths of the spread shared: the interval is honest (0.61 without sameness)."""
    inside = 0
    for seed in range(60):
        low, high = posterior(drawn(BOTTLE, 10, seed, share=0.9)).interval
        inside += low <= 1 <= high
    assert inside >= 48


@given(st.floats(-20, 20), st.integers(0, 30), st.permutations(range(7)))
@settings(max_examples=30)
def test_unit_and_order_do_not_matter(log_scale: float, seed: int, order: list[int]) -> None:
    items = [*drawn(CHAIR, 4, seed), *drawn(DESK, 1, seed), *drawn(BOTTLE, 2, seed)]
    moved = [evidence(items[i].prior, items[i].object.extents / math.exp(log_scale), name=str(i)) for i in order]
    here, there = posterior(items), posterior(moved)
    assert math.log(there.modes[0].scale) - log_scale == pytest.approx(math.log(here.modes[0].scale), abs=0.005)
    assert math.log(there.interval[0]) - log_scale == pytest.approx(math.log(here.interval[0]), abs=0.01)
    assert there.weight == pytest.approx(here.weight[order], abs=0.02)


@given(st.integers(0, 30))
@settings(max_examples=15)
def test_an_object_named_twice_says_little_more(seed: int) -> None:
    """Every object once more: the copies share all, so the answer keeps its place within the interval."""
    items = [*drawn(CHAIR, 2, seed), *drawn(BOTTLE, 2, seed)]
    once, twice = posterior(items), posterior([*items, *items])
    assert abs(math.log(twice.modes[0].scale / once.modes[0].scale)) < 0.2 * width(once)
    assert width(twice) > 0.6 * width(once)


def test_an_object_alone_resolves_where_its_class_is_tight() -> None:
    tight = prior("ball.n.01", [(220, 219, 221)], spread=0.01, shared=0.03)
    assert posterior([evidence(tight, (0.44, 0.44, 0.44), sigma=0.02)]).status == "resolved"
    by_height = posterior([evidence(PERSON, (math.nan, math.nan, 1.7))])
    assert by_height.status == "resolved"
    assert by_height.weight[0] > 0.8


@pytest.mark.parametrize("count", [1, 4])
def test_a_catalogued_class_keeps_its_height_where_its_footprint_is_contradicted(count: int) -> None:
    """Footprints 20 % larger than the catalogue states, heights as it states."""

    def found(in_place: float) -> Posterior:
        of = replace(CATALOGUED, share_by_kind={"product": 1 - in_place, "measured": in_place})
        return posterior([evidence(of, np.array([4.6, 1.82, 1.5]) * [1.2, 1.2, 1], name=str(n)) for n in range(count)])

    known, catalogued = found(1.0), found(0.0)
    assert abs(math.log(catalogued.modes[0].scale)) < abs(math.log(known.modes[0].scale)) - 0.005
    assert catalogued.interval[1] > 1


def test_only_what_was_not_measured_in_place_is_displaced() -> None:
    by_share = [
        bias_probability(replace(CATALOGUED, share_by_kind={"product": 1 - m, "measured": m})) for m in (0, 0.5, 1)
    ]
    assert by_share == pytest.approx([BIAS_PROBABILITY, BIAS_PROBABILITY / 2, 0])
    assert bias_probability(replace(CATALOGUED, tier="norm")) == 0
    assert bias_probability(PERSON) == 0
    two = prior("car.n.01", [(4600, 1500)], spread=0.06, shared=0.04, dims=("length", "height"), in_place=0.0)
    assert bias_probability(two) == 0  # no proportions


def test_large_classes_are_thinned_alike_in_any_order() -> None:
    items = drawn(CHAIR, 3 * MAX_OBJECTS_PER_CLASS, seed=5)
    there, here = posterior(items[::-1]), posterior(items)
    assert there.modes[0].scale == pytest.approx(here.modes[0].scale, rel=1e-6)


def test_an_object_that_fits_is_an_outlier_once_in_ten() -> None:
    """The probability of a wrong label: a single object with one dimension gives no information about its label."""
    (weight,) = posterior([evidence(PERSON, (math.nan, math.nan, 1.7))]).weight
    assert 0.85 < weight < 0.95


def test_a_wrong_object_costs_what_its_probability_says() -> None:
    """Two objects that exclude each other leave both modes, and a third of equal weight decides nine to one."""
    here = [evidence(PERSON, (math.nan, math.nan, 1.7), name=str(n)) for n in range(1)]
    desk = evidence(DESK, np.array([1.3, 0.68, 0.74]) * 3)
    bottle = evidence(BOTTLE, (0.085, 0.08, 0.26))
    answer = posterior([*here, desk, bottle])
    near_one = sum(mode.mass for mode in answer.modes if abs(math.log(mode.scale)) < 0.5)
    assert near_one > 0.9


def test_the_sources_of_three_classes_in_ten_disagree_more_than_the_error_between_them() -> None:
    """Classes without measurements on site; the hypothesis has 0.3 of the classes whose label is right."""
    biased = sum(math.exp(row.log_weight) for row in hypotheses(CATALOGUED) if row.is_biased)
    mislabelled = sum(math.exp(row.log_weight) for row in hypotheses(CATALOGUED) if row.is_mislabelled)
    assert bias_probability(CATALOGUED) == pytest.approx(0.3)
    assert biased == pytest.approx(0.3 * (1 - mislabelled))


@pytest.mark.parametrize(("of", "probability"), [(CATALOGUED, 0.2), (PERSON, 0.03)])
def test_a_label_of_several_objects_is_wrong_once_in_five_and_rarely_without_proportions(
    of: Prior, probability: float
) -> None:
    assert sum(math.exp(row.log_weight) for row in hypotheses(of) if row.is_mislabelled) == pytest.approx(probability)


def test_weights_and_errors_of_the_hypotheses_of_a_catalogued_class() -> None:
    """Assorted, related and one kind (0.3, 0.4, 0.3), a bias of the sources (0.3), and a wrong label (0.2)."""
    ways = hypotheses(CATALOGUED)
    weights = [math.exp(way.log_weight) for way in ways]
    assert weights == pytest.approx([0.3 * 0.56, 0.4 * 0.56, 0.3 * 0.56, 0.3 * 0.8, 0.1, 0.1])
    covariance, between, axes = CATALOGUED.covariances[0], CATALOGUED.disagreement(), np.arange(3)
    own = [1.0, 0.5, 0.1, 0.5, 1.0, 0.1]
    for way, fraction in zip(ways, own, strict=True):
        assert way.prior.covariances[0] == pytest.approx(fraction * covariance)
    biased = 5.0 * between + 0.1**2 * np.outer([1, 1, 0], [1, 1, 0])
    shared = [between, between + 0.5 * covariance, between + 0.9 * covariance, biased + 0.5 * covariance]
    shared += [between + 0.7**2 * np.eye(3)] * 2
    for way, error in zip(ways[1:], shared[1:], strict=True):
        assert way.error.along_sd == pytest.approx(split_error(error, axes).along_sd)


def test_a_prior_of_many_components_is_three_kinds() -> None:
    many = prior("many", [(100 * 3**k, 90 * 3**k, 80 * 3**k) for k in range(5)])
    assert len(hypotheses(many)) == 2 + 3 + 2


@pytest.mark.parametrize(("sameness", "mean"), [(0.01, 0.05), (0.6, 0.6), (0.95, 0.85)])
def test_a_stated_sameness_is_limited(sameness: float, mean: float) -> None:
    weights = [math.exp(way.log_weight) / 0.8 for way in hypotheses(replace(BOTTLE, sameness=sameness))]
    assert 0.5 * weights[1] + 0.9 * sum(weights[2:5]) == pytest.approx(mean, abs=1e-6)


def test_the_evidence_of_many_objects_is_that_of_25() -> None:
    ways = hypotheses(DESK)[:2]
    rows = ClassHypotheses(ways, np.array([0, 1]), np.array([20, 50]), np.arange(2), np.arange(2))
    assert rows.power.tolist() == [1.0, 0.5]


def test_a_class_without_tolerance_has_no_ripple() -> None:
    """Two signs of a norm with uncertain sizes: the grid of their wide range is coarser than the tolerance."""
    sign = replace(prior("sign", [(750, 750)], spread=0.002, shared=0.0014, dims=("length", "height")), tier="norm")
    signs = []
    for size, height_sigma in (((0.63, 0.15, 0.95), 0.5), ((0.59, 0.13, 0.95), 1.0)):
        item = evidence(sign, size)
        signs.append(replace(item, object=replace(item.object, sigma=np.array([1.0, 1.0, height_sigma]))))
    log_likelihood = posterior(signs).class_log_likelihood[0]
    crests = (log_likelihood[1:-1] > log_likelihood[:-2]) & (log_likelihood[1:-1] > log_likelihood[2:])
    assert crests.sum() == 1


def test_the_only_object_of_a_class_may_be_mislabelled() -> None:
    """A bottle of twice the size: two desks decide, as if two bottles had this size; alone, nothing contradicts it."""
    desks = [evidence(DESK, size, name=str(n)) for n, size in enumerate([(1.3, 0.68, 0.74), (1.25, 0.7, 0.73)])]
    wrong = evidence(BOTTLE, np.array([0.085, 0.08, 0.26]) * 2)
    result = posterior([*desks, wrong])
    assert result.modes[0].scale == pytest.approx(1, abs=0.06)
    assert result.interval[0] < 1 < result.interval[1]
    assert result.weight[-1] < 0.5 < result.weight[:-1].min()
    lone = posterior([wrong])
    assert lone.modes[0].scale == pytest.approx(0.5, rel=0.05)
    assert lone.weight[0] > 0.85
