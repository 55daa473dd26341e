"""Agreement of an independent reviewer with each of the project's reviewers, on a seeded sample of their subjects.

The independent decisions lie outside the folder of decisions on purpose: they measure the readings and settle nothing.
`python -m benchmarks.taxonomy.agreement` prints Cohen's kappa by kind of decision and reviewer, and where the readings
differ from what is settled.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

from metric_base.folders import taxonomy_directory
from metric_base.schema import json_lines
from taxonomy.matching.decisions import NONE, Agreement, BadDecision, Decision, agreement, decisions, disagreements

__all__ = ["independent_decisions", "main", "paired"]

_FILE = "independent_reading.jsonl"
_REVIEWERS = ("program: language model, first reading", "program: language model, second reading")


def independent_decisions(path: Path | None = None) -> list[Decision]:
    """The independent reviewer's decisions: 250 matches and 150 insertions, sampled with seed 20261121.

    Raises
    ------
    BadDecision
        A line is not a decision.
    """
    file = path or taxonomy_directory() / _FILE
    return [decision for _, decision in json_lines(file, Decision, BadDecision)]


def paired(independent: Iterable[Decision], found: Iterable[Decision], reviewer: str) -> list[Decision]:
    """A reviewer's blind decisions on the subjects of the independent ones, followed by the independent ones."""
    chosen = list(independent)
    subjects = {(decision.what, decision.subject) for decision in chosen}
    theirs = [d for d in found if d.reviewer == reviewer and d.blind and (d.what, d.subject) in subjects]
    return [*theirs, *chosen]


def main() -> None:
    """Print the agreement with either reviewer, then the subjects on which the first one differs."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    independent, found = independent_decisions(), decisions()
    for reviewer in _REVIEWERS:
        both = paired(independent, found, reviewer)
        for what in ("match", "insertion"):
            print(_row(what, reviewer, agreement(both, what)))
    for first, own in disagreements(paired(independent, found, _REVIEWERS[0])):
        print(f"{own.what}\t{own.subject}\tfirst {first.decision or NONE}\tindependent {own.decision or NONE}")


def _row(what: str, reviewer: str, found: Agreement) -> str:
    return f"{what}\t{reviewer}\tn {found.n}\tsame {found.share:.3f}\tkappa {found.kappa:.3f}"


if __name__ == "__main__":
    main()
