"""The tables of docs/training.md: our choice of categories, the paper's beside it, and the differences by reason.

python -m benchmarks.selection_table [--tree REF]
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from typing import Any

from metric_tree.commands.select import selection
from metric_tree.selection import TRAINING_LISTS, Rules, candidates, chosen
from metric_tree.tree import open_tree

FIGURES = ("divergence", "samples", "sources", "lists", "sd of log scale", "narrowing")

#: What a reason begins or ends with, and how the group is called.
GROUPS = (
    ("divergence", r"^divergence"),
    ("few samples in open data", r"samples, under"),
    ("one source", r"sources, under"),
    ("no training masks under that name", r"training sets, under"),
    ("in one line of the tree with another of ours", r"^above or below"),
    ("narrows less than the last of ours", r"^narrows by"),
    ("not in the release", r"^no prior"),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tree", help="release (default: the shipped one)")
    tree = open_tree(parser.parse_args().tree)
    ranked, rules = candidates(tree), Rules()
    found = selection(tree, ranked, chosen(ranked, rules), rules)
    both = sum(row["chosen"] for row in found["paper"])
    print(
        f"{tree.name} {tree.version}: {found['candidates']} candidates; {both} of the {rules.count} are the paper's\n"
    )
    _table(("category", *FIGURES, "the paper's name"), [(r["name"], *_figures(r), r["paper"]) for r in found["chosen"]])
    columns = ("the paper's", "category", *FIGURES, "why not ours")
    _table(columns, [(r["paper"], r.get("name"), *_figures(r), r["reason"]) for r in found["paper"]])
    for title, pattern in GROUPS:
        names = [row["paper"] for row in found["paper"] if row["reason"] and re.search(pattern, row["reason"])]
        if names:
            print(f"- {title} ({len(names)}): {', '.join(names)}")


def _figures(row: dict[str, Any]) -> tuple[object, ...]:
    if "samples" not in row:
        return (None,) * len(FIGURES)
    lists = f"{len(row['lists'])} of {len(TRAINING_LISTS)}"
    return (
        f"{row['divergence']:.2f}",
        row["samples"],
        row["sources"],
        lists,
        f"{row['sd']:.3f}",
        f"{row['narrowing']:.2f}",
    )


def _table(columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|")
    for row in rows:
        print(f"| {' | '.join('–' if cell is None else str(cell) for cell in row)} |")
    print()


if __name__ == "__main__":
    main()
