"""What labels mean: a broader kind is stated and weighs less."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import metric_tree
from estimator.records.objects import BY_OUTLINES, MeasuredObject
from estimator.records.options import EstimateOptions
from estimator.records.result import ScaleEvidence
from estimator.results.estimate import scale_of_objects
from estimator.results.object_priors import resolve_categories
from metric_base.errors import InputError
from metric_tree.tree import Tree


@pytest.fixture(scope="module")
def shipped() -> Tree:
    return metric_tree.open()


def test_a_label_that_says_more_than_its_node_is_a_broader_kind(shipped: Tree) -> None:
    names = {"foosball table", "table", "dining table", "wooden cabinet", "cell phone", "flagship", "pen pot"}
    by_name = resolve_categories(shipped, names)
    assert [name for name, meaning in by_name.items() if meaning.is_broader] == ["flagship", "foosball table"]


def test_a_broader_kind_is_said_and_weighs_less(shipped: Tree) -> None:
    def result(category: str):  # type: ignore[no-untyped-def]
        table = MeasuredObject("1", category, np.array([1.4, 0.8, 0.75]), np.full(3, 0.05))
        chair = MeasuredObject("2", "chair", np.array([0.5, 0.5, 0.9]), np.full(3, 0.05))
        return scale_of_objects([table, chair], shipped).objects[0]

    plain, broader = result("table"), result("foosball table")
    assert plain.node == broader.node
    assert broader.notes == ("treated as the broader category table",)
    assert broader.weight < plain.weight


@pytest.mark.parametrize(("points", "weighs_less"), [(2, True), (10, True), (10_000, False)])
def test_outlines_with_few_points_weigh_less(points: int, weighs_less: bool, shipped: Tree) -> None:
    """The distance of an object that is measured by its outlines depends on its points."""
    chair = MeasuredObject("1", "chair", np.array([0.5, 0.5, 0.9]), np.full(3, 0.05))
    table = MeasuredObject("2", "table", np.array([1.4, 0.8, 0.75]) * 1.5, np.full(3, 0.05), points=points)
    outlined = replace(table, notes=(BY_OUTLINES,))
    by_points, by_outlines = (scale_of_objects([chair, item], shipped) for item in (table, outlined))
    assert (by_outlines.objects[1].weight < by_points.objects[1].weight - 0.02) == weighs_less
    assert by_outlines.objects[1].score == 1
    unplaced = replace(outlined, points=0)  # on the floor, without points
    assert scale_of_objects([chair, unplaced], shipped).objects[1].weight == by_points.objects[1].weight


def test_a_warning_shows_the_beginning_of_a_long_name(shipped: Tree) -> None:
    item = MeasuredObject("long", "x" * 100_000, np.array([0.5, 0.5, 0.9]), np.full(3, 0.03))
    assert max(map(len, scale_of_objects([item], shipped).warnings)) < 1000


@pytest.mark.parametrize(("wrong", "warned"), [(1, False), (2, True)])
def test_half_of_the_objects_as_outliers_is_a_warning(shipped: Tree, wrong: int, warned: bool) -> None:
    """Two of four outliers are a warning, one of four is not (`MIN_WARNED_OUTLIERS`, half of the objects)."""
    sizes = [
        ("chair", (0.5, 0.5, 0.9)),
        ("sofa", (2.0, 0.9, 0.85)),
        ("desk", (1.4, 0.7, 0.74)),
        ("bed", (2.0, 1.6, 0.9)),
    ]
    objects = [
        MeasuredObject(str(n), name, np.array(size) * (6.0 if n >= len(sizes) - wrong else 1.0), np.full(3, 0.02))
        for n, (name, size) in enumerate(sizes)
    ]
    evidence = (ScaleEvidence("gps", "csv", 1.0, 0.02),)
    result = scale_of_objects(objects, shipped, EstimateOptions(evidence=evidence))
    assert [item.verdict for item in result.objects].count("outlier") == wrong
    assert any(f"{wrong} of 4 objects are outliers" in line for line in result.warnings) == warned


@pytest.mark.parametrize("n_names", [50, 51])
def test_50_unknown_names_are_searched_for_similar_ones(n_names: int, monkeypatch: pytest.MonkeyPatch) -> None:
    given = []

    class Unknown:
        def find(self, name: str, _: object, advice: bool) -> None:
            given.append(advice)
            raise InputError(name)

    matches = resolve_categories(Unknown(), {str(number) for number in range(n_names)})  # type: ignore[arg-type]
    assert len(matches) == n_names
    assert given == [True] * 50 + [False] * (n_names - 50)
