"""Known lengths against objects: borne out, contradicted by most, contradicted by all."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import metric_tree
from estimator.posterior.posterior import Posterior, posterior
from estimator.records.objects import MeasuredObject
from estimator.records.options import EstimateOptions
from estimator.records.result import Mode, ScaleEvidence, ScaleResult
from estimator.results.estimate import (
    disagreement,
    known_length_conflict,
    scale_of_objects,
    single_category_reason,
)
from metric_tree.tree import Tree
from tests.synthetic.priors import evidence, prior

#: Half a metre a unit.
CHAIR, STOOL = (1.24, 1.20, 2.10), (0.84, 0.80, 1.52)


def length(scale: float, sd: float = 0.01) -> ScaleEvidence:
    return ScaleEvidence("known_length", "1", scale, sd, doubt=0.0)


def answer(
    tree: Tree, known: float | None, *objects: tuple[str, tuple[float, float, float]], trust: bool = False
) -> ScaleResult:
    items = [
        MeasuredObject(str(place), category, np.array(extents), np.full(3, 0.03))
        for place, (category, extents) in enumerate(objects)
    ]
    evidence = () if known is None else (length(known),)
    return scale_of_objects(items, tree, EstimateOptions(evidence=evidence, trust_known_length=trust))


@pytest.mark.parametrize("known", [5.0, 1.64, 1.27, 1.0, 0.75, 0.15, 0.05, 500.0])
def test_a_length_far_from_the_objects_is_reported(mini: Tree, known: float) -> None:
    """The true scale is 0.5: feet for metres, inches, a factor of two or of ten; none passes without a word."""
    result = answer(mini, known, ("swivel chair", CHAIR), ("bar stool", STOOL))
    (line,) = result.warnings
    assert "known lengths" in line
    stated = float(line.split(" m per unit")[0].rpartition(" ")[2])
    assert stated == pytest.approx(known, rel=0.01)
    (row,) = result.evidence
    assert (row.kind, row.scale) == ("known_length", known)
    assert row.reason is not None
    assert row.reason.startswith("the scale by the objects is")


@pytest.mark.parametrize("known", [5.0, 1.27, 0.15, 0.05, 500.0])
def test_a_length_that_contradicts_most_objects_is_unresolved_unless_trusted(mini: Tree, known: float) -> None:
    objects = (("swivel chair", CHAIR), ("bar stool", STOOL), ("swivel chair", CHAIR), ("bar stool", STOOL))
    result = answer(mini, known, *objects)
    assert (result.status, result.scale, result.interval) == ("unresolved", None, None)
    assert result.warnings[0].startswith("unresolved: the known lengths contradict the objects")
    trusted = answer(mini, known, *objects, trust=True)
    assert trusted.status == "resolved"
    assert trusted.scale == pytest.approx(known, rel=0.02)
    assert trusted.warnings[0].startswith("the known lengths contradict the objects")


@pytest.mark.parametrize(
    ("ratio", "units"),
    [(2.54, "inches and centimetres"), (1 / 3.28, "feet and metres"), (10, "millimetres and centimetres"),
     (12, "inches and feet"), (25.4, "millimetres and inches"), (39.4, "inches and metres"),
     (0.01, "centimetres and metres"), (1000, "millimetres and metres"), (1000 * 1.2, "millimetres and metres"),
     (1000 * 1.25, ""), (100 / 1.2, "centimetres and metres"), (100 / 1.25, ""), (5.5, "")],
)  # fmt: skip
def test_a_length_that_is_wrong_by_the_factor_of_units_says_so(mini: Tree, ratio: float, units: str) -> None:
    """Sizes by the objects are 0.5 metres per unit, about: the centre of their interval is the reference."""
    alone = answer(mini, None, ("swivel chair", CHAIR), ("bar stool", STOOL))
    assert alone.interval is not None
    centre = math.sqrt(alone.interval.low * alone.interval.high)
    (line,) = answer(mini, centre * ratio, ("swivel chair", CHAIR), ("bar stool", STOOL)).warnings
    assert line.count("a unit error") == bool(units)
    assert f"too {'large' if ratio > 1 else 'small'}: a unit error ({units})?" in line or not units


@pytest.mark.parametrize("known", [0.49, 0.5, 0.51])
def test_a_right_length_is_believed_without_a_word(mini: Tree, known: float) -> None:
    result = answer(mini, known, ("swivel chair", CHAIR), ("bar stool", STOOL))
    assert (result.status, result.warnings) == ("resolved", ())
    assert result.scale == pytest.approx(known, rel=0.02)
    assert result.evidence[0].verdict == "used"
    assert result.evidence[0].weight == 1.0


def test_objects_that_are_outliers_without_it_are_not_held_against_a_length() -> None:
    """Three agree with the length and one never did: its weight was not lost to the length."""
    chair = prior("chair.n.01", [(560, 540, 950)])
    items = [evidence(chair, (1.12, 1.08, 1.90), name=str(n)) for n in range(3)]
    items.append(evidence(chair, (9.0, 8.0, 20.0), name="far"))
    lines = np.array([[math.log(0.5), 0.01, 0.0]])
    assert known_length_conflict(posterior(items, lines), items, EstimateOptions(evidence=(length(0.5),))) is None
    assert known_length_conflict(posterior(items), items, EstimateOptions()) is None, "nothing is known"


def test_evidence_that_may_be_wrong_gives_way_to_the_objects(mini: Tree) -> None:
    objects = [
        MeasuredObject(str(n), name, np.array(size), np.full(3, 0.03))
        for n, (name, size) in enumerate([("swivel chair", CHAIR), ("bar stool", STOOL)] * 2)
    ]
    plain = scale_of_objects(objects, mini)
    right = scale_of_objects(objects, mini, EstimateOptions(evidence=(ScaleEvidence("gps", "csv", 0.52, 0.02),)))
    wrong = scale_of_objects(objects, mini, EstimateOptions(evidence=(ScaleEvidence("gps", "csv", 3.0, 0.02),)))
    mute = ScaleEvidence("gps", "csv", None, None, reason="the path is too short")
    silent = scale_of_objects(objects, mini, EstimateOptions(evidence=(mute,)))
    assert plain.scale is not None
    assert right.scale == pytest.approx(0.52, rel=0.02)
    assert right.evidence[0].verdict == "used"
    assert right.evidence[0].weight > 0.9
    assert right.interval is not None
    assert plain.interval is not None
    assert right.interval.high / right.interval.low < plain.interval.high / plain.interval.low
    assert wrong.scale == pytest.approx(plain.scale, rel=0.05)
    assert wrong.evidence[0].verdict == "outlier"
    assert wrong.warnings[0].startswith(
        f"gps csv: contradicts the rest: the scale by all other evidence is {wrong.scale:.4g}"
    )
    assert silent.scale == plain.scale
    assert silent.evidence[0].verdict == "skipped"
    assert silent.to_json()["evidence"][0] == {
        "kind": "gps",
        "id": "csv",
        "scale": None,
        "sd_log": None,
        "weight": 0.0,
        "verdict": "skipped",
        "reason": "the path is too short",
    }


def test_evidence_without_objects_is_an_answer(mini: Tree) -> None:
    result = scale_of_objects([], mini, EstimateOptions(evidence=(ScaleEvidence("marker", "7", 0.4, 0.02),)))
    assert result.scale == pytest.approx(0.4, rel=0.01)


def test_a_reason_that_begins_with_the_name_is_not_doubled(mini: Tree) -> None:
    result = answer(mini, None, ("unicorn", CHAIR))
    assert result.warnings[0].startswith("no node is called 'unicorn'")


def test_an_object_of_which_no_dimension_counts_is_skipped(mini: Tree) -> None:
    cut = MeasuredObject("1", "bar stool", np.array(STOOL), np.full(3, 0.03), truncated=np.ones(3, dtype=bool))
    whole = MeasuredObject("2", "swivel chair", np.array(CHAIR), np.full(3, 0.03))
    first, second = scale_of_objects([cut, whole], mini).objects
    assert (first.verdict, first.used, first.weight) == ("skipped", (), 0.0)
    assert first.reason == "every extent that its prior judges is truncated"
    assert second.verdict == "used"


@pytest.mark.parametrize(("known", "is_decisive"), [(0.38, True), (0.40, False), (0.60, False), (0.65, True)])
def test_a_length_in_a_tail_of_the_objects_is_decisive(known: float, is_decisive: bool) -> None:
    """On each side of `MIN_TAIL_MASS`, for lengths that are too small and too large: the tail is that on their side."""
    items = [evidence(prior(f"{name}.n.01", [(1000.0, 1000.0, 1000.0)]), (2.0, 2.0, 2.0), name=name) for name in "abc"]
    estimate = posterior(items, np.array([[math.log(known), 0.01, 0.0]]))
    conflict = known_length_conflict(estimate, items, EstimateOptions(evidence=(length(known),)))
    assert conflict is not None
    assert conflict.is_decisive == is_decisive
    assert ("probability by the objects is less than" in conflict.message) == is_decisive


@pytest.mark.parametrize(
    ("weights", "is_wrong"),
    [
        ([0.9, 0.4], False),  # one outlier: MIN_WRONG_LABELS is 2
        ([0.9, 0.4, 0.4], True),
        ([0.9] * 5 + [0.4] * 2, False),  # 0.29 of the objects: MIN_WRONG_LABEL_FRACTION is 0.3
        ([0.9] * 4 + [0.4] * 2, True),
        ([0.9, 0.51, 0.51], False),  # no outliers: MIN_OBJECT_WEIGHT is 0.5
        ([0.9, 0.49, 0.49], True),
    ],
)
def test_both_sides_of_the_outliers_of_a_single_category(weights: list[float], is_wrong: bool) -> None:
    chair = prior("chair.n.01", [(560, 540, 950)])
    items = [evidence(chair, (1.12, 1.08, 1.90), name=str(n)) for n in range(len(weights))]
    estimate = replace(posterior(items), weight=np.array(weights))
    reason = single_category_reason(estimate, items)
    assert (reason is not None) == is_wrong
    stool = evidence(prior("stool.n.01", [(420, 400, 760)]), (0.84, 0.8, 1.52), name="stool")
    two = replace(estimate, weight=np.array([*weights, 0.9]))
    assert single_category_reason(two, [*items, stool]) is None, "two categories"


@pytest.mark.parametrize(("gps", "outcome"), [(0.535, "used"), (0.9, "outlier")])
def test_evidence_that_is_probably_wrong_is_an_outlier(mini: Tree, gps: float, outcome: str) -> None:
    """On each side of `MIN_EVIDENCE_WEIGHT`, 0.5."""
    objects = [
        MeasuredObject(str(n), name, np.array(size), np.full(3, 0.03))
        for n, (name, size) in enumerate([("swivel chair", CHAIR), ("bar stool", STOOL)] * 2)
    ]
    (row,) = scale_of_objects(
        objects, mini, EstimateOptions(evidence=(ScaleEvidence("gps", "csv", gps, 0.02),))
    ).evidence
    assert (row.verdict, row.weight >= 0.5) == (outcome, outcome == "used")


@pytest.mark.parametrize(("kept", "is_decisive"), [(0.45, True), (0.55, False)])
def test_a_length_for_which_objects_lose_half_of_their_weight_is_decisive(kept: float, is_decisive: bool) -> None:
    items = [evidence(prior(f"{name}.n.01", [(1000.0, 1000.0, 1000.0)]), (2.0, 2.0, 2.0), name=name) for name in "abc"]
    estimate = posterior(items, np.array([[math.log(0.60), 0.01, 0.0]]))
    alone = posterior(items).weight
    conflict = known_length_conflict(
        replace(estimate, weight=kept * alone), items, EstimateOptions(evidence=(length(0.60),))
    )
    assert conflict is not None
    assert conflict.is_decisive == is_decisive


@pytest.mark.parametrize(("scale", "outcome"), [(0.85, "used"), (0.9, "outlier")])
def test_evidence_is_an_outlier_if_it_is_more_probably_wrong_than_right(scale: float, outcome: str) -> None:
    """Two chairs of half a metre a unit: positions at these scales have the probabilities 0.58 and 0.41."""
    chairs = [MeasuredObject(name, "chair", np.array([1.1, 1.1, 1.8]), np.full(3, 0.03)) for name in "ab"]
    positions = ScaleEvidence("gps", "walk", scale, 0.02)
    (row,) = scale_of_objects(chairs, metric_tree.open(), EstimateOptions(evidence=(positions,))).evidence
    assert row.verdict == outcome
    assert (row.weight >= 0.5) == (outcome == "used")
    assert 0.3 < row.weight < 0.7


def with_own_scales(own: list[float]) -> Posterior:
    """Return a posterior at scale 1 with the given scales of single objects."""
    items = [evidence(prior("cube", [(1000.0, 1000.0, 1000.0)]), (1.0, 1.0, 1.0))]
    return replace(posterior(items), modes=(Mode(1.0, 1.0),), own_scale=np.array(own))


@pytest.mark.parametrize(
    ("own", "is_doubtful"),
    [
        ([1.0] * 6 + [0.3, 0.5, 2.0, 4.0], False),  # 40 % of the objects
        ([1.0] * 5 + [0.3, 0.5, 2.0, 4.0], True),  # 44 %
        ([1.0] * 2 + [1.59, 1 / 1.59, 1.59], False),
        ([1.0] * 2 + [1.61, 1 / 1.61, 1.61], True),
        ([1.0, 3.0], False),  # two objects: the interval shows their contradiction
    ],
)
def test_objects_with_distant_scales_make_a_scale_uncertain(own: list[float], is_doubtful: bool) -> None:
    modes, reason = disagreement(with_own_scales(own))
    assert (reason is not None) == is_doubtful
    assert len(modes) == 1


@pytest.mark.parametrize(
    ("full_size", "models", "is_stated"),
    [
        (17, [1 / 12] * 3, True),  # 15 % of the objects
        (18, [1 / 12] * 3, False),
        (3, [1 / 12] * 2, True),
        (3, [1 / 12], False),
        (9, [0.041, 0.1], True),  # within a factor of 2.5
        (9, [0.039, 0.1], False),
        (9, [3.1, 3.1], True),  # most objects are the models
        (9, [2.9, 2.9], False),
    ],
)
def test_models_that_agree_are_a_second_mode(full_size: int, models: list[float], is_stated: bool) -> None:
    modes, reason = disagreement(with_own_scales([1.0] * full_size + models))
    assert (reason is not None and "agree on another scale" in reason) == is_stated
    if is_stated:
        assert modes[1].scale == pytest.approx(math.exp(float(np.median(np.log(models)))))


@pytest.mark.parametrize("ratio", [4, 12, 24, 87])
def test_models_among_furniture_leave_the_scale_uncertain(mini: Tree, ratio: int) -> None:
    """Stools as models and chairs at full size: both scales are stated."""
    small = tuple(side / ratio for side in STOOL)
    result = answer(mini, None, *[("swivel chair", CHAIR)] * 6, *[("bar stool", small)] * 3)
    assert result.status != "resolved"
    for scale in (0.5, 0.5 * ratio):
        assert any(mode.scale == pytest.approx(scale, rel=0.1) for mode in result.modes)


@pytest.mark.parametrize(("n_classes", "scales"), [(2, (0.66, 0.72)), (1, (0.8, 0.9))])
def test_a_length_is_improbable_below_one_in_ten_thousand_or_if_half_of_the_weight_is_lost(
    n_classes: int, scales: tuple[float, float]
) -> None:
    """Series of lengths ever farther from objects of two classes, which keep their weight, and of one."""
    items = [
        evidence(prior(f"c{k}.n.01", [(560, 540, 950)]), (1.12, 1.08, 1.90), name=str(k)) for k in range(n_classes)
    ]
    alone = posterior(items)
    mass = alone.curve.density / alone.curve.density.sum() * (1 - alone.curve.below - alone.curve.above)
    distance = {True: math.inf, False: math.inf}
    for scale in np.geomspace(*scales, 40):
        above = alone.curve.above + float(mass[alone.curve.log_scale > math.log(scale)].sum())
        estimate = posterior(items, np.array([[math.log(scale), 0.01, 0.0]]))
        conflict = known_length_conflict(estimate, items, EstimateOptions(evidence=(length(scale),)))
        assert conflict is not None
        kept = float(estimate.weight.sum() / alone.weight.sum())
        assert conflict.is_decisive == (above < 1e-4 or kept < 0.5)
        assert ("probability by the objects is less than 0.0001" in conflict.message) == (above < 1e-4 and kept >= 0.5)
        nearest = abs(math.log(above / 1e-4)) if n_classes == 2 else 4 * abs(math.log(kept / 0.5))
        distance[conflict.is_decisive] = min(distance[conflict.is_decisive], nearest)
    assert max(distance.values()) < 0.35  # within a third (the step of the grid), or 9 % of the weight, on both sides


@pytest.mark.parametrize(("n_right", "n_outliers", "is_warned"), [(5, 4, False), (5, 5, True), (3, 1, False)])
def test_outliers_are_a_warning_if_they_are_half_of_the_objects(
    mini: Tree, n_right: int, n_outliers: int, is_warned: bool
) -> None:
    """Each of the others has a scale of its own."""
    length, width, height = CHAIR
    others = [("swivel chair", (20 * 3**k * length, 20 * 3**k * width, 20 * 3**k * height)) for k in range(n_outliers)]
    objects = [("swivel chair", CHAIR), *[("bar stool", STOOL)] * (n_right - 1)]
    result = answer(mini, 0.5, *objects, *others, trust=True)
    assert [row.verdict for row in result.objects].count("outlier") == n_outliers
    found = [warning for warning in result.warnings if "objects are outliers: check their labels" in warning]
    assert bool(found) == is_warned
