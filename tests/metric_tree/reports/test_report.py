"""The report of a small release: its tables, its page, and the comparison with another release."""

import json

import numpy as np
import pytest

from explorer.pages.report_page import page, report_html, size_figures
from explorer.pages.templating import environment, link_html
from metric_cli.subcommands import main
from metric_tree.reports.summary import (
    coverage,
    covered_items,
    disagreements,
    known_shares,
    level_counts,
    mixed_leaves,
    source_counts,
    typical_nodes,
)
from metric_tree.tree import Tree
from taxonomy.label_lists import Label
from tests.synthetic import minitree


@pytest.fixture
def tree(tmp_path):
    return Tree(minitree.release(tmp_path / "now"))


def test_levels_count_nodes_with_enough_items(tree):
    rows = {row[0]: row[1:] for row in level_counts(tree)}
    assert set(rows) == {1, 2, 3, 4, 5}
    assert rows[5] == (6, 6, 1, 0)


def test_sources_say_what_they_give(tree):
    assert source_counts(tree)[0][:3] == ("made for tests", "product", "CC0-1.0")


def test_shares_of_items_that_know_year_and_region(tree, tmp_path):
    content = minitree.rows()
    for number, row in enumerate(content["items.parquet"]):
        row["year"], row["region"] = (2001 if number < 10 else None), None
        row["kind"] = "judged" if number == 0 else row["kind"]
    assert known_shares(Tree(minitree.release(tmp_path / "dated", content))) == (39, pytest.approx(9 / 39), 0)


def test_sources_differ_as_much_as_on_the_axis_on_which_they_differ_most(tmp_path):
    content = minitree.rows()
    for prior in content["priors.parquet"]:
        prior["n_sources"] = 3
        sizes = np.linspace(0.01, 0.04, len(prior["dims"]))
        prior["shared_covariance"] = np.diag(sizes).tolist()
    rows = disagreements(Tree(minitree.release(tmp_path / "several", content)))
    assert rows
    assert all(sources == 3 and spread == pytest.approx(100 * np.expm1(0.2)) for _, sources, _, spread in rows)


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


def test_ten_items_are_enough(tmp_path):
    for n_items, enough in ((9, 0), (10, 1)):
        content = minitree.rows()
        for node in content["nodes.parquet"]:
            node["n_items"] = n_items if node["node_id"] == "swivel_chair.n.01" else node["n_items"]
        tree = Tree(minitree.release(tmp_path / str(n_items), content))
        assert coverage(tree, "made", [Label("desk chair", "swivel_chair.n.01", "name")]).enough == enough


def test_only_categories_with_a_prior_are_drawn(tree):
    assert typical_nodes(tree) == []


def test_each_dimension_has_a_chart_with_the_published_items(tree):
    figures = size_figures(tree.node("swivel_chair.n.01"))
    assert [caption for caption, _ in figures] == [f"swivel chair: {dim}" for dim in ("length", "width", "height")]
    assert all(chart.startswith("<svg") and 'class="kind-product"' in chart for _, chart in figures)


def test_a_class_of_two_kinds_is_named_with_its_parts(tmp_path, tree):
    assert mixed_leaves(tree) == []
    content = minitree.rows()
    for prior in content["priors.parquet"]:
        if prior["node_id"] == "swivel_chair.n.01" and len(prior["dims"]) == 3:
            prior["weights"] = [0.7, 0.3]
            prior["means"] = [[6.0] * 3, [8.0] * 3]
            prior["covariances"] = [prior["covariances"][0]] * 2
    two = Tree(minitree.release(tmp_path / "two", content))
    assert mixed_leaves(two) == [("furniture > seat > chair > swivel chair", 14, "403 mm (70%), 2981 mm (30%)")]


def table(head, rows):
    return environment().get_template("report_pieces.html").module.table(head, rows)


def test_numbers_stand_to_the_right_and_text_is_escaped():
    text = table(
        ("what", "how many", "share"), [("<b>", 1200, "70 (59%)"), (link_html("a", "https://x.org/?a&b"), 3, "–")]
    )
    assert "<td>&lt;b&gt;</td><td class=n>1,200</td><td>70 (59%)</td>" in text
    assert '<td><a href="https://x.org/?a&amp;b">a</a></td>' in text
    assert "<a" not in table(("x",), [(link_html("a", "javascript:alert()"),)])


def test_a_tree_that_is_none_has_no_page(tmp_path, capsys):
    content = minitree.rows()
    content["nodes.parquet"][-1]["parent_id"] = "nowhere"
    minitree.release(tmp_path / "r", content)
    assert main(["report", str(tmp_path / "r"), "--out", str(tmp_path / "page.html")]) == 2
    assert "parent_id: expected the id of a node; found 'nowhere'" in capsys.readouterr().err
    assert not (tmp_path / "page.html").exists()


def test_text_cannot_turn_round_or_hide_what_stands_beside_it():
    page = report_html("report_base.html", "a\u202eb", "\x1b[2J", sections=["c\ud800"]) + table(
        ["d\u200b"], [["e\u2066"]]
    )
    assert not any(mark in page for mark in "\u202e\x1b\ud800\u200b\u2066")
    assert "a\\u202eb" in page
    page.encode()


def test_the_page_holds_every_section_and_no_script_but_its_own(tree, tmp_path):
    content = minitree.rows()
    content["nodes.parquet"][-1]["name"] = "rat <b>"
    content["priors.parquet"][0]["means"] = [[value + 0.5 for value in content["priors.parquet"][0]["means"][0]]]
    content["priors.parquet"][0]["weights"] = [1.0]
    content["priors.parquet"][0]["covariances"] = content["priors.parquet"][0]["covariances"][:1]
    text = page(tree, Tree(minitree.release(tmp_path / "before", content)))
    for title in (
        "Find a category",
        "What it holds",
        "Where it comes from",
        "Words of detectors",
        "What to look at",
        "What changed since",
        "Priors that moved (1)",
        "Renamed (1)",
        "W2",
    ):
        assert title in text
    assert text.count("<script") == 1
    assert "made for tests" in text
    assert text.index("<th>tier") < text.index("median, mm"), "the evidence of a size is printed before the number"


@pytest.mark.parametrize("n", [5, 6])
def test_the_page_shows_five_findings_of_a_code(tmp_path, n):
    content = minitree.rows()
    for row in content["items.parquet"][:n]:
        row["kind"] = "guess"
    text = page(Tree(minitree.release(tmp_path / "guessed", content)))
    assert text.count("<td>E305</td>") == 1 + 5  # the count and the examples
    assert f"<td class=n>{n}</td>" in text[text.index("<td>E305</td>") :][:200]


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
