"""What the matcher finds for an item, and how often each of its rules is right."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from metric_base.folders import taxonomy_directory

__all__ = ["THRESHOLD", "ConceptMatch", "believed_reliability", "measured_reliability", "no_concept", "reliabilities"]

#: Matches that are right less often than this wait for a reviewer. The target is 0.95 over all matches; a rule at
#: 0.8 is still worth its coverage because most matches come from rules above 0.95 (docs/explanation/matching.md).
THRESHOLD = 0.8

#: How often a rule is right before it has been measured, and how many strings that belief is worth.
_BELIEF = {"decision": 0.97, "source synset": 0.95, "class": 0.95, "exact": 0.95, "compound": 0.9, "head": 0.8}
#: A title says much besides the item, so a rule is believed less of it.
_TITLE = "title "
_TITLE_BELIEF = 0.8

_CERTAINTY = {"ruled": 1.02, "sole": 1.0, "path": 1.0, "domain": 0.97, "usual": 0.97, "frequent": 0.9, "rare": 0.85}
_BELIEF_WEIGHT = 6.0

_FILE = "reliability.json"


@dataclass(frozen=True, slots=True)
class ConceptMatch:
    """The answer of the matcher: `subject` is the phrase that a decision would be about, `rule` how it was reached.

    The rules are `decision`, `source synset`, `class`, and `exact`, `compound` or `head` with the certainty of the
    sense (`exact/sole`), with `title ` before it where there is nothing but a title, or `title of series ` where that
    begins with a series in capitals and a colon; without a concept `unknown`, `part`, `set` or `none`.
    """

    concept: str | None
    score: float
    reason: str
    rule: str
    subject: str

    @property
    def settled(self) -> bool:
        """Whether no reviewer is needed: a concept above the threshold, or a decision that there is no concept."""
        return self.score >= THRESHOLD


def no_concept(rule: str, reason: str, subject: str) -> ConceptMatch:
    """The finding of no concept."""
    return ConceptMatch(None, 0.0, reason, rule, subject)


def believed_reliability(rule: str) -> float:
    """The share of right matches believed of a rule before any is counted."""
    if rule.startswith(_TITLE):
        return _TITLE_BELIEF * believed_reliability(rule.rpartition(" ")[2])
    form, _, certainty = rule.partition("/")
    return _BELIEF[form] * _CERTAINTY.get(certainty, 1.0)


def reliabilities(counts: Mapping[str, tuple[int, int]]) -> dict[str, float]:
    """Share of right matches by rule from (right, all), drawn towards the belief where few were counted."""
    return {
        rule: round((right + _BELIEF_WEIGHT * believed_reliability(rule)) / (total + _BELIEF_WEIGHT), 3)
        for rule, (right, total) in sorted(counts.items())
    }


def measured_reliability(path: Path | None = None) -> Mapping[str, float]:
    """Share of right matches by rule; empty where it was never measured.

    `python -m data.generate reliability` writes it.
    """
    file = path or taxonomy_directory() / _FILE
    if not file.is_file():
        return {}
    rules: Mapping[str, float] = json.loads(file.read_text(encoding="utf-8"))["reliability"]
    return rules
