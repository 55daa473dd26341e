"""How much of each label list has a prior: `python -m benchmarks.vocabularies RELEASE [--missing LIST]`.

Of a list's labels that need a prior (walls, floors and skies do not): the share whose node has one from at least ten
real items, from any real item, and from anything, curated ranges included. LVIS is also counted by frequency where its
own table is at hand.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

from metric_tree.tree import Tree, UnknownName, open_tree
from taxonomy.vocabularies import Label, vocabularies, vocabulary

#: Items from which a distribution can be told at all.
ENOUGH = 10

#: The list as its authors give it, with the frequency of each label: frequent, common, rare.
LVIS = Path("../shared/data/vocab/lvis_v1.csv")


def real_items(tree: Tree, label: Label) -> int | None:
    """Items of the label's node that are not curated; None where it has no prior at all."""
    if label.node_id is None:
        return None
    try:
        node = tree.node(label.node_id)
    except UnknownName:
        return None
    return node.n_items if tree.prior_dims(node.node_id) else None


def row(name: str, labels: list[Label], tree: Tree) -> str:
    counts = [real_items(tree, label) for label in labels]
    shares = [
        sum(n is not None and n >= ENOUGH for n in counts),
        sum(n is not None and n > 0 for n in counts),
        sum(n is not None for n in counts),
    ]
    cells = " | ".join(f"{share} ({share / max(len(labels), 1):.0%})" for share in shares)
    return f"| {name} | {len(labels)} | {cells} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("release", nargs="?")
    parser.add_argument("--missing", metavar="LIST", help="print the labels of a list that have no prior")
    arguments = parser.parse_args()
    tree = open_tree(arguments.release)
    print(
        f"| list | labels that need a prior | {ENOUGH}+ real items | any real item | any prior |\n|---|---|---|---|---|"
    )
    for name in vocabularies():
        print(row(name, [label for label in vocabulary(name) if not label.is_stuff], tree))
    if LVIS.is_file():
        with LVIS.open(encoding="utf-8", newline="") as lines:
            frequent = {line["name"] for line in csv.DictReader(lines) if line["frequency"] in {"f", "c"}}
        print(row("lvis_v1, frequent and common", [x for x in vocabulary("lvis_v1") if x.label in frequent], tree))
    if arguments.missing:
        labels = vocabulary(arguments.missing)
        print(", ".join(x.label for x in labels if not x.is_stuff and real_items(tree, x) is None))


if __name__ == "__main__":
    main()
