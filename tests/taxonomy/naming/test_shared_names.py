"""Words that several nodes share: each is one that a reviewer has put in order, and the resolver keeps to the order."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Iterable
from itertools import combinations

import pytest

import metric_tree
from metric_base.folders import taxonomy_directory
from metric_tree.curated.sizes import curated_ranges
from metric_tree.node import AmbiguousName
from taxonomy.catalogue import OTHER, default_catalogue
from taxonomy.categories import Category
from taxonomy.levels import LEAF
from taxonomy.naming.names import node_names
from taxonomy.words.senses import reviewed_meanings
from taxonomy.words.spelling import plain_fold


def shared_names(leaves: Iterable[str]) -> dict[str, list[Category]]:
    """The nodes of each folded word that two or more have of which none is above another.

    Parameters
    ----------
    leaves : ids of the leaves to look at; of inner nodes all are.
    """
    wanted = set(leaves)
    owners: defaultdict[str, dict[str, Category]] = defaultdict(dict)
    for category in default_catalogue().categories:
        if not category.node_id.endswith(OTHER) and (category.level < LEAF or category.node_id in wanted):
            for name in (*node_names(category.node_id, category.name), *category.aliases):
                owners[plain_fold(name)][category.node_id] = category
    above = {category.node_id: category.parent_id for category in default_catalogue().categories}
    return {
        word: list(nodes.values())
        for word, nodes in sorted(owners.items())
        if any(not _kin(one, other, above) for one, other in combinations(nodes.values(), 2))
    }


def _kin(one: Category, other: Category, above: dict[str, str | None]) -> bool:
    """Whether one of two nodes is above the other, in the tree or in WordNet."""
    for low, high in ((one, other), (other, one)):
        if high.node_id in low.hypernyms:
            return True
        parent = low.parent_id
        while parent is not None:
            if parent == high.node_id:
                return True
            parent = above[parent]
    return False


def rows() -> list[dict[str, str]]:
    with (taxonomy_directory() / "meanings.csv").open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def test_no_shared_word_waits_for_a_reviewer() -> None:
    """Nodes that a reviewer judged a size of."""
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
            rivals = len(nodes) > 1 and not tree._resolver._names.are_related(*nodes[:2])
            assert meaning.ambiguous == (word not in clear and rivals), word


def test_an_ambiguous_word_names_its_nodes() -> None:
    with pytest.raises(AmbiguousName, match=r"'bat' means several nodes: bat\.n\.05 .*, bat\.n\.01"):
        metric_tree.open().find("bat")
