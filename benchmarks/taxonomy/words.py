"""What share of everyday words is understood: `python -m benchmarks.taxonomy.words --names FILE`.

FILE is a CSV with the columns `name` and `expected_node` (one node, or empty where the word should stay unknown), or
`word` and `expected` (nodes, or `name:` and a name, any of them, with `|` between). A word is right if the node is
expected, or replaced an expected one, or is a kind of an expected one, or an expected one's kind that is no further up
than `STEPS`. `--show` prints the words that are not right.
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

#: Levels between an expected node and a kind of it that still counts.
STEPS = 1


def verdict(tree: Tree, word: str, expected: set[str]) -> tuple[str, str]:
    """`right`, `wrong` or `none` for a word, and the node that it was taken for."""
    try:
        node = tree.find(word)
    except InputError:
        return ("none" if expected else "right, unknown"), ""
    if not expected:
        return "taken, expected nothing", node.node_id
    ids = {one.removesuffix("/other") for one in expected}
    ids |= {replaced_ids().get(one, one) for one in ids}
    names = {plain_fold(one.removeprefix("name:")) for one in expected}
    own = {node.node_id.removesuffix("/other"), node.synset or ""}
    called = {plain_fold(name) for name in (node.name, *node.aliases)}
    if own & ids or called & names or ids & set(node.hypernyms) or _above(node) & ids:
        return "right", node.node_id
    known = [tree.node(one) for one in ids if tree.has_node(one)]
    if any(node.node_id in _above(one, STEPS) or node.node_id in one.hypernyms[:3] for one in known):
        return "right", node.node_id
    return "wrong", node.node_id


def _above(node: object, steps: int = 9) -> set[str]:
    ids: set[str] = set()
    parent = getattr(node, "parent", None)
    while parent is not None and len(ids) < steps:
        ids.add(parent.node_id)
        parent = parent.parent
    return ids


def read_words(file: Path) -> list[tuple[str, set[str]]]:
    """Words and what is expected of each."""
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
    report(open_tree(), read_words(arguments.names), arguments.show)


def report(tree: Tree, words: list[tuple[str, set[str]]], show: bool) -> None:
    """Print the counts, and with `show` the words that are not right."""
    counts: Counter[str] = Counter()
    for word, expected in words:
        result, node_id = verdict(tree, word, expected)
        counts[result] += 1
        if show and not result.startswith("right"):
            print(f"{result:24s} {word:32s} {node_id:32s} expected {', '.join(sorted(expected)) or 'nothing'}")
    asked = sum(counts[name] for name in ("right", "wrong", "none"))
    shares = ", ".join(f"{name} {counts[name]} ({counts[name] / asked:.1%})" for name in ("right", "wrong", "none"))
    print(f"{tree}: of {asked} words with an expected node: {shares}")
    print(
        f"of {len(words) - asked} without: {dict(counts - Counter({k: counts[k] for k in ('right', 'wrong', 'none')}))}"
    )


if __name__ == "__main__":
    main()
