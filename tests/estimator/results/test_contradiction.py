"""Known lengths against objects: borne out, contradicted by most, contradicted by all."""

from __future__ import annotations

import math

import numpy as np
import pytest

from estimator.posterior.posterior import posterior
from estimator.records.measured_object import MeasuredObject
from estimator.records.result import ScaleResult
from estimator.results.contradiction import contradiction_of
from estimator.results.estimate import Options, scale_of_objects
from metric_tree.tree import Tree
from tests.made.priors import evidence, prior

#: Half a metre a unit.
CHAIR, STOOL = (1.24, 1.20, 2.10), (0.84, 0.80, 1.52)


def answer(tree: Tree, known: float | None, *objects: tuple[str, tuple[float, float, float]]) -> ScaleResult:
    items = [
        MeasuredObject(str(place), category, np.array(extents), np.full(3, 0.03))
        for place, (category, extents) in enumerate(objects)
    ]
    return scale_of_objects(items, tree, Options(known=() if known is None else ((math.log(known), 0.01),)))


@pytest.mark.parametrize("known", [5.0, 0.05, 500.0])
def test_a_length_that_contradicts_every_object_is_unresolved(mini: Tree, known: float) -> None:
    result = answer(mini, known, ("swivel chair", CHAIR), ("bar stool", STOOL))
    assert (result.status, result.scale, result.interval, result.exit_code) == ("unresolved", None, None, 3)
    (line,) = result.warnings
    assert line.startswith("unresolved: the known lengths contradict every object")
    assert f"{known:.4g} m per unit with the known lengths, 0.5" in line


def test_a_length_that_one_object_bears_out_is_told_but_resolved(mini: Tree) -> None:
    triple = (STOOL[0] / 3, STOOL[1] / 3, STOOL[2] / 3)
    result = answer(mini, 1.5, *[("swivel chair", CHAIR)] * 4, ("bar stool", triple))
    assert result.status == "resolved"
    assert result.scale == pytest.approx(1.5, rel=0.02)
    assert [item.weight for item in result.objects[:4]] == pytest.approx([0.0] * 4, abs=0.01)
    (line,) = result.warnings
    assert "4 of 5 objects are outliers" in line


def test_a_length_that_the_objects_bear_out_is_not_told(mini: Tree) -> None:
    result = answer(mini, 0.51, ("swivel chair", CHAIR), ("bar stool", STOOL))
    assert (result.status, result.warnings) == ("resolved", ())


def test_objects_that_are_outliers_without_it_are_not_held_against_a_length() -> None:
    """Three agree with the length and one never did: its weight was not lost to the length."""
    chair = prior("chair.n.01", [(560, 540, 950)])
    items = [evidence(chair, (1.12, 1.08, 1.90), name=str(n)) for n in range(3)]
    items.append(evidence(chair, (9.0, 8.0, 20.0), name="far"))
    found = posterior(items, np.array([[math.log(0.5), 0.01]]))
    assert contradiction_of(found, items) is None
    assert contradiction_of(posterior(items), items) is None, "nothing is known"


def test_a_reason_that_begins_with_the_name_is_not_doubled(mini: Tree) -> None:
    result = answer(mini, None, ("unicorn", CHAIR))
    assert result.warnings[0].startswith("category 'unicorn': no node bears this name")
