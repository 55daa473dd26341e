"""Words that several nodes share: each is one that a reviewer has put in order, and the resolver keeps to the order."""

from __future__ import annotations

import csv

import pytest

import metric_tree
from benchmarks.taxonomy.shared_names import shared_names
from metric_base.folders import taxonomy_directory
from metric_tree.tree import AmbiguousName
from taxonomy.catalogue import default_catalogue
from taxonomy.curated import curated_ranges
from taxonomy.naming.evidence import reviewed_meanings
from taxonomy.naming.spelling import plain_fold


def rows() -> list[dict[str, str]]:
    with (taxonomy_directory() / "meanings.csv").open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def test_no_shared_word_waits_for_a_reviewer() -> None:
    """Nodes that a reviewer judged a size of; more with `python -m benchmarks.taxonomy.shared_names`."""
    shared = shared_names(row.node_id for row in curated_ranges())
    assert [word for word in shared if reviewed_meanings(word) is None] == []


def test_a_reviewed_word_is_folded_and_names_nodes() -> None:
    nodes = {category.node_id for category in default_catalogue().categories}
    words = [row["word"] for row in rows()]
    assert words == sorted(set(words))
    for row in rows():
        assert plain_fold(row["word"]) == row["word"]
        assert len(row["nodes"].split()) >= 2
        assert set(row["nodes"].split()) <= nodes, row
        assert row["clear"] in {"yes", "no"}
        assert row["reviewer"]


def test_the_tree_keeps_to_the_order() -> None:
    """Of the words that the shipped release has a node of."""
    tree = metric_tree.open()
    kept = {row["word"]: [node for node in row["nodes"].split() if tree.has_node(node)] for row in rows()}
    clear = {row["word"] for row in rows() if row["clear"] == "yes"}
    assert sum(map(bool, kept.values())) > 80
    for word, nodes in kept.items():
        if nodes:
            meaning = tree.resolve(word)
            assert meaning.node.node_id == nodes[0], word
            rivals = len(nodes) > 1 and not tree._resolver._names.kin(*nodes[:2])
            assert meaning.ambiguous == (word not in clear and rivals), word


def test_an_ambiguous_word_names_its_nodes() -> None:
    with pytest.raises(AmbiguousName, match=r"'bat' means several nodes: bat\.n\.05 .*, bat\.n\.01"):
        metric_tree.open().find("bat")
