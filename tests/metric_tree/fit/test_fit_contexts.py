"""What regions and years explain, recovered from made sources; cells of rows; contexts of inner nodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from metric_tree.context import ContextModel, Where
from metric_tree.fit.contexts import class_contexts, context_lines, context_means, fit_context_model, inner_contexts
from metric_tree.prior import Prior

BETWEEN = np.array([0.01])


def plain(centre: float, shared: float = 0.01) -> Prior:
    one = np.array([[shared]])
    return Prior("car.n.01", ("length",), np.ones(1), np.array([[centre]]), one[None], one, 9, 3, {"product": 1.0}, 0.0)


def synthetic_classes(region: float, year: float, classes: int = 50, seed: int = 0):
    """Cells of classes whose sources differ by region and year in these parts of B."""
    generator = np.random.default_rng(seed)
    for _ in range(classes):
        places = dict(zip(("DE", "US", "IN", "CN"), generator.normal(0, np.sqrt(region), 4), strict=True))
        slope = generator.normal(0, np.sqrt(year))
        rows = []
        for source in range(6):
            own = generator.normal(0, np.sqrt(1 - region - year))
            place = str(generator.choice(list(places)))
            for when in (1990, 2018):
                effect = places[place] + own + (slope if when == 1990 else -slope)
                rows.append((8 + 0.1 * effect, f"s{source}", place, when))
        x, source, place, when = zip(*rows, strict=True)
        arrays = np.array(x)[:, None], np.array(source), np.full(len(x), "product")
        cells = context_means(*arrays, place, when, np.ones(len(x)))
        yield cells, np.array([1e-5]), BETWEEN


@pytest.mark.parametrize(("region", "year", "seed"), [(0.0, 0.0, 0), (0.3, 0.0, 1), (0.0, 0.3, 0)])
def test_the_shares_of_region_and_year_are_recovered(region: float, year: float, seed: int) -> None:
    model = fit_context_model(synthetic_classes(region, year, 60, seed))
    assert model.region == pytest.approx(region, abs=0.15)
    assert model.year == pytest.approx(year, abs=0.15)


def test_a_source_keeps_a_part_of_the_differences_that_its_region_explains() -> None:
    model = fit_context_model(synthetic_classes(0.99, 0.0, 4))
    assert 0.75 < model.region + model.year + model.own < 0.95


def test_noise_is_what_few_rows_leave_over_what_sources_differ_by() -> None:
    """Rows of two sources, four and two of them; an axis without a difference between sources tells nothing."""
    x = np.array([[8.0, 7.0]] * 4 + [[8.4, 7.2]] * 2)
    names = np.array(["a"] * 4 + ["b"] * 2), np.full(6, "product")
    cells = context_means(x, *names, ["DE"] * 6, [2015] * 6, np.ones(6))
    (line,) = context_lines(cells, np.array([0.08, 0.05]), np.array([0.2, 0.0]))
    assert line.noise == pytest.approx([0.08 / 4 / 0.2, 0.08 / 2 / 0.2])
    assert line.means == pytest.approx([8.0, 8.4])
    assert line.between == 0.2
    assert [rows.tolist() for rows in line.sources] == [[0], [1]]
    assert context_lines(cells[:1], np.array([0.08, 0.05]), np.array([0.2, 0.0])) == []


def test_rows_that_say_neither_region_nor_year_are_no_context() -> None:
    x = np.array([[8.0], [8.1], [8.2]])
    names = np.array(["a", "b", "c"]), np.array(["product", "product", "museum"])
    cells = context_means(x, *names, [None, "DE", "FR"], [None, None, 1700], np.ones(3))
    assert [(cell.source, cell.region, cell.year) for cell in cells] == [("b", "DE", None)]


def test_rooms_weigh_and_not_boxes() -> None:
    x = np.array([[8.0], [9.0], [9.0], [9.0], [9.0]])
    names = np.full(5, "rooms"), np.full(5, "measured")
    (cell,) = context_means(x, *names, ["US"] * 5, [2015] * 5, np.array([1, 0.25, 0.25, 0.25, 0.25]))
    assert cell.mean[0] == pytest.approx(8.5)
    assert cell.rows[0] == pytest.approx(4 / 1.25)


def test_a_node_has_the_contexts_of_its_children_by_their_weight() -> None:
    names = np.array(["a"]), np.array(["product"])
    children = []
    for centre, mean in ((8.0, 8.2), (7.0, 7.0)):
        cells = context_means(np.array([[mean]]), *names, ["DE"], [2010], np.ones(1))
        children.append(class_contexts(plain(centre), ("length",), cells, np.array([0.001])))
    (both,) = inner_contexts(children, np.array([0.75, 0.25]), BETWEEN)
    assert both.offset[0] == pytest.approx(0.75 * 0.2)
    (lone,) = inner_contexts([children[0], plain(7.0)], np.array([0.4, 0.6]), BETWEEN)
    assert lone.offset[0] == pytest.approx(0.2)
    assert lone.variance[0] > both.variance[0] + 0.01
    named = replace(children[0], node_id="car.n.01/other")
    (whole,) = inner_contexts([named, children[1]], np.array([0.0, 1.0]), BETWEEN, named)
    assert (whole.offset[0], whole.variance[0]) == (pytest.approx(0.2), pytest.approx(0.001))
    assert inner_contexts([children[0], plain(7.0)], np.array([0.1, 0.9]), BETWEEN) == ()


def test_a_class_seen_there_is_moved_there() -> None:
    names = np.array(["a"]), np.array(["product"])
    cells = context_means(np.array([[8.2]]), *names, ["DE"], [2010], np.ones(1))
    prior = class_contexts(plain(8.0), ("length",), cells, np.array([0.001]))
    model = ContextModel(0.3, 0.2, 0.0, 0.5, 12.0)
    moved = prior.in_context(Where("DE", 2010), model).means[0, 0]
    assert 8.0 < prior.in_context(Where("FR", 2010), model).means[0, 0] < moved < 8.2
