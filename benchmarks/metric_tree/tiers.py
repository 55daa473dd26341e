"""What releases rest on, by level and by label list: `python -m benchmarks.metric_tree.tiers 2.0.0 3.0.0`.

A release without tiers is read by the shares of its rows (docs/reference/tiers.md). What moved between two releases is
of `metric-tree diff`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

from benchmarks.common import options_parser, print_rows
from metric_tree.node import Node, UnknownName
from metric_tree.tiers import TIERS
from metric_tree.tree import Tree, open_tree
from taxonomy.label_lists import vocabulary

LISTS = ("coco_80", "lvis_v1", "ade20k_150", "objects365_v2", "scannet200")


def main() -> None:
    """Print the table."""
    parser = options_parser(__doc__)
    parser.add_argument("releases", nargs="+", metavar="RELEASE")
    trees = [open_tree(one) for one in parser.parse_args().releases]
    print_rows(["release", "of", *TIERS], (row for tree in trees for row in _rows(tree)))


def _rows(tree: Tree) -> Iterator[tuple[object, ...]]:
    sets = {f"level {level}": [node for node in tree if node.level == level] for level in (3, 4, 5)}
    for name, nodes in (sets | {name: list(_labelled(tree, name)) for name in LISTS}).items():
        counts = Counter(node.tier for node in nodes)
        yield (tree.version, name, *(counts[tier] for tier in TIERS))


def _labelled(tree: Tree, name: str) -> Iterable[Node]:
    """The nodes of a label list's labels, those that the tree has a size of."""
    for label in vocabulary(name):
        try:
            node = tree.find(label.label, name, advice=False) if label.needs_prior else None
        except (UnknownName, KeyError):
            continue
        if node is not None and node.prior_dims:
            yield node


if __name__ == "__main__":
    main()
