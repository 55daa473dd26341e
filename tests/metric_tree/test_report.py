"""The report of a small release: its tables, its page, and what it says of another release."""

import json

import pytest

from metric_tree.commands import main
from metric_tree.report import changed_sizes, coverage, covered_items, level_counts, page, source_counts, typical_nodes
from metric_tree.report_figures import size_figure
from metric_tree.tree import Tree
from taxonomy.vocabularies import Label
from tests import minitree


@pytest.fixture
def tree(tmp_path):
    return Tree(minitree.release(tmp_path / "now"))


def test_levels_count_nodes_with_enough_items(tree):
    rows = {row[0]: row[1:] for row in level_counts(tree)}
    assert set(rows) == {1, 2, 3, 4, 5}
    assert rows[5] == (6, 6, 1, 0)


def test_sources_say_what_they_give(tree):
    assert source_counts(tree)[0][:3] == ("made for tests", "product", "CC0-1.0")


def test_coverage_counts_labels_with_priors(tree):
    labels = [
        Label("desk chair", "swivel_chair.n.01", "name"),
        Label("stool", "mt:bar_stool", "name"),
        Label("chair", "chair.n.01", "name"),
        Label("dragon", "dragon.n.02", "name"),
        Label("sky", None, "stuff"),
    ]
    found = coverage(tree, "made", labels)
    assert (found.labels, found.enough, found.real, found.any) == (4, 1, 2, 2)
    assert covered_items(tree, labels[2]) is None


def test_only_categories_with_a_prior_are_drawn(tree):
    assert typical_nodes(tree) == []


def test_sizes_are_drawn_as_one_figure(tree):
    figure = size_figure([tree.node("swivel_chair.n.01"), tree.node("mouse.n.01")])
    assert figure.startswith("<svg")
    assert figure.count("<svg") == 1


def test_a_moved_median_is_found_and_an_unmoved_one_is_not(tmp_path, tree):
    content = minitree.rows()
    for prior in content["priors.parquet"]:
        if prior["node_id"] == "swivel_chair.n.01":
            prior["means"] = [[value + 0.5 for value in mean] for mean in prior["means"]]
    before = Tree(minitree.release(tmp_path / "before", content))
    assert {row[0] for row in changed_sizes(tree, before)} == {"swivel chair"}
    assert changed_sizes(tree, tree) == []


def test_the_page_holds_every_section_and_no_script(tree, tmp_path):
    content = minitree.rows()
    content["nodes.parquet"][-1]["name"] = "rat <b>"
    text = page(tree, Tree(minitree.release(tmp_path / "before", content)))
    for title in (
        "What it holds",
        "Where it comes from",
        "Words of detectors",
        "What to look at",
        "What changed since",
    ):
        assert title in text
    assert "<script" not in text
    assert "made for tests" in text
    assert text.count("<svg") == 1


def test_the_same_release_gives_the_same_page(tree):
    assert page(tree) == page(tree)


def test_the_command_writes_the_page_and_its_figures(tmp_path, tree, capsys):
    out = tmp_path / "page.html"
    assert main(["report", str(tree.release.directory), "--out", str(out), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["page"] == str(out)
    assert figures["levels"][-1]["with_10"] == 1
    assert out.read_text(encoding="utf-8").startswith("<!doctype html>")
    assert list(tmp_path.glob(".*part")) == []


def test_an_unknown_release_is_one_line(tmp_path, capsys):
    out = tmp_path / "page.html"
    assert main(["report", str(tmp_path / "nothing"), "--out", str(out)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not out.exists()
