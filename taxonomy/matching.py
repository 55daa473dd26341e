"""From a source's words to a concept: a WordNet synset or a reviewed insertion, with a score and a reason."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from taxonomy.insertions import PREFIX
from taxonomy.lexicon import Lexicon, default_lexicon
from taxonomy.places import taxonomy_directory
from taxonomy.readings import Reading, default_readings, reading_of
from taxonomy.review import EVERY_SOURCE, Decision, default_rulings
from taxonomy.senses import DOMAINS, Sense, fits, sense
from taxonomy.words import Phrase, folded, noun_phrase
from taxonomy.wordnet import UnknownSynset

__all__ = ["THRESHOLD", "Finding", "Matcher", "default_matcher", "reliabilities"]

#: Matches that are right less often than this wait for a reader. The target is 0.95 over all matches; a rule at
#: 0.8 is still worth its coverage because most matches come from rules above 0.95 (docs/matching.md).
THRESHOLD = 0.8

#: How often a rule is right before it has been measured, and how many strings that belief is worth.
_BELIEF = {"decision": 0.97, "source synset": 0.95, "class": 0.95, "exact": 0.95, "compound": 0.9, "head": 0.8}
_CERTAINTY = {"ruled": 1.02, "sole": 1.0, "domain": 0.97, "frequent": 0.9, "rare": 0.85}
_BELIEF_WEIGHT = 6.0

_RELIABILITY_FILE = "reliability.json"

#: Heads that name a part, a cover or a stuff that goes with the thing named before them.
_PART_WORDS = frozenset(
    """accessory armrest arm attachment backrest base blade body box set bracket bumper cable canopy case caster castor
    chassis clip collection combination component compartment connector corner cover divider element end extension
    filling fitting foot fragment frame front gauge handle head headrest hinge insert kit knob leg lid lining mount
    mounting net pack pad panel part parts piece plinth portion post protector rail refill roller runner seat section
    segment set shell side skirt slat spare support surround template top tray underframe unit upright wing design
    pattern sample service view detail study project proposal""".split()
)

#: Part words that are things of their own when they stand alone in a museum or a shop.
_WHOLE_ALONE = frozenset("box case cover frame handle kit lid panel rail seat tray knob pad net head".split())

_SET = re.compile(r"\s(?:and|&|\+|plus)\s|(?<=\w)\+\s?(?=\w)|\s\+", re.IGNORECASE)
_COUNTED = re.compile(r"(?:\+|\band\b|&)\s?(?:\d+|two|three|four|six)\b", re.IGNORECASE)
_SET_OF = re.compile(r"^(?:an?\s+)?(?:set|suite|group|collection|pieces|assortment)\b", re.IGNORECASE)
_FRAGMENT = re.compile(
    r"\b(?:fragments?|model (?:for|of)|cover for|covers? for|legs? for|trekk|ben til|part of)\b", re.I
)
_NUMBER = re.compile(r"\b\d+\b\s*")


@dataclass(frozen=True, slots=True)
class Finding:
    """What was found for an item: `subject` is the phrase that a decision would be about, `rule` how it was found."""

    concept: str | None
    score: float
    reason: str
    rule: str
    subject: str

    @property
    def settled(self) -> bool:
        """Whether it enters the tree: a concept above the threshold, or a reader's word that there is none."""
        return self.score >= THRESHOLD


