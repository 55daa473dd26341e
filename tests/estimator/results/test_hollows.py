"""A sink's underside is not seen: its height is truncated, and words say which height is meant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import metric_tree
from estimator.records.objects import MeasuredObject
from estimator.records.options import EstimateOptions
from estimator.records.result import ObjectReport
from estimator.results.estimate import scale_of_objects
from estimator.results.object_priors import HIDDEN_UNDERSIDE, visible_truncations
from metric_tree.tree import Tree

SINK = MeasuredObject("1", "sink", np.array([0.56, 0.44, 0.15]), np.full(3, 0.03))


@pytest.fixture(scope="module")
def tree() -> Tree:
    return metric_tree.open()


def test_the_height_of_a_sink_ends_inside(tree: Tree) -> None:
    report = _report(SINK, tree)
    assert (report.truncated, report.used, report.notes) == (("height",), ("length", "width"), (HIDDEN_UNDERSIDE,))


@pytest.mark.parametrize(
    "whole",
    [
        replace(SINK, unsupported_height=0.15),  # it reaches down to its support
        replace(SINK, extents=np.array([np.nan, np.nan, 0.15])),  # its height is all that it states
        replace(SINK, vertical_known=False),
        replace(SINK, category="bowl"),
    ],
)
def test_other_heights_are_whole(whole: MeasuredObject, tree: Tree) -> None:
    report = _report(whole, tree)
    assert (report.truncated, report.notes) == ((), ())


def test_a_method_of_heights_alone_keeps_the_height(tree: Tree) -> None:
    report = scale_of_objects([SINK], tree, EstimateOptions(method="height")).objects[0]
    assert (report.used, report.truncated) == (("height",), ())


def test_no_picture_can_show_an_underside() -> None:
    cut = replace(SINK, truncated=np.array([True, False, True]))
    assert visible_truncations(cut).tolist() == [True, False, True]
    assert visible_truncations(replace(cut, notes=(HIDDEN_UNDERSIDE,))).tolist() == [True, False, False]


def test_a_wrong_height_says_which_height_is_usual(tree: Tree) -> None:
    sofas = [MeasuredObject(str(n), "sofa", np.array([2.1, 0.9, 0.85]), np.full(3, 0.03)) for n in range(2, 5)]
    tall = MeasuredObject("1", "bathtub", np.array([1.65, 0.75, 3.5]), np.full(3, 0.03))
    report = scale_of_objects([tall, *sofas], tree).objects[0]
    assert (report.verdict, str(report.reason).endswith("(rim to floor, outside)")) == ("outlier", True)


def _report(item: MeasuredObject, tree: Tree) -> ObjectReport:
    return scale_of_objects([item], tree).objects[0]
