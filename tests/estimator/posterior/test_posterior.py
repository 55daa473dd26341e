"""The posterior of whole scenes: against brute-force quadrature, known truths, and the rules of `unresolved`."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from estimator.posterior import log_scale_grid
from estimator.posterior.class_hypotheses import hypotheses
from estimator.posterior.object_likelihood import ObjectEvidence
from estimator.posterior.posterior import peak_mass, posterior, status_reason
from estimator.posterior.shared_error import convolution, shared_error
from estimator.records.result import Curve, Mode
from metric_base.arrays import FloatArray
from tests.support.class_likelihood_definition import class_log_likelihood, hypothesis_likelihood
from tests.synthetic.priors import evidence, prior

# Published values, written out so that a changed rule fails a test.
PRIOR_MARGIN_LOG = 1.0

CHAIR = prior("chair.n.01", [(560, 540, 950), (700, 640, 1100)])
DESK = prior("desk.n.01", [(1300, 680, 740)], spread=0.1)
BOTTLE = prior("bottle.n.01", [(85, 80, 260), (75, 73, 200), (95, 90, 330)], spread=0.08, shared=0.1)


def _drawn(of: object, scale: float, n: int, seed: int, sigma: float = 0.03) -> list[ObjectEvidence]:
    generator = np.random.default_rng(seed)
    sizes = of.sample(n, seed) / 1000 / scale * np.exp(generator.normal(0, sigma, (n, 3)))  # type: ignore[attr-defined]
    sizes[:, :2] = np.sort(sizes[:, :2], axis=1)[:, ::-1]
    return [evidence(of, size, sigma=sigma, name=str(i)) for i, size in enumerate(sizes)]  # type: ignore[arg-type]


def _moments(u: FloatArray, log_density: FloatArray) -> tuple[float, float]:
    mass = np.exp(log_density - log_density.max())
    mass /= mass.sum()
    mean = float(mass @ u)
    return mean, math.sqrt(float(mass @ (u - mean) ** 2))


@pytest.mark.parametrize(
    ("count", "wrong", "cut", "in_place"),
    [
        (2, False, False, 1.0),
        (3, True, False, 1.0),
        (3, False, True, 1.0),
        (6, True, True, 1.0),
        (3, False, False, 0.0),
    ],
)
def test_the_fast_code_is_the_definition(count: int, wrong: bool, cut: bool, in_place: float) -> None:
    """The accuracy that `class_error` states, in the posterior's own standard deviation, over every hypothesis."""
    bottle = replace(BOTTLE, share_by_kind={"product": 1 - in_place, "measured": in_place})
    items = _drawn(bottle, 0.4, count, seed=count)
    if cut:
        items[-1] = evidence(bottle, items[-1].object.extents * [0.6, 1, 1], cut=(True, False, False))
    if wrong:
        items[0] = evidence(bottle, items[0].object.extents * [2.0, 1.3, 0.7])
    fast = posterior(items)
    u = fast.coarse[:: max(len(fast.coarse) // 20, 1)]
    expected_mean, expected_sd = _moments(u, class_log_likelihood(items, u, points=32))
    mean, sd = _moments(u, np.interp(u, fast.coarse, fast.class_log_likelihood[0]))
    assert abs(mean - expected_mean) < (0.15 if wrong else 0.04) * expected_sd
    assert sd == pytest.approx(expected_sd, rel=0.12 if wrong else 0.03)


def test_one_object_has_the_class_error_in_closed_form() -> None:
    items = _drawn(CHAIR, 2.0, 1, seed=3)
    fast = posterior(items)
    u = fast.coarse[:: max(len(fast.coarse) // 30, 1)]
    expected = np.log(hypothesis_likelihood(items, hypotheses(CHAIR)[0], u, points=64))
    shown = np.abs(u - u[expected.argmax()]) < 0.2  # within the definition's own grid
    off = (np.interp(u, fast.coarse, fast.class_log_likelihood[0]) - expected)[shown]
    assert np.abs(off).max() < 0.02


@given(st.floats(-21, 21), st.integers(0, 50))
@settings(max_examples=25, deadline=None)
def test_scale_follows_the_unit(log_scale: float, seed: int) -> None:
    """Measuring in another unit multiplies the answer and changes nothing else."""
    scale = math.exp(log_scale)
    items = [*_drawn(CHAIR, 1.0, 2, seed), *_drawn(DESK, 1.0, 1, seed + 1)]
    moved = [evidence(i.prior, i.object.extents / scale, name=i.object.id) for i in items]
    here, there = posterior(items), posterior(moved)
    assert there.modes[0].scale / scale == pytest.approx(here.modes[0].scale, rel=2e-3)
    assert there.interval[0] / scale == pytest.approx(here.interval[0], rel=4e-3)
    assert there.weight == pytest.approx(here.weight, abs=0.02)


def test_a_class_saturates() -> None:
    """The shared error limits the information from forty chairs; a desk adds more than another chair."""

    def width(items: list[ObjectEvidence]) -> float:
        low, high = posterior(items).interval
        return math.log(high / low)

    chairs = _drawn(CHAIR, 1.0, 41, seed=5)
    shared_only = 2 * 1.645 * shared_error(CHAIR).along_sd
    assert width(chairs[:40]) == pytest.approx(shared_only, rel=0.25)
    assert width(chairs[:40]) > 0.97 * shared_only
    with_desk = width([*chairs[:40], *_drawn(DESK, 1.0, 1, seed=6)])
    assert with_desk < 0.9 * width(chairs)


def test_no_jacobian_bias() -> None:
    """The paper's product is low by c^2 / (1 + c^2) for a class of spread c; in log space nothing is lost."""
    can = prior("can.n.01", [(80, 78, 200)], spread=0.3, shared=0.03)
    errors = [math.log(posterior(_drawn(can, 0.5, 20, seed)).modes[0].scale / 0.5) for seed in range(12)]
    assert abs(np.mean(errors)) < 0.04


def test_a_wrong_label_has_no_veto() -> None:
    items = [*_drawn(CHAIR, 1.0, 3, 0), *_drawn(DESK, 1.0, 2, 1), *_drawn(BOTTLE, 1.0, 2, 2)]
    without = posterior(items)
    bucket = evidence(CHAIR, (0.27, 0.26, 0.25), name="bucket")
    found = posterior([*items, bucket])
    assert found.modes[0].scale == pytest.approx(without.modes[0].scale, rel=0.03)
    assert found.weight[-1] < 0.05
    assert found.weight[:-1].min() > 0.5
    assert found.own_scale[-1] > 2


@pytest.mark.parametrize("seen", [0.4, 0.5, 0.6])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_flagged_widths_have_no_veto_against_heights(seen: float, count: int) -> None:
    """Baths that all show the same part of their width: the flags do not make them other objects."""
    bath = prior("bathtub.n.01", [(1650, 720, 570)], spread=0.1)
    whole, half, height = 1.65, 0.72 * seen, 0.57
    flagged = [evidence(bath, (whole, half, height), cut=(False, True, False), name=str(i)) for i in range(count)]
    found = posterior(flagged)
    assert found.weight.min() > 0.9
    assert found.modes[0].scale == pytest.approx(1, rel=0.08)


def test_contradiction_is_refused() -> None:
    """Two classes that are sure of different scales: both modes stand, with their masses, and no answer is given."""
    items = [evidence(CHAIR, (0.56, 0.54, 0.95)), evidence(DESK, (2.6, 1.36, 1.48))]
    found = posterior(items)
    assert found.status == "unresolved"
    assert len(found.modes) >= 2
    assert sum(mode.mass for mode in found.modes) == pytest.approx(1, abs=0.02)


def test_hatchback_or_saloon_at_any_scale() -> None:
    """The evidence of the proportions picks the component, whatever the unit."""
    car = prior("car.n.01", [(3900, 1750, 1500), (4900, 1850, 1450)], spread=0.025, shared=0.03)
    for scale in (0.01, 1.0, 30.0):
        hatchback = posterior([evidence(car, np.array([3.9, 1.75, 1.5]) / scale, sigma=0.02)])
        saloon = posterior([evidence(car, np.array([4.9, 1.85, 1.45]) / scale, sigma=0.02)])
        assert hatchback.modes[0].scale == pytest.approx(scale, rel=0.02)
        assert saloon.modes[0].scale == pytest.approx(scale, rel=0.02)
        assert hatchback.modes[0].mass > 0.75
        assert saloon.modes[0].mass > 0.75


def test_known_length_decides() -> None:
    items = _drawn(CHAIR, 1.0, 2, 0)
    known = np.array([[math.log(1.04), 0.002, 0.0]])
    found = posterior(items, known)
    assert found.modes[0].scale == pytest.approx(1.04, rel=1e-3)
    low, high = found.interval
    assert math.log(high / low) == pytest.approx(2 * 1.645 * 0.002, rel=0.1)


def test_known_length_alone() -> None:
    found = posterior([], np.array([[math.log(0.3), 0.01, 0.0]]))
    assert found.status == "resolved"
    assert found.modes[0].scale == pytest.approx(0.3, rel=1e-3)
    assert math.log(found.interval[1] / 0.3) == pytest.approx(1.645 * 0.01, rel=0.05)


def test_nothing_is_an_error() -> None:
    with pytest.raises(ValueError, match="neither"):
        posterior([])


def test_leaving_a_class_out_is_the_scene_without_it() -> None:
    items = [*_drawn(CHAIR, 1.0, 3, 0), *_drawn(DESK, 1.0, 1, 1)]
    _, modes, interval = posterior(items).without("desk.n.01")
    alone = posterior(items[:3])
    assert modes[0].scale == pytest.approx(alone.modes[0].scale, rel=2e-3)
    assert interval == pytest.approx(alone.interval, rel=5e-3)


def test_coverage_of_the_interval() -> None:
    """Objects drawn as the model states: the 90 % interval holds the truth in about nine of ten scenes."""
    generator = np.random.default_rng(8)
    held = 0
    for number in range(150):
        items = []
        for of in (CHAIR, DESK, BOTTLE):
            error = generator.multivariate_normal(np.zeros(3), shared_error(of).covariance)
            for _ in range(int(generator.integers(1, 4))):
                k = generator.choice(len(of.weights), p=of.weights)
                x = generator.multivariate_normal(of.means[k], of.covariances[k]) + error
                sizes = np.exp(x + generator.normal(0, 0.03, 3)) / 1000
                sizes[:2] = np.sort(sizes[:2])[::-1]
                items.append(evidence(of, sizes, name=str(number)))
        low, high = posterior(items).interval
        held += low <= 1.0 <= high
    assert 0.84 * 150 <= held <= 0.96 * 150


def bell(sd: float) -> Curve:
    u = np.linspace(-3, 3, 2001)
    return Curve(u, np.exp(-0.5 * (u / sd) ** 2), 0.0, 0.0)


def test_status_rule_of_the_contract() -> None:
    best, sharp = Mode(1.0, 0.85), bell(0.1)
    assert status_reason([best, Mode(1.24, 0.15)], (0.9, 1.3), sharp)[0] == "resolved"
    assert status_reason([best, Mode(1.26, 0.15)], (0.9, 1.3), sharp)[0] == "uncertain"
    assert status_reason([best, Mode(0.79, 0.15)], (0.7, 1.1), sharp)[0] == "uncertain"
    assert status_reason([best, Mode(1.5, 0.09)], (0.9, 1.3), sharp)[0] == "resolved"
    assert status_reason([best], (0.7, 0.7 * 1.79), sharp)[0] == "resolved"
    assert status_reason([best], (0.7, 0.7 * 1.81), sharp)[0] == "uncertain"


@pytest.mark.parametrize(
    ("weight", "status"),
    [((0.9, 0.9, 0.9, 0.1), "resolved"), ((0.9, 0.1, 0.1), "uncertain"), ((0.1, 0.1), "resolved"), ((), "resolved")],
)
def test_what_calls_most_objects_outliers_is_uncertain(weight: tuple[float, ...], status: str) -> None:
    assert status_reason([Mode(1.0, 1.0)], (0.9, 1.1), bell(0.05), np.array(weight))[0] == status


def test_a_tempered_gaussian_is_wider_by_the_root_of_the_power() -> None:
    plain = Curve(bell(0.1).log_scale, bell(0.1).density / (0.1 * np.sqrt(2 * np.pi)), 0.0, 0.0)
    wide = log_scale_grid.tempered_posterior(plain, 0.25)
    assert np.log(log_scale_grid.interval(wide, 0.9)) == pytest.approx(
        2 * np.log(log_scale_grid.interval(plain, 0.9)), rel=1e-3
    )
    assert log_scale_grid.modes(wide)[0].scale == pytest.approx(log_scale_grid.modes(plain)[0].scale)
    flat = log_scale_grid.tempered_posterior(replace(plain, density=0.5 * plain.density, below=0.25, above=0.25), 0.5)
    step = flat.log_scale[1] - flat.log_scale[0]
    assert flat.density.sum() * step + flat.below + flat.above == pytest.approx(1.0, abs=1e-3)
    assert flat.below == pytest.approx(flat.above)
    assert flat.below > 0.25


def test_other_evidence_carries_a_scale_that_no_object_supports() -> None:
    items = [evidence(CHAIR, np.array([1, 1, 1]) * size, name=str(size)) for size in (0.01, 1.0, 100.0, 1e4)]
    assert posterior(items).status == "unresolved"
    assert posterior(items, np.array([[0.0, 0.02, 0.05]])).status == "resolved"


@pytest.mark.parametrize(("sd", "status"), [(0.29, "resolved"), (0.32, "unresolved"), (1.0, "unresolved")])
def test_unresolved_is_what_has_little_mass_near_its_mode(sd: float, status: str) -> None:
    """A Gaussian of 0.308 in log scale has 35 % within 15 %."""
    assert status_reason([Mode(1.0, 1.0)], (0.9, 1.1), bell(sd))[0] == status
    assert peak_mass(bell(0.308), 1.0) == pytest.approx(0.35, abs=0.005)


@pytest.mark.parametrize(
    ("below", "above", "status"), [(0, 0, "resolved"), (0.3, 0, "unresolved"), (0, 0.3, "unresolved")]
)
def test_mass_beyond_either_end_of_the_grid_leaves_the_scale_open(below: float, above: float, status: str) -> None:
    assert status_reason([Mode(1.0, 1.0)], (0.9, 1.1), replace(bell(0.05), below=below, above=above))[0] == status


@given(st.floats(0.03, 0.4), st.floats(-0.5, 0.5), st.floats(0.6, 0.99))
@settings(deadline=None, max_examples=40)
def test_interval_and_mode_of_a_gaussian(sd: float, mean: float, level: float) -> None:
    u = log_scale_grid.evidence_grid(np.array([mean]), np.array([sd]), np.array([8 * sd]))
    curve = log_scale_grid.curve(u, -0.5 * ((u - mean) / sd) ** 2, np.zeros((0, 3)))
    half = norm.ppf((1 + level) / 2) * sd
    low, high = log_scale_grid.interval(curve, level)
    assert math.log(low) == pytest.approx(mean - half, abs=0.02 * sd)
    assert math.log(high) == pytest.approx(mean + half, abs=0.02 * sd)
    assert math.log(log_scale_grid.modes(curve)[0].scale) == pytest.approx(mean, abs=0.01 * sd)


def test_mass_beyond_the_grid_counts() -> None:
    """A flat posterior is the prior, wherever the grid happens to lie."""
    u = np.linspace(-1, 1, 50)
    flat = log_scale_grid.curve(u, np.zeros(50), np.zeros((0, 3)))
    low, high = log_scale_grid.interval(flat, 0.9)
    ends = 1 + PRIOR_MARGIN_LOG
    assert math.log(low) == pytest.approx(-ends + 0.05 * 2 * ends, abs=0.02)
    assert math.log(high) == pytest.approx(ends - 0.05 * 2 * ends, abs=0.02)


def test_modes_share_the_mass() -> None:
    u = np.linspace(-2, 2, 2001)
    step = u[1] - u[0]

    def bump(mean: float, sd: float, mass: float) -> FloatArray:
        return mass * np.exp(-0.5 * ((u - mean) / sd) ** 2) / (sd * math.sqrt(2 * math.pi))

    density = bump(-0.5, 0.05, 0.3) + bump(0.4, 0.1, 0.7)
    found = log_scale_grid.modes(Curve(u, density / (density.sum() * step), 0.0, 0.0))
    assert [round(mode.mass, 2) for mode in found] == [0.7, 0.3]
    assert [math.log(mode.scale) for mode in found] == pytest.approx([0.4, -0.5], abs=1e-3)


@given(st.floats(0.03, 0.5), st.floats(0.0, 1.0), st.floats(0.6, 3.0))
def test_convolution_keeps_constants_and_widens_bumps(sd: float, base: float, half: float) -> None:
    own = np.linspace(-half, half, 301)[None]
    u = np.linspace(-2, 2, 81)
    found = convolution(base + np.exp(-0.5 * (own / 0.1) ** 2), own, u, np.array([sd]))[0][0]
    wide = math.hypot(sd, 0.1)
    assert found == pytest.approx(base + 0.1 / wide * np.exp(-0.5 * (u / wide) ** 2), abs=5e-3)


@pytest.mark.parametrize(
    ("mass", "status"), [(0.099, "resolved"), (0.101, "uncertain"), (0.349, "uncertain"), (0.351, "unresolved")]
)
def test_a_competing_mode_matters_from_a_tenth_and_contradicts_from_a_third(mass: float, status: str) -> None:
    assert status_reason([Mode(1.0, 1 - mass), Mode(1.5, mass)], (0.9, 1.1), bell(0.1))[0] == status


@pytest.mark.parametrize(("edge", "status"), [(0.249, "resolved"), (0.251, "unresolved")])
def test_a_quarter_of_the_mass_beyond_the_objects_is_too_much(edge: float, status: str) -> None:
    assert status_reason([Mode(1.0, 1.0)], (0.9, 1.1), replace(bell(0.05), above=edge))[0] == status


@pytest.mark.parametrize(("weight", "status"), [(0.401, "resolved"), (0.399, "uncertain")])
def test_objects_contradict_the_model_below_a_mean_weight_of_four_tenths(weight: float, status: str) -> None:
    found, reason = status_reason([Mode(1.0, 1.0)], (0.9, 1.1), bell(0.05), np.full(3, weight))
    assert found == status
    assert (reason is None) == (status == "resolved")


@pytest.mark.parametrize(("mass", "count"), [(0.004, 1), (0.006, 2)])
def test_modes_have_a_mass_of_at_least_half_a_percent(mass: float, count: int) -> None:
    u = np.linspace(-3, 3, 6001)
    density = (1 - mass) * np.exp(-0.5 * (u / 0.1) ** 2) + mass * np.exp(-0.5 * ((u - 2) / 0.1) ** 2)
    density /= density.sum() * (u[1] - u[0])
    assert len(log_scale_grid.modes(Curve(u, density, 0.0, 0.0))) == count


@pytest.mark.parametrize(("dip", "count"), [(0.91, 1), (0.89, 2)])
def test_peaks_with_a_dip_below_nine_tenths_are_separate_modes(dip: float, count: int) -> None:
    u = np.linspace(-1, 1, 2001)
    density = np.exp(-0.5 * ((np.abs(u) - 0.3) / 0.1) ** 2)
    density = np.where(np.abs(u) < 0.3, np.maximum(density, dip), density)
    density /= density.sum() * (u[1] - u[0])
    assert len(log_scale_grid.modes(Curve(u, density, 0.0, 0.0))) == count


@pytest.mark.parametrize(("doubt", "status"), [(0.05, "resolved"), (0.97, "unresolved")])
def test_other_evidence_determines_the_scale_if_it_is_probably_right(doubt: float, status: str) -> None:
    items = [evidence(CHAIR, np.array([1, 1, 1]) * size, name=str(size)) for size in (0.01, 1.0, 100.0, 1e4)]
    result = posterior(items, np.array([[0.0, 0.02, doubt]]))
    assert (result.evidence_weight[0] > 0.5) == (status == "resolved")
    assert result.status == status


def test_other_evidence_is_never_more_accurate_than_a_thousandth() -> None:
    assert posterior([], np.array([[0.0, 1e-5, 0.0], [0.0, 2e-3, 0.0]])).gaussians[:, 1].tolist() == [1e-3, 2e-3]


def test_a_grid_without_evidence_is_around_a_metre_per_unit() -> None:
    found = log_scale_grid.evidence_grid(np.zeros(0), np.zeros(0), np.zeros(0))
    assert (found[0], found[-1]) == (-1.0, 1.0)


@pytest.mark.parametrize("order", [1, -1])
def test_a_density_that_rises_to_an_end_has_its_mode_there(order: int) -> None:
    density = np.linspace(0.1, 1.0, 5)[::order]
    (mode,) = log_scale_grid.modes(Curve(np.linspace(-1.0, 1.0, 5), density, 0.0, 0.0))
    assert mode.scale == pytest.approx(np.exp(order))


def test_a_mode_is_the_vertex_of_the_parabola_through_its_neighbours() -> None:
    u = np.linspace(-1.0, 1.0, 41)
    (mode,) = log_scale_grid.modes(Curve(u, np.exp(-(((u - 0.013) / 0.1) ** 2) / 2), 0.0, 0.0))
    assert np.log(mode.scale) == pytest.approx(0.013, abs=1e-6)