class Matcher:
    """Finds concepts; holds what it has found, so that a phrase is worked out once.

    Parameters
    ----------
    lexicon : names that can be matched.
    readings : how each source is read.
    rulings : readers' decisions by source (or `*`) and subject.
    reliability : measured share of right matches by rule.
    """

    def __init__(
        self,
        lexicon: Lexicon,
        readings: Mapping[str, Reading],
        rulings: Mapping[tuple[str, str], Decision],
        reliability: Mapping[str, float] | None = None,
    ) -> None:
        self.lexicon = lexicon
        self._readings = readings
        self._rulings = rulings
        self._reliability = reliability or {}
        self._named: dict[tuple[str, str, bool], Finding] = {}
        self._meanings = {words: ruling for (source, words), ruling in rulings.items() if source == EVERY_SOURCE}

    def finding(
        self, source: str, category_path: tuple[str, ...], title: str = "", synset: str | None = None
    ) -> Finding:
        """The concept of an item, or why there is none.

        A reader's decision counts first, then the synset that the source itself names, then a whole class of the
        source (a museum's paintings), then the words.
        """
        reading = reading_of(source, self._readings)
        texts = _texts(reading, category_path, title)
        subject = " | ".join(filter(None, (folded(text) for text in texts[:1]))) or folded(title)
        found = (
            self._ruled(source, category_path, texts, subject)
            or self._named_by_source(synset, subject)
            or self._of_class(reading, category_path, subject)
            or self._of_words(reading, texts, subject)
        )
        return self._refined(found, reading, title)

    def _ruled(self, source: str, path: tuple[str, ...], texts: tuple[str, ...], subject: str) -> Finding | None:
        whole_path = " > ".join(folded(part) for part in path)
        nouns = [folded(noun_phrase(text)) for text in texts]
        for text in dict.fromkeys((subject, whole_path, *map(folded, texts), *nouns)):
            if ruling := self._rulings.get((source, text)):
                return self._decided(ruling, text)
        return None

    def _decided(self, ruling: Decision, subject: str) -> Finding:
        why = f"readers' decision: {ruling.why}" if ruling.why else "readers' decision"
        return Finding(ruling.decision, self._score("decision"), why, "decision", subject)

    def _named_by_source(self, synset: str | None, subject: str) -> Finding | None:
        if not synset:
            return None
        try:
            concept = self.lexicon.wordnet.synset_at(synset) if synset[1:].isdigit() else synset
        except UnknownSynset:
            return None
        fits = self.lexicon.knows(concept) and sense((concept,), DOMAINS["things"], self.lexicon)
        if not fits:
            return None
        return Finding(concept, self._score("source synset"), "the source names it", "source synset", subject)

    def _of_class(self, reading: Reading, path: tuple[str, ...], subject: str) -> Finding | None:
        concept = reading.classes.get(path[0]) if path else None
        if concept is None:
            return None
        return Finding(concept, self._score("class"), f"all of the source's {path[0]}", "class", subject)

    def _of_words(self, reading: Reading, texts: tuple[str, ...], subject: str) -> Finding:
        found = [self._of_text(reading, text) for text in texts]
        if decided := next((one for one in found if one.rule == "decision"), None):
            return replace(decided, subject=subject)
        named = [one for one in found if one.concept]
        if not named:
            return found[0] if found else Finding(None, 0.0, "no words", "none", subject)
        return replace(named[0], subject=subject)

    def _of_text(self, reading: Reading, text: str) -> Finding:
        key = (reading.domain, text, reading.whole)
        found = self._named.get(key)
        if found is None:
            found = self._named[key] = self._worked_out(reading, text)
        return found

    def _worked_out(self, reading: Reading, text: str) -> Finding:
        whole = folded(text)
        if exact := self._known(reading, whole, "exact"):
            return exact
        if _FRAGMENT.search(text) or _SET_OF.search(text):
            return Finding(None, 0.0, "a part, a cover, a model or a set", "part", whole)
        if _COUNTED.search(text):
            return Finding(None, 0.0, "several things", "set", whole)
        noun = noun_phrase(text)
        if (several := _SET.split(noun)) and len(several) > 1 and not reading.whole:
            return self._of_several(reading, several, whole)
        phrase = folded(noun)
        for form in dict.fromkeys((phrase, _NUMBER.sub("", phrase))):
            if exact := self._known(reading, form, "exact"):
                return exact
        if reading.whole:
            return Finding(None, 0.0, f"unknown name {phrase!r}", "unknown", phrase)
        if " " in phrase and (numbered := self._compound(reading, phrase)):
            return numbered
        return self._of_phrase(reading, _NUMBER.sub("", phrase))

    def _compound(self, reading: Reading, phrase: str) -> Finding | None:
        """A name of two words or more that the phrase ends with, its numbers kept (`karlstad 3 seters sofa`)."""
        for form in Phrase(phrase.split()).endings():
            if form.count(" ") and any(word.isdigit() for word in form.split()):
                if known := self._known(reading, form, "compound"):
                    return replace(known, subject=phrase)
        return None

    def _of_several(self, reading: Reading, several: list[str], whole: str) -> Finding:
        """The first of things joined by `and` where the others are its parts (a jar and lid), else nothing."""
        heads = [folded(noun_phrase(part)).rpartition(" ")[2] for part in several[1:]]
        if all(head in _PART_WORDS or head.rstrip("s") in _PART_WORDS for head in heads):
            return self._worked_out(reading, several[0])
        return Finding(None, 0.0, "several things", "set", whole)

    def _of_phrase(self, reading: Reading, phrase: str) -> Finding:
        before_of, of, _ = phrase.partition(" of ")
        words = Phrase((before_of if of else phrase).split())
        if not words:
            return Finding(None, 0.0, "no words", "none", phrase)
        head = words[-1]
        if {head, head.removesuffix("s")} & _PART_WORDS and not (len(words) == 1 and head in _WHOLE_ALONE and not of):
            return Finding(None, 0.0, f"{head!r} is a part of something", "part", phrase)
        for form, rule in _compounds(words):
            if known := self._known(reading, form, rule):
                return replace(known, subject=phrase)
        return Finding(None, 0.0, f"unknown name {phrase!r}", "unknown", phrase)

    def _known(self, reading: Reading, phrase: str, rule: str) -> Finding | None:
        domain = DOMAINS[reading.domain]
        ruled = next((self._meanings[form] for form in self.lexicon.forms(phrase) if form in self._meanings), None)
        if ruled and ruled.decision is None:
            return self._decided(ruled, phrase)
        if ruled and ruled.decision and fits(ruled.decision, domain, self.lexicon):
            rule = f"{rule}/ruled"
            return Finding(ruled.decision, self._score(rule), f"readers' decision on {phrase!r}", rule, phrase)
        senses = (sense(concepts, domain, self.lexicon) for concepts in self.lexicon.concepts(phrase))
        chosen = next(filter(None, senses), None)
        if chosen is None:
            return None
        rule = f"{rule}/{chosen.certainty}"
        return Finding(chosen.concept, self._score(rule), self._reason(phrase, chosen, reading), rule, phrase)

    def _reason(self, phrase: str, chosen: Sense, reading: Reading) -> str:
        name = self.lexicon.name(chosen.concept)
        why = {
            "sole": "its only sense that is a thing",
            "domain": f"the sense of {reading.domain}",
            "frequent": "the most frequent sense",
            "rare": "its only sense that is a thing, though another is more frequent",
        }[chosen.certainty]
        kind = "insertion" if chosen.concept.startswith(PREFIX) else "WordNet"
        return f"{phrase!r} is {name} ({kind}): {why}"

    def _refined(self, found: Finding, reading: Reading, title: str) -> Finding:
        """A narrower concept that the title's noun phrase names, where the source is read so."""
        if not (reading.refined and found.concept and title):
            return found
        narrower = self._of_text(reading, title)
        if narrower.concept and narrower.concept != found.concept and narrower.rule.startswith(("exact", "compound")):
            if self.lexicon.is_a(narrower.concept, (found.concept,)):
                return replace(narrower, subject=found.subject, reason=f"{found.reason}; title: {narrower.reason}")
        return found

    def _score(self, rule: str) -> float:
        """Measured share of right matches of the rule; before it is measured, what is believed of it."""
        if rule in self._reliability:
            return self._reliability[rule]
        return believed(rule)


