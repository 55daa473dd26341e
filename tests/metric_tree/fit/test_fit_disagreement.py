"""How sources disagree: the covariance between them is recovered, shrunk and pooled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from metric_tree.axes import AXES
from metric_tree.fit import evidence_model as kinds
from metric_tree.fit.class_prior import class_mean, class_prior, shrunk_between
from metric_tree.fit.evidence_model import EvidenceModel, fit_evidence_model
from metric_tree.fit.moments import VAGUE
from metric_tree.fit.random_effects import source_means, with_statements
from metric_tree.fit.rows import KIND_WEIGHT, ClassRows, Statements

BETWEEN = np.array([[0.04, 0.02, 0.01], [0.02, 0.03, 0.0], [0.01, 0.0, 0.02]])
WITHIN = 0.02 * np.eye(3)


def many_sources(sources: int, rows: int, seed: int = 0):
    generator = np.random.default_rng(seed)
    effects = generator.multivariate_normal(np.zeros(3), BETWEEN, sources)
    names = np.repeat([f"s{number:03d}" for number in range(sources)], rows)
    x = 6 + np.repeat(effects, rows, axis=0) + generator.multivariate_normal(np.zeros(3), WITHIN, sources * rows)
    return x, names.tolist(), effects


def found_of(x, names):
    return source_means(x, np.ones_like(x), np.ones(len(x)), names, ["product"] * len(x), WITHIN)


def test_covariance_between_sources_is_recovered():
    x, names, effects = many_sources(300, 4)
    found = found_of(x, names)
    assert found.between == pytest.approx(np.cov(effects.T), abs=0.005)
    assert found.within == pytest.approx(WITHIN, abs=0.003)
    assert found.freedom == 299


def test_no_disagreement_is_found_where_there_is_none():
    generator = np.random.default_rng(0)
    estimates = []
    for _ in range(40):
        x = generator.multivariate_normal(np.zeros(3), WITHIN, 60)
        estimates.append(found_of(x, [f"s{number % 6}" for number in range(60)]).between.trace() / 3)
    assert np.mean(estimates) < 0.1 * WITHIN[0, 0]  # clipped at nothing, hence a little above it


def test_the_model_learns_from_classes_of_several_sources():
    classes = [found_of(*many_sources(6, 10, seed)[:2]) for seed in range(40)]
    expected = learned(classes).between(WITHIN, "objects")
    assert expected.trace() == pytest.approx(BETWEEN.trace(), rel=0.2)


def test_the_model_tells_a_share_of_the_spread_from_a_fixed_spread():
    classes = []
    for number in range(60):
        generator = np.random.default_rng(number)
        within = generator.choice([0.003, 0.03, 0.3]) * np.eye(3)
        effects = generator.multivariate_normal(np.zeros(3), 0.5 * within, 6)
        x = np.repeat(effects, 20, axis=0) + generator.multivariate_normal(np.zeros(3), within, 120)
        names = [f"s{row // 20}" for row in range(120)]
        classes.append(source_means(x, np.ones_like(x), np.ones(120), names, ["product"] * 120, within))
    model = learned(classes)
    assert model.family["objects"] * model.share == pytest.approx(0.5, rel=0.35)
    assert model.spread < 0.03


def test_a_mixed_class_does_not_spoil_the_model():
    classes = [found_of(*many_sources(4, 10, seed)[:2]) for seed in range(30)]
    x, names, _ = many_sources(4, 10, 99)
    x[:10] += 3.0  # a toy among the lorries
    both = (classes, [*classes, found_of(x, names)])
    one, other = (learned(some).between(WITHIN, "objects").trace() for some in both)
    assert other < 1.3 * one


def learned(classes) -> EvidenceModel:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kinds, "SHIPPED_CLASSES", 0.0)  # what these classes say alone
        return fit_evidence_model((("objects", one) for one in classes), sorted(KIND_WEIGHT))


def kinds_apart(seed: int, museum: float = 0.4, spread: float = 0.3):
    """A class of four shops and two museums, whose pieces are larger and far apart."""
    generator = np.random.default_rng(seed)
    x, names, _ = many_sources(6, 10, seed)
    kinds = ["museum" if name in {"s000", "s001"} else "product" for name in names]
    for name in ("s000", "s001"):
        x[np.asarray(names) == name] += museum + generator.normal(0, spread)
    return source_means(x, np.ones_like(x), np.ones(len(x)), names, kinds, WITHIN)


def test_the_bias_and_the_spread_of_a_kind_are_learned_and_do_not_spoil_the_rest():
    model = learned([kinds_apart(seed) for seed in range(60)])
    product = model.bias_of("product", "objects")
    assert model.bias_of("museum", "objects") - product == pytest.approx(0.4, abs=0.12)
    assert model.excess["museum"] == pytest.approx(0.3, rel=0.4)
    assert model.between(WITHIN, "objects").trace() == pytest.approx(BETWEEN.trace(), rel=0.4)


def test_museums_do_not_set_the_centre_of_a_class_that_has_anything_better():
    model = EvidenceModel(0.3, 0.05, {"museum": 0.35, "judged": 0.1})
    x = np.tile([5.4, 5.2, 5.5], (40, 1)) + np.random.default_rng(0).normal(0, 0.2, (40, 3))
    museum = source_means(x, np.ones_like(x), np.ones(40), ["museum"] * 40, ["museum"] * 40, WITHIN)
    stated = with_statements(
        museum,
        Statements(
            ("judged",), ("judged",), np.array([[4.7, 4.4, 4.6]]), np.full((1, 3), np.nan), np.ones(3, dtype=bool)
        ),
    )
    centre = class_mean(stated, shrunk_between(stated, model, ""), model, "").mean
    assert np.abs(centre - [4.7, 4.4, 4.6]).max() < 0.2
    assert class_mean(museum, shrunk_between(museum, model, ""), model, "").mean == pytest.approx(x.mean(axis=0))


def test_a_class_of_one_source_carries_the_models_disagreement():
    x, names, _ = many_sources(1, 30)
    rows = ClassRows("n", AXES, x, np.arange(30), tuple(names), ("product",) * 30, np.full((30, 3), np.nan), 30)
    prior = class_prior(rows, VAGUE, EvidenceModel(0.5, 0.1))
    assert prior.n_sources == 1
    within = np.einsum("k,kii->i", prior.weights, prior.covariances)
    known = np.diag(prior.shared_covariance)  # the disagreement, and how well one source knows the centre
    assert known == pytest.approx(2 * (0.5 * within + 0.01) + within / 30, rel=0.25)


def test_a_class_of_many_sources_carries_its_own():
    found = found_of(*many_sources(100, 5)[:2])
    assert shrunk_between(found, EvidenceModel(0.0, 0.0), "") == pytest.approx(found.between, rel=0.05)


def test_offsets_of_sources_are_predicted_and_shrunk():
    x, names, effects = many_sources(40, 20)
    found = found_of(x, names)
    predicted = class_mean(found, BETWEEN, EvidenceModel(), "").effects
    centred = effects - effects.mean(axis=0)
    assert np.corrcoef(predicted.ravel(), centred.ravel())[0, 1] > 0.95
    assert np.abs(class_mean(found, 1e-6 * np.eye(3), EvidenceModel(), "").effects).max() < 0.01


def test_the_spread_within_is_not_counted_twice():
    """Ten sources far apart: components hold the spread of one source, the shared covariance the rest."""
    x, names, _ = many_sources(10, 40)
    n = len(x)
    rows = ClassRows("n", AXES, x, np.arange(n), tuple(names), ("product",) * n, np.full((n, 3), np.nan), n)
    prior = class_prior(rows, VAGUE, EvidenceModel(), heldout=False)
    within = np.einsum("k,kii->i", prior.weights, prior.covariances)
    assert within == pytest.approx(np.diag(WITHIN), rel=0.25)
    assert np.diag(prior.shared_covariance) == pytest.approx(np.diag(BETWEEN), rel=0.9)


def test_axes_that_a_source_does_not_state_are_left_out():
    x, names, _ = many_sources(4, 5)
    known = np.ones_like(x)
    known[:5, 1] = 0
    found = source_means(x, known, np.ones(len(x)), names, ["product"] * len(x), WITHIN)
    assert np.isnan(found.means[0, 1])
    assert found.rows[0].tolist() == [5, 0, 5]
    centre = class_mean(replace(found, within=WITHIN), 0.01 * np.eye(3), EvidenceModel(), "")
    assert centre.effects[0, 1] == 0
    assert centre.variance[1] > centre.variance[0]
    assert np.isfinite(centre.effects).all()
