"""Precision and coverage of the matcher on hand-labelled strings, on both halves; how often each rule is right.

    python -m benchmarks.taxonomy.matching                 # both halves
    python -m benchmarks.taxonomy.matching --calibrate     # write data/taxonomy/reliability.json from the development
    half
    python -m benchmarks.taxonomy.matching --speed         # distinct strings per second
    python -m benchmarks.taxonomy.matching --development    # the wrong and the missed of the development half
    python -m benchmarks.taxonomy.matching --titles RAW...  # what titles alone say of shops' items; also with
    --calibrate

Titles are judged by what the item's own category path says: right is the same concept or one below it. A hash of the
item's id puts it in a half; a shop counts for no more than `MOST_TITLES` items, so that none decides alone.

A string is *covered* when it is matched above the threshold, and counts towards coverage when its label names a
category. A match is *right* when it is one of the label's categories; a label that also allows `none` says that a
careful reader would not insist. Ids that are gone count as their successors, in labels as in findings.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from crawler.items import RawItem, raw_items
from metric_base.folders import taxonomy_directory
from taxonomy.levels import replaced_ids
from taxonomy.matching.decisions import NONE, Decision, default_rulings
from taxonomy.matching.finding import Finding, measured_reliability, reliabilities
from taxonomy.matching.lexicon import default_lexicon
from taxonomy.matching.matcher import Matcher, default_matcher
from taxonomy.matching.source_reading import default_readings

LABELS = taxonomy_directory() / "labelled_strings.csv"
HALVES = ("development", "held-out")

#: Shops whose items have both a title and a category path.
SHOPS = ("amazon_us_2020_sample", "ikea_sa_2020", "norske_sofaer")
MOST_TITLES = 200

_FILE = "reliability.json"
_OF_TITLES = "title "


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


def titled(files: Sequence[Path], half: str) -> dict[str, list[RawItem]]:
    """Items of the shops that fall into a half, by shop, in the order of their hashes."""
    found: defaultdict[str, list[tuple[int, RawItem]]] = defaultdict(list)
    for file in files:
        for item in raw_items(file):
            number = int(hashlib.sha256(f"{item.source}:{item.source_id}".encode()).hexdigest(), 16)
            if item.source in SHOPS and item.title and item.category_path and HALVES[number % 2] == half:
                found[item.source].append((number, item))
    return {
        source: [item for _, item in sorted(items, key=lambda pair: pair[0])[:MOST_TITLES]]
        for source, items in sorted(found.items())
    }


def title_findings(items: Iterable[RawItem], matcher: Matcher) -> list[tuple[str | None, Finding]]:
    """What the path of each item says, where it is settled, and what the title alone does."""
    pairs = [(item, matcher.finding(item.source, item.category_path, item.title)) for item in items]
    return [(path.concept, matcher.finding(item.source, (), item.title)) for item, path in pairs if path.settled]


def right_title(said: str | None, found: Finding, matcher: Matcher) -> bool:
    """Whether a title's concept is the path's or lies below it."""
    return bool(said and found.concept and matcher.lexicon.is_a(found.concept, (said,)))


def show_titles(files: Sequence[Path]) -> None:
    matcher = default_matcher()
    print(f"{'half':<12} {'shop':<22} {'titles':>7} {'named':>6} {'matched':>7} {'precision':>9} {'coverage':>8}")
    for half in HALVES:
        by_shop = {shop: title_findings(items, matcher) for shop, items in titled(files, half).items()}
        by_shop["all"] = [pair for pairs in by_shop.values() for pair in pairs]
        for shop, pairs in by_shop.items():
            taken = [(said, found) for said, found in pairs if found.concept and found.settled]
            right = sum(right_title(said, found, matcher) for said, found in taken)
            named = sum(said is not None for said, _ in pairs)
            covered = sum(said is not None for said, _ in taken)
            print(
                f"{half:<12} {shop:<22} {len(pairs):>7} {named:>6} {len(taken):>7}"
                f" {right / max(len(taken), 1):>9.3f} {covered / max(named, 1):>8.3f}"
            )


def calibrate_titles(files: Sequence[Path]) -> None:
    """Write the reliability of the rules for titles, measured on the development half of the shops' items."""
    matcher = default_matcher()
    counts: defaultdict[str, list[int]] = defaultdict(lambda: [0, 0])
    for items in titled(files, HALVES[0]).values():
        for said, found in title_findings(items, matcher):
            if found.concept:
                counts[found.rule][0] += right_title(said, found, matcher)
                counts[found.rule][1] += 1
    write_reliability({rule: (right, total) for rule, (right, total) in sorted(counts.items())}, titles=True)


def write_reliability(counts: Mapping[str, tuple[int, int]], titles: bool) -> None:
    """Replace the counts of the rules for titles, or those of all others, in the file of reliabilities."""
    file = taxonomy_directory() / _FILE
    record = json.loads(file.read_text(encoding="utf-8"))
    kept = {rule: tuple(c) for rule, c in record["counts"].items() if rule.startswith(_OF_TITLES) != titles}
    record["counts"] = dict(sorted((kept | dict(counts)).items()))
    record["reliability"] = reliabilities(record["counts"])
    record["titles_measured_on"] = f"development half of the titles of {', '.join(SHOPS)}"
    part = file.with_suffix(".part")
    part.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    part.replace(file)
    print(file)


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
    parser.add_argument("--development", action="store_true", help="list the errors of the development half only")
    parser.add_argument("--titles", nargs="+", type=Path, metavar="RAW", help="what titles alone say, of raw items")
    arguments = parser.parse_args()
    if arguments.titles:
        (calibrate_titles if arguments.calibrate else show_titles)(arguments.titles)
        return
    strings = labelled()
    development = [one for one in strings if one.half == "development"]
    if arguments.calibrate:
        calibrate(development)
    elif arguments.speed:
        print(f"{strings_per_second():.0f} distinct strings per CPU second")
    elif arguments.development:
        list_errors(development)
    else:
        show(strings)


def calibrate(development: Sequence[Labelled]) -> None:
    """Write the reliability of each rule, measured without the decisions on the strings themselves."""
    counts = counts_by_rule(development, matcher_without(development, default_rulings(), {}))
    write_reliability(counts, titles=False)


def list_errors(development: Sequence[Labelled]) -> None:
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
