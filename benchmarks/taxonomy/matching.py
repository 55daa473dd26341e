"""Precision and coverage of the matcher on hand-labelled strings, on both halves.

    python -m benchmarks.taxonomy.matching

A string is *covered* when it is matched above the threshold, and counts towards coverage when its label names a
category. A match is *right* when it is one of the label's categories; a label that also allows `none` says that a
careful annotator would not insist. Ids that are gone count as their successors, in labels as in findings.
"""

from __future__ import annotations

import argparse
import csv
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from metric_base.folders import taxonomy_directory
from taxonomy.levels import replaced_ids
from taxonomy.matching.decisions import NONE, Decision, default_rulings
from taxonomy.matching.finding import ConceptMatch, measured_reliability
from taxonomy.matching.lexicon import default_lexicon
from taxonomy.matching.matcher import Matcher, default_matcher
from taxonomy.matching.source_reading import default_readings

LABELS = taxonomy_directory() / "labelled_strings.csv"
HALVES = ("development", "held-out")


@dataclass(frozen=True)
class Labelled:
    """One string with what an annotator says it names."""

    source: str
    path: tuple[str, ...]
    title: str
    synset: str | None
    label: frozenset[str]
    half: str

    def finding(self, matcher: Matcher) -> ConceptMatch:
        """What a matcher finds for the string."""
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
                label=frozenset(replaced_ids().get(one, one) for one in row["label"].split("|")),
                half=row["half"],
            )
            for row in csv.DictReader(lines)
        ]


def matcher_without(
    strings: Iterable[Labelled], rulings: Mapping[tuple[str, str], Decision], rules: Mapping[str, float]
) -> Matcher:
    """The matcher without the decisions that were taken on these very strings of these sources."""
    whole = Matcher(default_lexicon(), default_readings(), rulings, rules)
    used = {(one.source, one.finding(whole).subject) for one in strings if one.finding(whole).rule == "decision"}
    kept = {key: ruling for key, ruling in rulings.items() if key not in used}
    return Matcher(default_lexicon(), default_readings(), kept, rules)


def scores(strings: Sequence[Labelled], matcher: Matcher) -> dict[str, float]:
    findings = [one.finding(matcher) for one in strings]
    matched = [(one, found) for one, found in zip(strings, findings, strict=True) if found.concept and found.settled]
    named = [one for one in strings if NONE not in one.label]
    right = sum(found.concept in one.label for one, found in matched)
    return {
        "strings": len(strings),
        "named": len(named),
        "matched": len(matched),
        "right": right,
        "precision": right / len(matched),
        "coverage": sum(NONE not in one.label for one, _ in matched) / len(named),
    }


def counts_by_rule(strings: Sequence[Labelled], matcher: Matcher) -> dict[str, tuple[int, int]]:
    right: Counter[str] = Counter()
    total: Counter[str] = Counter()
    for one in strings:
        found = one.finding(matcher)
        if found.concept:
            total[found.rule] += 1
            right[found.rule] += found.concept in one.label
    return {rule: (right[rule], total[rule]) for rule in total}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.parse_args()
    strings = labelled()
    print(f"{'half':<12} {'decisions':<22} {'strings':>7} {'named':>6} {'matched':>7} {'precision':>9} {'coverage':>8}")
    for half in HALVES:
        chosen = [one for one in strings if one.half == half]
        arms = {
            "all": default_matcher(),
            "none on these strings": matcher_without(chosen, default_rulings(), measured_reliability()),
            "none at all": Matcher(default_lexicon(), default_readings(), {}, measured_reliability()),
        }
        for name, matcher in arms.items():
            s = scores(chosen, matcher)
            print(
                f"{half:<12} {name:<22} {s['strings']:>7} {s['named']:>6} {s['matched']:>7}"
                f" {s['precision']:>9.3f} {s['coverage']:>8.3f}"
            )


if __name__ == "__main__":
    main()
