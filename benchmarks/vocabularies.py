"""How much of each label list has a prior: `python -m benchmarks.vocabularies RELEASE [--missing LIST]`.

Of a list's labels that need a prior (walls, floors and skies do not): the share whose node has one from at least ten
real items, from any real item, and from anything, curated ranges included. LVIS is also counted by frequency where its
own table is at hand.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

from metric_tree.report import ENOUGH, Coverage, coverage, covered_items
from metric_tree.tree import open_tree
from taxonomy.vocabularies import vocabularies, vocabulary

#: The list as its authors give it, with the frequency of each label: frequent, common, rare.
LVIS = Path("../shared/data/vocab/lvis_v1.csv")


def row(found: Coverage) -> str:
    cells = " | ".join(f"{n} ({n / max(found.labels, 1):.0%})" for n in (found.enough, found.real, found.any))
    return f"| {found.name} | {found.labels} | {cells} |"


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
        print(row(coverage(tree, name)))
    if LVIS.is_file():
        with LVIS.open(encoding="utf-8", newline="") as lines:
            frequent = {line["name"] for line in csv.DictReader(lines) if line["frequency"] in {"f", "c"}}
        labels = [label for label in vocabulary("lvis_v1") if label.label in frequent]
        print(row(coverage(tree, "lvis_v1, frequent and common", labels)))
    if arguments.missing:
        labels = [label for label in vocabulary(arguments.missing) if label.needs_prior]
        print(", ".join(label.label for label in labels if covered_items(tree, label) is None))


if __name__ == "__main__":
    main()