def believed(rule: str) -> float:
    """The share of right matches believed of a rule before any is counted."""
    form, _, certainty = rule.partition("/")
    return _BELIEF[form] * _CERTAINTY.get(certainty, 1.0)


def reliabilities(counts: Mapping[str, tuple[int, int]]) -> dict[str, float]:
    """Share of right matches by rule from (right, all), drawn towards the belief where few were counted."""
    return {
        rule: round((right + _BELIEF_WEIGHT * believed(rule)) / (total + _BELIEF_WEIGHT), 3)
        for rule, (right, total) in sorted(counts.items())
    }


def _compounds(words: Phrase) -> Iterator[tuple[str, str]]:
    """Names to try, longest known compound first: endings of two words or more, a modifier with the head, the head."""
    for form in words.endings():
        if " " in form:
            yield form, "compound"
    for form in words.pairs():
        yield form, "compound"
    yield words[-1], "exact" if len(words) == 1 else "head"


def _texts(reading: Reading, path: tuple[str, ...], title: str) -> tuple[str, ...]:
    by_words = {
        "last": path[-1:],
        "path": (" ".join(path),),
        "alternatives": tuple(part for text in path[-1:] for part in text.split(",")),
        "title, last": (title, *reversed(path[1:] or path)),
    }
    return tuple(text for text in by_words[reading.words] if text)


@cache
def default_matcher() -> Matcher:
    """The matcher of this checkout's tables."""
    return Matcher(default_lexicon(), default_readings(), default_rulings(), _measured())


def _measured(path: Path | None = None) -> Mapping[str, float]:
    file = path or taxonomy_directory() / _RELIABILITY_FILE
    if not file.is_file():
        return {}
    rules: Mapping[str, float] = json.loads(file.read_text(encoding="utf-8"))["reliability"]
    return rules
