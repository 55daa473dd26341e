"""The search box of the report in a real browser."""

from __future__ import annotations

from pathlib import Path

from explorer.pages.report_page import page
from metric_tree.tree import Tree
from tests.support.browser import Browser
from tests.synthetic import minitree

ROWS = "[...document.querySelectorAll('#categories tr')].slice(1)"
SHOWN = f"{ROWS}.filter(row => row.offsetHeight).map(row => row.cells[1].textContent)"


def test_what_is_typed_leaves_the_categories_that_have_all_of_its_words(tmp_path: Path) -> None:
    tree = Tree(minitree.release(tmp_path / "release"))
    (tmp_path / "report.html").write_text(page(tree), encoding="utf-8")
    with Browser(tmp_path / "profile") as browser:
        browser.open((tmp_path / "report.html").as_uri())
        assert len(browser.run(SHOWN)) == len(tree)
        browser.run("document.querySelector('input[type=search]').focus()")
        browser.type("desk CHAIR")
        shown = browser.run(SHOWN)
        words = (f"{node.node_id} {node.name} {' '.join(node.aliases)}".lower() for node in tree)
        expected = [node.node_id for node, said in zip(tree, words, strict=True) if "desk" in said and "chair" in said]
        assert expected
        assert sorted(shown) == sorted(expected)
        assert browser.run("document.getElementById('categories-count').textContent") == f"{len(shown)} of {len(tree)}"
