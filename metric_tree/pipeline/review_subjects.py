"""Subjects for reviewers in raw items: words that no rule settles, and an example item for each subject."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Container, Sequence
from pathlib import Path

from crawler.items import raw_items
from metric_tree.pipeline.ingest import raw_files
from taxonomy.matching.decisions import EVERY_SOURCE
from taxonomy.matching.matcher import default_matcher


def unsettled_words(raw: Sequence[Path], reviewed: Container[str]) -> Counter[tuple[str, str, str | None, str]]:
    """Count the raw items whose words are neither settled by a rule nor reviewed.

    Parameters
    ----------
    raw : sequence of Path
        Raw items, as files or folders.
    reviewed : container of str
        Subjects with a decision.

    Returns
    -------
    Counter
        Number of items by source, words, best concept below the threshold (or None) and rule.
    """
    words: Counter[tuple[str, str, str | None, str]] = Counter()
    for file in raw_files(raw):
        for item in raw_items(file):
            finding = default_matcher().finding(item.source, item.category_path, item.title, item.synset)
            subjects = (f"{item.source}: {finding.subject}", f"{EVERY_SOURCE}: {finding.subject}")
            if not finding.settled and not any(subject in reviewed for subject in subjects):
                words[item.source, finding.subject, finding.concept, finding.rule] += 1
    return words


def subject_examples(raw: Sequence[Path], subjects: Collection[str]) -> dict[str, dict[str, str]]:
    """Return title, size in mm, image and page of the first raw item of each subject, by subject."""
    examples: dict[str, dict[str, str]] = {}
    remaining = set(subjects)
    for item in (item for file in raw_files(raw) for item in raw_items(file)):
        words = default_matcher().finding(item.source, item.category_path, item.title, item.synset).subject
        for subject in {f"{item.source}: {words}", f"{EVERY_SOURCE}: {words}"} & remaining:
            size = " x ".join(f"{value:.4g}" for value in item.extents_mm or ())
            links = {"picture": next(iter(item.images), ""), "page": item.url or ""}
            examples[subject] = {"title": item.title or "", "size": size, **links}
            remaining.remove(subject)
        if not remaining:
            break
    return examples
