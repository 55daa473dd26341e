"""What would help: computed for each, honest about its order, silent where the scale is resolved."""

from __future__ import annotations

import json
import math
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import metric_tree
from estimator.evidence.known_lengths import ObjectLength
from estimator.posterior.posterior import posterior
from estimator.records.objects import Box, MeasuredObject, Measurements, Up
from estimator.records.options import EstimateOptions
from estimator.records.result import ScaleEvidence
from estimator.records.scene import Scene
from estimator.results import advice
from estimator.results.estimate import scale_of_objects
from estimator.results.object_priors import object_evidence, resolve_categories
from metric_base.errors import InputError
from metric_cli.estimate_scale.estimate import main
from metric_tree.tree import Tree

VASE = MeasuredObject("1", "vase", np.array([0.2, 0.2, 0.5]), np.full(3, 0.03))
DESK = MeasuredObject("2", "desk", np.array([1.6, 0.8, 0.74]), np.full(3, 0.03))


@pytest.fixture(scope="module")
def tree() -> Tree:
    return metric_tree.open()


def test_a_known_height_is_worth_what_it_says(tree: Tree) -> None:
    """The stated narrowing is approximately that of the posterior with this known length."""
    alone = scale_of_objects([VASE], tree)
    assert alone.status != "resolved"
    (length,) = [one for one in alone.would_help if "known length" in one.what]
    assert length.object == "vase 1"
    line = ScaleEvidence("known_length", "1", scale=alone.modes[0].scale, sd_log=0.032, doubt=0.0)
    known = scale_of_objects([VASE], tree, EstimateOptions(evidence=(line,)))
    assert known.interval is not None
    before, after = estimate_width(alone), np.log(known.interval.high / known.interval.low)
    assert length.narrows_by == pytest.approx(1 - after / before, abs=0.05)


def test_an_outlier_is_not_suggested_as_a_known_length(tree: Tree) -> None:
    """A bench of the height of a house is the object with the smallest error, but probably not a bench."""
    bench = MeasuredObject("6", "bench", np.array([15.0, 4.0, 8.0]), np.full(3, 0.01))
    doubtful = scale_of_objects([VASE, replace(VASE, id="5"), DESK, bench], tree)
    assert doubtful.objects[3].verdict == "outlier"
    assert doubtful.would_help
    assert "bench 6" not in [one.object for one in doubtful.would_help if "known length" in one.what]


def test_best_comes_first_and_a_resolved_scale_needs_none(tree: Tree) -> None:
    alone = scale_of_objects([VASE], tree)
    narrowing = [one.narrows_by for one in alone.would_help]
    assert narrowing == sorted(narrowing, reverse=True)
    assert min(narrowing) >= 0.05
    chair = MeasuredObject("3", "office chair", np.array([0.65, 0.62, 1.0]), np.full(3, 0.03))
    several = scale_of_objects([VASE, DESK, chair, replace(chair, id="4")], tree)
    assert (several.status, several.would_help) == ("resolved", ())
    assert "would_help" not in several.to_json()


def test_truncated_and_unmeasured_objects_are_named(tree: Tree) -> None:
    cut = replace(DESK, truncated=np.array([True, True, False]), sigma=np.full(3, 0.3))
    lost = MeasuredObject("9", "toilet", np.full(3, np.nan), np.full(3, np.nan), skipped="too few points")
    said = {one.object: one.what for one in scale_of_objects([cut, lost], tree).would_help}
    assert "side that is cut" in said.get("desk 2", "") or "toilet 9" in said
    nothing = scale_of_objects([lost], tree)
    assert nothing.status == "unresolved"
    assert [one.object for one in nothing.would_help if "could not be measured" in one.what] == ["toilet 9"]


def test_evidence_without_objects_says_what_would_help(tree: Tree) -> None:
    mute = ScaleEvidence("camera_height", "floor", None, None, reason="no floor was found under the cameras")
    rough = ScaleEvidence("camera_height", "floor", 0.5, 0.22)
    for line, status in ((mute, "unresolved"), (rough, "uncertain")):
        result = scale_of_objects([], tree, EstimateOptions(evidence=(line,)))
        assert result.status == status
        assert [one.what for one in result.would_help if "if there is one" in one.what]
    assert scale_of_objects([], tree).would_help == ()


def test_errors_that_go_together_end_with_the_sides_that_are_supposed(tree: Tree) -> None:
    together = 0.09 * np.full((3, 3), 0.95) + 0.0045 * np.eye(3)
    cut = replace(DESK, truncated=np.array([True, True, False]), sigma=np.full(3, 0.3), covariance=together)
    result = scale_of_objects([cut, replace(cut, id="5")], tree)
    assert result.status != "resolved"
    assert result.would_help


