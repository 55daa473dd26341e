"""Count evidence tiers of releases by level and by label list: `python -m benchmarks.metric_tree.tiers 2.0.0 3.0.0`.

The tiers of a release that does not state them are derived from its rows (docs/reference/tiers.md). `metric-tree diff`
lists the changes between two releases.
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
    trees = [open_tree(release) for release in parser.parse_args().releases]
    print_rows(["release", "of", *TIERS], (row for tree in trees for row in _rows(tree)))


def _rows(tree: Tree) -> Iterator[tuple[object, ...]]:
    sets = {f"level {level}": [node for node in tree if node.level == level] for level in (3, 4, 5)}
    for name, nodes in (sets | {name: list(_labelled(tree, name)) for name in LISTS}).items():
        counts = Counter(node.tier for node in nodes)
        yield (tree.version, name, *(counts[tier] for tier in TIERS))


def _labelled(tree: Tree, name: str) -> Iterable[Node]:
    """Yield the nodes of a label list that have a prior in the tree."""
    for label in vocabulary(name):
        try:
            node = tree.find(label.label, name, advice=False) if label.needs_prior else None
        except (UnknownName, KeyError):
            continue
        if node is not None and node.prior_dims:
            yield node


if __name__ == "__main__":
    main()
