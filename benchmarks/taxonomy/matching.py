"""Precision and coverage of the matcher on hand-labelled strings, and agreement with an independent reviewer.

    python -m benchmarks.taxonomy.matching

A string is *covered* if it is matched above the threshold; coverage is computed over the strings whose label names a
category. A match is *right* if it is one of the label's categories. A label that also contains `none` accepts no match
too. Replaced ids are mapped to their successors, in labels and in matches.

The independent decisions (250 matches and 150 insertions, sampled with seed 20261121) are outside the folder of
decisions on purpose: they only measure the readings. `metric-tree review agreement` compares the other decisions.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.common import options_parser, print_rows
from metric_base.records import json_lines
from taxonomy.levels import replaced_ids
from taxonomy.matching.decisions import NONE, BadDecision, Decision, agreement, decisions, rulings
from taxonomy.matching.lexicon import default_lexicon
from taxonomy.matching.matcher import ConceptMatch, Matcher, default_matcher
from taxonomy.matching.readings import readings
from taxonomy.matching.reliability import measured_reliability

LABELS = Path(__file__).with_name("labelled_strings.csv")
HALVES = ("development", "held-out")
INDEPENDENT = Path(__file__).with_name("independent_reading.jsonl")
REVIEWERS = ("program: language model, first reading", "program: language model, second reading")

Row = tuple[object, ...]


@dataclass(frozen=True)
class Labelled:
    """One string with the categories that an annotator assigned to it."""

    source: str
    path: tuple[str, ...]
    title: str
    synset: str | None
    label: frozenset[str]
    half: str

    def finding(self, matcher: Matcher) -> ConceptMatch:
        """Return the match of the string."""
        found = matcher.finding(self.source, self.path, self.title, self.synset)
        return replace(found, concept=replaced_ids().get(found.concept or "", found.concept))


def labelled(path: Path = LABELS) -> list[Labelled]:
    with path.open(encoding="utf-8", newline="") as lines:
        return [
            Labelled(
                source=row["source"],
                path=tuple(filter(None, row["category_path"].split(" > "))),
                title=row["title"],
                synset=row["source_synset"] or None,
                label=frozenset(replaced_ids().get(node_id, node_id) for node_id in row["label"].split("|")),
                half=row["half"],
            )
            for row in csv.DictReader(lines)
        ]


def matcher_without(
    strings: Iterable[Labelled], rulings: Mapping[tuple[str, str], Decision], rules: Mapping[str, float]
) -> Matcher:
    """Return the matcher without the decisions about the given strings of their sources."""
    complete = Matcher(default_lexicon(), readings(), rulings, rules)
    matches = [(string.source, string.finding(complete)) for string in strings]
    used = {(source, match.subject) for source, match in matches if match.rule == "decision"}
    remaining = {key: ruling for key, ruling in rulings.items() if key not in used}
    return Matcher(default_lexicon(), readings(), remaining, rules)


def scores(strings: Sequence[Labelled], matcher: Matcher) -> Row:
    """Return the numbers of strings, of strings with a category and of matches, and precision and coverage."""
    findings = [string.finding(matcher) for string in strings]
    matched = [
        (string, match) for string, match in zip(strings, findings, strict=True) if match.concept and match.settled
    ]
    named = sum(NONE not in string.label for string in strings)
    right = sum(match.concept in string.label for string, match in matched)
    covered = sum(NONE not in string.label for string, _ in matched)
    return len(strings), named, len(matched), f"{right / len(matched):.3f}", f"{covered / named:.3f}"


def counts_by_rule(strings: Sequence[Labelled], matcher: Matcher) -> dict[str, tuple[int, int]]:
    """Return the numbers of right matches and of all matches for each rule of the matcher."""
    right: Counter[str] = Counter()
    total: Counter[str] = Counter()
    for string in strings:
        match = string.finding(matcher)
        if match.concept:
            total[match.rule] += 1
            right[match.rule] += match.concept in string.label
    return {rule: (right[rule], total[rule]) for rule in total}


def main() -> None:
    """Print both tables."""
    options_parser(__doc__).parse_args()
    columns = ("half", "decisions", "strings", "named", "matched", "precision", "coverage")
    print_rows(columns, _score_rows(labelled()))
    print()
    print_rows(["what", "reviewer", "subjects", "the same", "Cohen's kappa"], _agreement_rows())


def _score_rows(strings: Sequence[Labelled]) -> Iterator[Row]:
    for half in HALVES:
        chosen = [string for string in strings if string.half == half]
        arms = {
            "all": default_matcher(),
            "none on these strings": matcher_without(chosen, rulings(decisions()), measured_reliability()),
            "none at all": Matcher(default_lexicon(), readings(), {}, measured_reliability()),
        }
        for name, matcher in arms.items():
            yield half, name, *scores(chosen, matcher)


def _agreement_rows() -> Iterator[Row]:
    independent = [decision for _, decision in json_lines(INDEPENDENT, Decision, BadDecision)]
    subjects = {(decision.what, decision.subject) for decision in independent}
    blind = [d for d in decisions() if d.blind and (d.what, d.subject) in subjects]
    for reviewer in REVIEWERS:
        for what in ("match", "insertion"):
            agreed = agreement([*(d for d in blind if d.reviewer == reviewer), *independent], what)
            yield what, reviewer, agreed.n, f"{agreed.share:.3f}", f"{agreed.kappa:.3f}"


if __name__ == "__main__":
    main()
