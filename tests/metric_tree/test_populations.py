"""Sizes of a region and a year: the table of populations, the variants with shares, and thirty known answers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import metric_tree
from benchmarks.metric_tree import contexts as benchmark
from metric_tree.axes import AXES, EXTENTS
from metric_tree.populations import BadPopulation, populations
from metric_tree.variants import variants

HEADER = "node_id,region,year,length_mm,width_mm,height_mm,document,source,written\n"


@pytest.fixture(scope="module")
def tree():
    return metric_tree.open()


def median(tree, name: str, where: str | None, axis: str = "length") -> float:
    prior = tree.find(name).prior(where=where)
    return float(prior.quantile(0.5)[prior.dims.index(axis)])


def test_known_answers(tree):
    """26 of thirty questions, half of which were not evaluated before the table was complete."""
    passed = 0
    for row in benchmark.questions():
        plain, there = benchmark.medians(tree, row["name"], row["where"], row["axis"])
        answer = float(row["mm"])
        passed += benchmark.moves_right(plain, there, answer) and abs(there / answer - 1) <= benchmark.MAX_ERROR
    assert passed >= 26


def test_every_row_has_a_node_with_its_axes_and_is_the_median_of_its_place_and_year(tree):
    for node_id, rows in populations().items():
        node = tree.node(node_id)
        dims = max(node.prior_dims, key=len)
        axes = AXES if dims[0] in AXES else EXTENTS
        assert len({(row.region, row.year) for row in rows}) == len(rows), node_id
        assert len({row.year is None for row in rows}) == 1, f"{node_id}: a row of every year contradicts one of a year"
        for row in rows:
            sizes = (row.length_mm, row.width_mm, row.height_mm)
            where = {"region": None if row.region == "world" else row.region, "year": row.year}
            prior = node.prior(dims, {name: value for name, value in where.items() if value is not None})
            for mm, dim in zip(sizes, axes, strict=True):
                if mm is not None:
                    assert prior.quantile(0.5)[dims.index(dim)] == pytest.approx(mm, rel=0.06), (row, dim)
            if axes is EXTENTS:
                stated = [mm for mm in sizes if mm is not None]
                assert stated == sorted(stated, reverse=True), row


def test_a_population_has_no_effect_on_other_countries_and_less_in_other_years(tree):
    """The cars of Japan do not change those of Singapore, which are in the same region."""
    japan, singapore, plain = (median(tree, "car", where) for where in ("japan", "singapore", None))
    assert japan < 0.94 * plain
    assert singapore == pytest.approx(plain, rel=0.03)
    assert median(tree, "car", "japan,2020") < median(tree, "car", "japan,1880") < 1.01 * plain
    phones = [median(tree, "mobile phone", str(year)) for year in (2004, 2010, 2015, 2022)]
    assert phones == sorted(phones)
    assert 102 < phones[1] < 123, "between the rows of 2008 and 2012"


def test_a_row_without_a_year_holds_for_every_year_and_one_of_the_world_needs_a_year(tree):
    assert median(tree, "door", "germany,1965") == pytest.approx(median(tree, "door", "germany"), rel=0.01)
    assert median(tree, "television", "1990") < 650
    assert median(tree, "television", "germany,1990") < 650
    assert median(tree, "television", "germany") > 900
    assert {"DE", "JP"} <= set(tree.find("door").contexts.regions)
    assert 1990 in tree.find("television").contexts.years


def test_variants_with_shares_of_a_region_and_a_year_replace_the_prior(tree):
    assert median(tree, "banknote", "usa", "width") == pytest.approx(66.3, rel=0.01)
    assert median(tree, "banknote", "gb,2010") == pytest.approx(149, rel=0.01)
    assert median(tree, "banknote", "gb,2024") == pytest.approx(139, rel=0.01)
    assert tree.find("mattress").prior(where="usa").tier == "measured"
    for node_id, rows in variants().items():
        places = {row.region for row in rows if row.region and row.share is not None}
        for place in places:
            for year in (2012, 2025):
                local = [row for row in rows if row.region == place and row.is_of(year)]
                if all(row.share for row in local):
                    assert sum(row.share for row in local) == pytest.approx(1, abs=0.021), (node_id, place, year)


def test_variants_without_shares_do_not_replace_a_measured_size(tree):
    """Food cans of norms are not the only ones; the table has no shares of them."""
    assert not np.allclose(tree.find("bathtub").prior(where="europe").covariances, 0)
    assert "so that the plain prior holds" in tree.find("bathtub").prior(where="europe").note


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("chair.n.01,Atlantis,,100,,,a,b,c\n", "region"),
        ("chair.n.01,US,12,100,,,a,b,c\n", "year"),
        ("chair.n.01,US,,,,,a,b,c\n", "sizes"),
        ("chair.n.01,US,,0,,,a,b,c\n", "length_mm"),
        ("chair.n.01,US,,100,,,,b,c\n", "document"),
    ],
)
def test_a_bad_row_is_one_line_with_its_place(tmp_path: Path, row: str, message: str):
    path = tmp_path / "populations.csv"
    path.write_text(HEADER + row, encoding="utf-8")
    with pytest.raises(BadPopulation, match=message) as error:
        populations(path)
    assert "\n" not in str(error.value)
    assert f"{path}:2" in str(error.value)
