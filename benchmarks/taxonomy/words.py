"""Measure the fraction of everyday words that resolve to the right category.

    python -m benchmarks.taxonomy.words --names FILE

FILE is a CSV with the columns `name` and `expected_node` (a node, or empty if the word should be unknown), or `word`
and `expected` (alternatives separated by `|`: nodes, or names with the prefix `name:`). A node is right if it is
expected, replaces an expected node, is below an expected node, or is at most `STEPS` levels above one. `--show` prints
the words that are not right.
"""

from __future__ import annotations

import csv
from collections import Counter
from pathlib import Path

from benchmarks.common import options_parser
from metric_base.errors import InputError
from metric_tree.tree import Tree, open_tree
from taxonomy.levels import replaced_ids
from taxonomy.words.spelling import plain_fold

#: Maximum number of levels that a right node may be above an expected one.
STEPS = 1


def verdict(tree: Tree, word: str, expected: set[str]) -> tuple[str, str]:
    """Return `right`, `wrong` or `none` (not found) for a word, and the node that it resolves to."""
    try:
        node = tree.find(word)
    except InputError:
        return ("none" if expected else "right, unknown"), ""
    if not expected:
        return "taken, expected nothing", node.node_id
    ids = {text.removesuffix("/other") for text in expected}
    ids |= {replaced_ids().get(node_id, node_id) for node_id in ids}
    names = {plain_fold(text.removeprefix("name:")) for text in expected}
    found_ids = {node.node_id.removesuffix("/other"), node.synset or ""}
    found_names = {plain_fold(name) for name in (node.name, *node.aliases)}
    if found_ids & ids or found_names & names or ids & set(node.hypernyms) or _above(node) & ids:
        return "right", node.node_id
    expected_nodes = [tree.node(node_id) for node_id in ids if tree.has_node(node_id)]
    if any(node.node_id in _above(other, STEPS) or node.node_id in other.hypernyms[:3] for other in expected_nodes):
        return "right", node.node_id
    return "wrong", node.node_id


def _above(node: object, steps: int = 9) -> set[str]:
    """Return the ids of up to `steps` ancestors of a node."""
    ids: set[str] = set()
    parent = getattr(node, "parent", None)
    while parent is not None and len(ids) < steps:
        ids.add(parent.node_id)
        parent = parent.parent
    return ids


def read_words(file: Path) -> list[tuple[str, set[str]]]:
    """Return the words with the set of nodes and names that are right for each."""
    with file.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines))
    return [
        (
            row.get("name") or row["word"],
            set(filter(None, (row.get("expected_node") or row.get("expected") or "").split("|"))),
        )
        for row in rows
    ]


def main() -> None:
    parser = options_parser(__doc__)
    parser.add_argument("--names", type=Path, required=True)
    parser.add_argument("--show", action="store_true", help="print each word that is not right")
    arguments = parser.parse_args()
    tree, words = open_tree(), read_words(arguments.names)
    counts: Counter[str] = Counter()
    for word, expected in words:
        result, node_id = verdict(tree, word, expected)
        counts[result] += 1
        if arguments.show and not result.startswith("right"):
            print(f"{result:24s} {word:32s} {node_id:32s} expected {', '.join(sorted(expected)) or 'nothing'}")
    named = ("right", "wrong", "none")
    total = sum(counts[name] for name in named)
    fractions = ", ".join(f"{name} {counts[name]} ({counts[name] / total:.1%})" for name in named)
    print(f"{tree}: of {total} words with an expected node: {fractions}")
    print(f"of {len(words) - total} without: {dict(counts - Counter({name: counts[name] for name in named}))}")


if __name__ == "__main__":
    main()
