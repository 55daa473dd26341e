"""The words that several nodes share: `python -m benchmarks.taxonomy.shared_names [--all]`.

Nodes are those of today's tables: inner ones, leaves with a curated range, and leaves that the shipped release has. Two
nodes of which one is above the other do not compete for a word. Printed are the words that no reviewer has put in order
in `data/taxonomy/meanings.csv` (with `--all` every shared word), their nodes, and how many words are clear, how many
ambiguous.
"""

from __future__ import annotations

import argparse
from collections import Counter, defaultdict
from collections.abc import Iterable
from itertools import combinations

from metric_tree.tree import open_tree
from taxonomy.catalogue import OTHER, default_catalogue
from taxonomy.categories import Category
from taxonomy.curated import curated_ranges
from taxonomy.levels import LEAF
from taxonomy.naming.candidates import own_names
from taxonomy.naming.evidence import reviewed_meanings
from taxonomy.naming.spelling import plain_fold


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
            for name in (*own_names(category.node_id, category.name), *category.aliases):
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--all", action="store_true", help="print the words that a reviewer has ordered, too")
    arguments = parser.parse_args()
    counts: Counter[str] = Counter()
    judged = {row.node_id for row in curated_ranges()}
    for word, nodes in shared_names(judged | {node.node_id for node in open_tree()}).items():
        order = reviewed_meanings(word)
        state = "not reviewed" if order is None else "clear" if order.clear else "ambiguous"
        counts[state] += 1
        if order is None or arguments.all:
            shown = "; ".join(f"{node.node_id} ({' > '.join(node.path[-2:])})" for node in nodes)
            print(f"{word:24s} {state:12s} {shown}")
    print(f"{sum(counts.values())} words that several nodes share: {dict(counts)}")


if __name__ == "__main__":
    main()
