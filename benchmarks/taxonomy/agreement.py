"""Agreement of an independent reviewer with each of the project's: `python -m benchmarks.taxonomy.agreement`.

The independent decisions, 250 matches and 150 insertions sampled with seed 20261121, lie outside the folder of
decisions on purpose: they measure the readings and settle nothing. `metric-tree review agreement` compares the others.
"""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.common import options_parser, print_rows
from metric_base.folders import taxonomy_directory
from metric_base.schema import json_lines
from taxonomy.matching.decisions import BadDecision, Decision, agreement, decisions

FILE = taxonomy_directory() / "independent_reading.jsonl"
REVIEWERS = ("program: language model, first reading", "program: language model, second reading")


def main() -> None:
    """Print Cohen's kappa by kind of decision and reviewer."""
    options_parser(__doc__).parse_args()
    print_rows(["what", "reviewer", "subjects", "the same", "Cohen's kappa"], _rows())


def _rows() -> Iterator[tuple[object, ...]]:
    independent = [decision for _, decision in json_lines(FILE, Decision, BadDecision)]
    subjects = {(decision.what, decision.subject) for decision in independent}
    blind = [d for d in decisions() if d.blind and (d.what, d.subject) in subjects]
    for reviewer in REVIEWERS:
        for what in ("match", "insertion"):
            found = agreement([*(d for d in blind if d.reviewer == reviewer), *independent], what)
            yield what, reviewer, found.n, f"{found.share:.3f}", f"{found.kappa:.3f}"


if __name__ == "__main__":
    main()
