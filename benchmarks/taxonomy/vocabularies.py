"""How much of each label list has a prior.

`python -m benchmarks.taxonomy.vocabularies RELEASE [--missing LIST] [--raw FILE]`.

Of a list's labels that need a prior (walls, floors and skies do not): the share whose node has one from at least ten
real items, from any real item, and from anything, curated ranges included. LVIS is also counted by frequency where its
own table is at hand.

`--raw` says what the sources could give at most: the labels for which there are ten raw rows of the thing itself or of
any kind of it in WordNet's or the tree's sense, repeated sizes included.
"""

from __future__ import annotations

import argparse
import csv
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from crawler.items import raw_items
from metric_tree.report.counts import ENOUGH, Coverage, coverage, covered_items
from metric_tree.tree import open_tree
from taxonomy.label_lists import Label, vocabularies, vocabulary
from taxonomy.matching.lexicon import default_lexicon
from taxonomy.matching.shipped import default_taxonomy

#: The list as its authors give it, with the frequency of each label: frequent, common, rare.
LVIS = Path("../shared/data/vocab/lvis_v1.csv")


def row(found: Coverage) -> str:
    cells = " | ".join(f"{n} ({n / max(found.labels, 1):.0%})" for n in (found.enough, found.real, found.any))
    return f"| {found.name} | {found.labels} | {cells} |"


def frequent_and_common() -> list[Label]:
    """LVIS's labels but the rare ones; none where its own table is not at hand."""
    if not LVIS.is_file():
        return []
    with LVIS.open(encoding="utf-8", newline="") as lines:
        frequent = {line["name"] for line in csv.DictReader(lines) if line["frequency"] in {"f", "c"}}
    return [label for label in vocabulary("lvis_v1") if label.label in frequent]


def rows_by_concept(files: Iterable[Path]) -> Counter[str]:
    """Raw rows of a thing or of any kind of it; a row counts for all that stands above it in WordNet or in the tree."""
    taxonomy, lexicon = default_taxonomy(), default_lexicon()
    parents = {category.node_id: category.parent_id for category in taxonomy.categories()}
    leaves = Counter(
        taxonomy.match(item).node_id for file in files for item in raw_items(file) if item.kind != "curated"
    )
    found: Counter[str] = Counter()
    for leaf, rows in leaves.items():
        if leaf is not None:
            concept = leaf.partition("/")[0]
            above = {concept, *(lexicon.hypernyms(concept) if lexicon.knows(concept) else ())}
            node = parents[leaf]
            while node is not None:
                above.add(node)
                node = parents[node]
            found.update(dict.fromkeys(above, rows))
    return found


def bound(labels: Sequence[Label], rows: Counter[str]) -> str:
    within = sum(label.node_id is not None and rows[label.node_id.partition("/")[0]] >= ENOUGH for label in labels)
    return f"{within} of {len(labels)} ({within / max(len(labels), 1):.0%})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("release", nargs="?")
    parser.add_argument("--missing", metavar="LIST", help="print the labels of a list that have no prior")
    parser.add_argument(
        "--raw", metavar="FILE", nargs="+", type=Path, help="say what these raw items could give at most"
    )
    arguments = parser.parse_args()
    tree = open_tree(arguments.release)
    print(
        f"| list | labels that need a prior | {ENOUGH}+ real items | any real item | any prior |\n|---|---|---|---|---|"
    )
    for name in vocabularies():
        print(row(coverage(tree, name)))
    if frequent_and_common():
        print(row(coverage(tree, "lvis_v1, frequent and common", frequent_and_common())))
    if arguments.raw:
        rows = rows_by_concept(arguments.raw)
        for name, labels in (("coco_80", vocabulary("coco_80")), ("LVIS, frequent and common", frequent_and_common())):
            print(f"{name}: labels with {ENOUGH} raw rows of any kind of the thing: {bound(labels, rows)}")
    if arguments.missing:
        labels = [label for label in vocabulary(arguments.missing) if label.needs_prior]
        print(", ".join(label.label for label in labels if covered_items(tree, label) is None))


if __name__ == "__main__":
    main()
