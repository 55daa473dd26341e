"""The tables of docs/how-to/training-sets.md: our choice of categories, the paper's, and the differences by reason.

python -m benchmarks.metric_tree.selection_table [--tree REF] [--lists
../shared/data/sizes/metric_tree_2020/scale_metrics]

`--lists` names the authors' own lists of sizes (one CSV of millimetres for each of their 43): samples and divergence in
them stand beside ours.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from metric_tree.commands.select import figures, selection
from metric_tree.training.selection import Rules, candidates, choose
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
    parser.add_argument("--lists", type=Path, help="the authors' lists, scale_metrics")
    arguments = parser.parse_args()
    tree = open_tree(arguments.tree)
    ranked, rules = candidates(tree), Rules()
    found = selection(tree, ranked, choose(ranked, rules), rules)
    both = sum(row["chosen"] for row in found["paper"])
    print(
        f"{tree.name} {tree.version}: {found['candidates']} candidates; {both} of the {rules.count} are the paper's\n"
    )
    _table(("category", *FIGURES, "the paper's name"), [(r["name"], *figures(r), r["paper"]) for r in found["chosen"]])
    theirs = {row["paper"]: _theirs(arguments.lists, row["paper"]) for row in found["paper"]}
    columns = ("the paper's", "category", *FIGURES, "theirs: samples", "divergence", "why not ours")
    rows = [(r["paper"], r.get("name"), *figures(r), *theirs[r["paper"]], r["reason"]) for r in found["paper"]]
    _table(columns, rows)
    for title, pattern in GROUPS:
        names = [row["paper"] for row in found["paper"] if row["reason"] and re.search(pattern, row["reason"])]
        if names:
            print(f"- {title} ({len(names)}): {', '.join(names)}")
    _told(list(theirs.values()), rules)


def _told(theirs: Sequence[tuple[int | None, str | None]], rules: Rules) -> None:
    """What of our thresholds the authors' lists themselves would keep to."""
    rows = [(count, float(spread)) for count, spread in theirs if count is not None and spread is not None]
    if not rows:
        return
    counts = sorted(count for count, _ in rows)
    few = sum(count < rules.least_samples for count in counts)
    wide = sum(spread > rules.most_divergence for _, spread in rows)
    kept = sum(count >= rules.least_samples and spread <= rules.most_divergence for count, spread in rows)
    print(
        f"\ntheir lists: {counts[0]} to {counts[-1]} rows, {counts[len(counts) // 2]} in the middle; {few} have under"
    )
    print(f"{rules.least_samples}, {wide} a divergence over {rules.most_divergence}; {kept} keep to both")


def _theirs(lists: Path | None, label: str) -> tuple[int | None, str | None]:
    """Rows of the authors' list and its divergence, as ours is reckoned."""
    if lists is None:
        return None, None
    sizes = np.loadtxt(lists / f"{label}.csv", delimiter=",", ndmin=2)
    spread = np.log(sizes).std(axis=0, ddof=1)
    return len(sizes), f"{np.sqrt((spread**2).mean()):.2f}"


def _table(columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|")
    for row in rows:
        print(f"| {' | '.join('–' if cell is None else str(cell) for cell in row)} |")
    print()


if __name__ == "__main__":
    main()