@pytest.mark.parametrize(
    ("sigma", "n_evaluated", "is_suggested"), [(0.2, 6, True), (0.2, 1, True), (0.2, 0, False), (0.05, 6, False)]
)
def test_a_suggestion_narrows_the_interval_by_a_twentieth_or_more(
    tree: Tree, monkeypatch: pytest.MonkeyPatch, sigma: float, n_evaluated: int, is_suggested: bool
) -> None:
    """The truncated length of a desk, whose other sides have this error: images narrow by 7 % or by 3 %."""
    monkeypatch.setattr(advice, "SUGGESTED_CATEGORIES", ())
    monkeypatch.setattr(advice, "MAX_TRUNCATED_OBJECTS", n_evaluated)
    cut = replace(DESK, truncated=np.array([True, False, False]), sigma=np.array([0.3, sigma, sigma]))
    rough = ScaleEvidence("gps", "walk", 0.5, 0.3)
    result = scale_of_objects([cut], tree, EstimateOptions(evidence=(rough,)))
    assert any("two more images" in one.what for one in result.would_help) == is_suggested
    assert any("known length" in one.what for one in result.would_help)


def estimate_width(result: object) -> float:
    """Log width of the 90 % interval of the curve."""
    curve = result.curve  # type: ignore[attr-defined]
    mass = curve.below + np.cumsum(curve.density) / curve.density.sum() * (1 - curve.below - curve.above)
    low, high = np.interp([0.05, 0.95], mass, curve.log_scale)
    return float(high - low)


def test_the_option_of_the_best_measurement_helps(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """The true height of an object of the rendered room, measured as the result suggests, narrows the interval."""
    room = Path("data/scenes/demo_room")
    document = json.loads((room / "instances.json").read_text())
    kept = {row["id"] for row in document["categories"] if row["name"] in {"potted plant", "tv stand"}}
    document["annotations"] = [row for row in document["annotations"] if row["category_id"] in kept]
    (tmp_path / "few.json").write_text(json.dumps(document))
    command = [str(room), "--instances", str(tmp_path / "few.json"), "--json"]
    main(command)
    alone = json.loads(capsys.readouterr().out)
    assert alone["status"] == "uncertain"
    truth = json.loads((room / "truth.json").read_text())
    heights = {row["category"]: row["truth_m"]["height"]["value"] for row in truth["objects"]}
    (best,) = [row for row in alone["would_help"] if "height METRES" in (row.get("option") or "")]
    plant = best["object"].rpartition(" ")[0]
    words = shlex.split(best["option"].replace("METRES", f"{100 * heights[plant]:.1f}cm"))
    assert main([*command, *words]) == 0
    known = json.loads(capsys.readouterr().out)
    low, high = known["interval"]["low"], known["interval"]["high"]
    assert low < truth["metres_per_unit"] < high
    assert math.log(high / low) < 0.5 * math.log(alone["interval"]["high"] / alone["interval"]["low"])
    assert known["status"] == "resolved"


def test_intervals_after_a_measurement_are_those_of_all_evidence(tree: Tree) -> None:
    """The likelihoods of other classes are not computed again, for classes of one and of several objects."""
    chairs = [MeasuredObject(str(n), "chair", np.array([0.5, 0.48, 0.9 + 0.02 * n]), np.full(3, 0.05)) for n in (3, 4)]
    items = (VASE, DESK, *chairs)
    before = object_evidence(items, resolve_categories(tree, {item.category for item in items})).objects
    estimate = posterior(before)
    for index in range(len(items)):
        changed = replace(before[index], object=replace(items[index], extents=1.1 * items[index].extents))
        after = [changed if number == index else item for number, item in enumerate(before)]
        of_class = [item for item in after if item.prior is changed.prior]
        assert estimate.with_class(of_class) == pytest.approx(posterior(after).interval, rel=2e-3)
    length = np.array([[math.log(1.05), 0.03, 0.0]])
    assert estimate.with_length(1.05, 0.03) == pytest.approx(posterior(before, length).interval, rel=2e-3)


def boxed(name: str, x: float, **fields: Any) -> MeasuredObject:
    extents = np.array([0.5, 0.4, 0.9])
    box = Box(np.array([x, 0.0, 0.0]), np.eye(3), extents)
    return replace(MeasuredObject(name, "chair", extents, np.full(3, 0.05), box=box, views=3), **fields)


def test_lengths_of_named_objects(tmp_path: Path) -> None:
    objects = (boxed("1", 0.0), boxed("2", 3.0), boxed("3", 3.0, truncated=np.array([True, False, True])))
    up = Up(np.array([0.0, 0.0, 1.0]), "given", 1.0)
    measurements = Measurements(objects, up, (), ())
    scene = Scene(tmp_path, "memory", (), np.zeros((0, 3)))
    (height,) = ObjectLength("chair 1", "height", 0.45).observe(scene, measurements)
    assert (height.scale, height.doubt) == (pytest.approx(0.5), 0.0)
    assert height.sd_log == pytest.approx(math.hypot(0.05, 0.01))
    (distance,) = ObjectLength("chair 1", "chair 2", 1.5).observe(scene, measurements)
    assert distance.scale == pytest.approx(0.5)
    assert distance.sd_log is not None
    assert distance.sd_log < 0.05
    for other in ("height", "chair 2"):
        (skipped,) = ObjectLength("chair 3", other, 1.5).observe(scene, measurements)
        assert (skipped.scale, "not determined" in str(skipped.reason)) == (None, True)
    with pytest.raises(InputError, match=r"object: expected one of chair 1, chair 2, chair 3, found 'door"):
        ObjectLength("door 1", "height", 2.0).observe(scene, measurements)
