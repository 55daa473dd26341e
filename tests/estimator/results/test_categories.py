"""What labels mean: a broader kind is said and weighs less."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

import metric_tree
from estimator.posterior.posterior import Estimate
from estimator.records.objects import MeasuredObject
from estimator.results.estimate import scale_of_objects
from estimator.results.object_priors import meanings
from estimator.results.scale_report import _outlier_warnings
from metric_tree.tree import Tree


@pytest.fixture(scope="module")
def shipped() -> Tree:
    return metric_tree.open()


def test_a_label_that_says_more_than_its_node_is_a_broader_kind(shipped: Tree) -> None:
    by_name = meanings(shipped, {"foosball table", "table", "dining table", "wooden cabinet", "cell phone"})
    assert [name for name, meaning in by_name.items() if meaning.broader] == ["foosball table"]


def test_a_broader_kind_is_said_and_weighs_less(shipped: Tree) -> None:
    def result(category: str):  # type: ignore[no-untyped-def]
        table = MeasuredObject("1", category, np.array([1.4, 0.8, 0.75]), np.full(3, 0.05))
        chair = MeasuredObject("2", "chair", np.array([0.5, 0.5, 0.9]), np.full(3, 0.05))
        return scale_of_objects([table, chair], shipped).objects[0]

    plain, broader = result("table"), result("foosball table")
    assert plain.node == broader.node
    assert broader.notes == ("read as the broader kind table",)
    assert broader.weight < plain.weight


def test_a_warning_shows_the_beginning_of_a_long_name(shipped: Tree) -> None:
    item = MeasuredObject("long", "x" * 100_000, np.array([0.5, 0.5, 0.9]), np.full(3, 0.03))
    assert max(map(len, scale_of_objects([item], shipped).warnings)) < 1000


@pytest.mark.parametrize(
    ("weights", "status", "lines"),
    [([0.9, 0.9, 0.1], "resolved", 0), ([0.9, 0.1, 0.9, 0.1], "resolved", 1), ([0.9, 0.1], "resolved", 0)],
)
def test_half_of_the_objects_as_outliers_is_said(weights: list[float], status: str, lines: int) -> None:
    estimate = cast(Estimate, SimpleNamespace(status=status, weight=np.array(weights)))
    assert len(_outlier_warnings(estimate)) == lines
