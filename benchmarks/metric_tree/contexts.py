"""Thirty questions about a region or a year with known answers, and the nodes whose sizes depend on them.

    python -m benchmarks.metric_tree.contexts [TREE] [--part open|held] [--nodes]

A question passes if the median moves towards the answer (or is within 2 % of it without a context and stays so), and if
it is within 10 % of the answer. The questions were written before regions and years were changed after release 4.0.0;
those of the part `held` were not evaluated before the end. `--nodes` prints the nodes whose contexts with a region or a
year explain more than 10 % of a size.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from benchmarks.common import options_parser
from metric_base.errors import InputError
from metric_tree.context import Context
from metric_tree.tree import Tree, open_tree

QUESTIONS = Path(__file__).with_name("context_questions.csv")
#: Maximum relative error of an answer.
MAX_ERROR = 0.10
#: An answer within this error of the plain prior needs no change.
NO_CHANGE = 0.02
#: Minimum range of the mean sizes of contexts, as ln, for `--nodes`.
MIN_RANGE = 0.10


def main() -> None:
    """Print each question with the medians without and with its context, and the counts."""
    parser = options_parser(__doc__)
    parser.add_argument("tree", nargs="?")
    parser.add_argument("--part", choices=("open", "held"))
    parser.add_argument("--nodes", action="store_true")
    options = parser.parse_args()
    tree = open_tree(options.tree)
    if options.nodes:
        print_nodes(tree)
        return
    rows = questions(options.part)
    moved = close = both = 0
    for row in rows:
        plain, there = medians(tree, row["name"], row["where"], row["axis"])
        answer = float(row["mm"])
        is_moved, is_close = moves_right(plain, there, answer), abs(there / answer - 1) <= MAX_ERROR
        moved, close, both = moved + is_moved, close + is_close, both + (is_moved and is_close)
        verdict = "" if is_moved and is_close else "wrong"
        print(
            f"{row['number']:>2} {row['part']} {row['name']:16} {row['where']:15} {row['axis']:8}"
            f" answer {answer:7.1f}  plain {plain:7.1f}  there {there:7.1f}  {verdict}"
        )
    print(f"{len(rows)} questions: {moved} move towards the answer, {close} end within 10 %, {both} both")


def questions(part: str | None = None) -> list[dict[str, str]]:
    """Return the questions of a part, or all."""
    with QUESTIONS.open(encoding="utf-8", newline="") as file:
        return [row for row in csv.DictReader(file) if part in (None, row["part"])]


def medians(tree: Tree, name: str, where: str, axis: str) -> tuple[float, float]:
    """Return the medians of an axis in mm without and with a context; NaN if the name or the axis is unknown."""
    try:
        node = tree.find(name)
        plain, there = (node.prior(where=one) for one in (None, where))
        index = plain.dims.index(axis)
        return float(plain.quantile(0.5)[index]), float(there.quantile(0.5)[index])
    except (InputError, ValueError):
        return math.nan, math.nan


def moves_right(plain: float, there: float, answer: float) -> bool:
    """Return whether a median moves towards an answer, or stays within `NO_CHANGE` of it."""
    before, after = math.log(plain / answer), math.log(there / answer)
    return abs(after) < abs(before) or max(abs(before), abs(after)) <= NO_CHANGE


def print_nodes(tree: Tree) -> None:
    """Print the nodes and axes whose contexts differ by more than `MIN_RANGE` between regions or between years."""
    for node in tree.root.descendants():
        if not node.prior_dims or node.node_id.endswith("/other"):
            continue
        prior = node.prior()
        for axis, dim in enumerate(prior.dims):
            contexts = [one for one in prior.contexts if one.variance[axis] < MIN_RANGE**2 / 4]
            for kind, spread in (
                ("region", _range(contexts, axis, "region")),
                ("year", _range(contexts, axis, "year")),
            ):
                if spread > MIN_RANGE:
                    print(f"{node.node_id:32} {dim:8} {kind:7} {spread:5.2f} {node.contexts}")


def _range(contexts: list[Context], axis: int, field: str) -> float:
    """Return the range of the mean offsets by region or by decade; 0 with fewer than two."""
    groups: dict[object, list[float]] = {}
    for one in contexts:
        value = getattr(one, field)
        if value is not None and value != "world":
            groups.setdefault(value if field == "region" else int(value // 10), []).append(float(one.offset[axis]))
    offsets = [float(np.mean(group)) for group in groups.values()]
    return max(offsets) - min(offsets) if len(offsets) > 1 else 0.0


if __name__ == "__main__":
    main()
