"""Precision and coverage of the matcher on hand-labelled strings, on both halves; how often each rule is right.

    python -m benchmarks.matching                 # both halves
    python -m benchmarks.matching --calibrate     # write data/taxonomy/reliability.json from the development half
    python -m benchmarks.matching --speed         # distinct strings per second
    python -m benchmarks.matching --development    # the wrong and the missed of the development half

A string is *covered* when it is matched above the threshold, and counts towards coverage when its label names a
category. A match is *right* when it is one of the label's categories; a label that also allows `none` says that a
careful reader would not insist.
"""

from __future__ import annotations

import argparse
import csv
import json
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from taxonomy.findings import Finding, measured_reliability, reliabilities
from taxonomy.lexicon import default_lexicon
from taxonomy.matching import Matcher, default_matcher
from taxonomy.places import taxonomy_directory
from taxonomy.readings import default_readings
from taxonomy.review import NONE, Decision, default_rulings

LABELS = taxonomy_directory() / "labelled_strings.csv"
HALVES = ("development", "held-out")


@dataclass(frozen=True)
class Labelled:
    """One string with what a reader says it names."""

    source: str
    path: tuple[str, ...]
    title: str
    synset: str | None
    label: frozenset[str]
    half: str

    def finding(self, matcher: Matcher) -> Finding:
        """What a matcher finds for the string."""
        return matcher.finding(self.source, self.path, self.title, self.synset)


def labelled(path: Path = LABELS) -> list[Labelled]:
    with path.open(encoding="utf-8", newline="") as lines:
        return [
            Labelled(
                source=row["source"],
                path=tuple(filter(None, row["category_path"].split(" > "))),
                title=row["title"],
                synset=row["source_synset"] or None,
                label=frozenset(row["label"].split("|")),
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


def strings_per_second(seconds: float = 5.0) -> float:
    """Distinct strings a CPU second that no cache has seen: those of the labels, each with a number of its own."""
    matcher = Matcher(default_lexicon(), default_readings(), default_rulings(), measured_reliability())
    strings = labelled()
    matcher.finding("procthor_ai2thor", ("chair",))  # the lexicon is read before the clock starts
    done, start = 0, time.process_time()
    while time.process_time() - start < seconds:
        for one in strings:
            done += 1
            matcher.finding(one.source, (*one.path[:-1], f"q{done} {one.path[-1] if one.path else 'thing'}"), one.title)
    return done / (time.process_time() - start)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calibrate", action="store_true", help="write the reliability of each rule")
    parser.add_argument("--speed", action="store_true", help="measure distinct strings per CPU second")
    parser.add_argument("--development", action="store_true", help="list the faults of the development half only")
    arguments = parser.parse_args()
    strings = labelled()
    development = [one for one in strings if one.half == "development"]
    if arguments.calibrate:
        calibrate(development)
    elif arguments.speed:
        print(f"{strings_per_second():.0f} distinct strings per CPU second")
    elif arguments.development:
        list_faults(development)
    else:
        show(strings)


def calibrate(development: Sequence[Labelled]) -> None:
    """Write the reliability of each rule, measured without the decisions on the strings themselves."""
    counts = counts_by_rule(development, matcher_without(development, default_rulings(), {}))
    record = {"measured_on": "development half of labelled_strings.csv", "counts": counts}
    file = taxonomy_directory() / "reliability.json"
    part = file.with_suffix(".part")
    part.write_text(json.dumps(record | {"reliability": reliabilities(counts)}, indent=1) + "\n", encoding="utf-8")
    part.replace(file)
    print(file)


def list_faults(development: Sequence[Labelled]) -> None:
    for one in development:
        found = one.finding(default_matcher())
        matched = found.concept if found.settled else None
        if matched not in one.label and not (matched is None and NONE in one.label):
            words = f"{one.source} | {' > '.join(one.path)} | {one.title[:50]}"
            print(f"{words} | {'|'.join(sorted(one.label))} | {matched} ({found.rule}: {found.reason})")


def show(strings: Sequence[Labelled]) -> None:
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
