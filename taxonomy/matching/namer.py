"""From one text to a concept: the whole name if it is known, else its longest known compound, else its head noun."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace

from taxonomy.insertions import PREFIX
from taxonomy.matching.decisions import Decision
from taxonomy.matching.finding import Finding, believed_reliability, no_concept
from taxonomy.matching.lexicon import Lexicon
from taxonomy.matching.senses import Domain, Sense, fits, sense
from taxonomy.matching.words import Phrase, noun_phrase
from taxonomy.naming.spelling import fold_text

__all__ = ["Namer"]


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


#: Heads that name a part, a cover or a stuff that goes with the thing named before them.
_PART_WORDS = _words(
    "accessory armrest arm attachment backrest base blade body box bracket bumper cable canopy case caster castor "
    "chassis clip collection combination component compartment connector corner cover design detail divider element "
    "end extension filling fitting foot fragment frame front gauge handle head headrest hinge insert kit knob leg lid "
    "lining mount mounting net pack pad panel part parts pattern piece plinth portion post project proposal protector "
    "rail refill roller runner sample seat section segment service set shell side skirt slat spare study support "
    "surround template top tray underframe unit upright view wing"
)

#: Part words that are things of their own when they stand alone.
_WHOLE_ALONE = _words("box case cover frame handle head kit knob lid net pad panel rail seat tray")

#: Several things under one name: `cup and saucer`, `table+4 chairs`, `set of spoons`.
_AND = re.compile(r"\s(?:and|&|\+|plus)\s|(?<=\w)\+\s?(?=\w)|\s\+", re.IGNORECASE)
_AND_COUNTED = re.compile(r"(?:\+|\band\b|&)\s?(?:\d+|two|three|four|six)\b", re.IGNORECASE)
_SET_OF = re.compile(r"^(?:an?\s+)?(?:set|suite|group|collection|pieces|assortment)\b", re.IGNORECASE)

#: A part, a model or a cover of the thing; the last two are Norwegian (cover, legs for).
_OF_THE_THING = re.compile(
    r"\b(?:fragments?|model (?:for|of)|covers? for|legs? for|part of|trekk|ben til)\b", re.IGNORECASE
)

_NUMBER = re.compile(r"\b\d+\b\s*")


class Namer:
    """Names texts of any source; remembers its answers, so that each text is matched once.

    Parameters
    ----------
    lexicon : names that can be matched.
    meanings : reviewers' decisions on words that hold for every source, by folded word.
    reliability : measured share of right matches by rule.
    """

    def __init__(
        self, lexicon: Lexicon, meanings: Mapping[str, Decision], reliability: Mapping[str, float] | None = None
    ) -> None:
        self.lexicon = lexicon
        self._meanings = meanings
        self._reliability = reliability or {}
        self._memory: dict[tuple[int, str, bool], Finding] = {}

    def finding(self, text: str, domain: Domain, whole: bool = False) -> Finding:
        """The concept that a text names in a domain; with `whole`, only where the whole name is known."""
        key = (id(domain), text, whole)
        finding = self._memory.get(key)
        if finding is None:
            finding = self._memory[key] = self._new_finding(text, domain, whole)
        return finding

    def score(self, rule: str) -> float:
        """Measured share of right matches of a rule; before it is measured, what is believed of it."""
        return self._reliability.get(rule) or believed_reliability(rule)

    def finding_of_decision(self, ruling: Decision, subject: str) -> Finding:
        """The finding of a reviewers' decision."""
        why = f"reviewers' decision: {ruling.why}" if ruling.why else "reviewers' decision"
        return Finding(ruling.decision, self.score("decision"), why, "decision", subject)

    def _new_finding(self, text: str, domain: Domain, whole: bool) -> Finding:
        said = fold_text(text)
        noun = noun_phrase(text)
        phrase = fold_text(noun)
        bare = _NUMBER.sub("", phrase)
        if known := self._finding_of_name(said, domain, "exact"):
            return known
        if several := self._several(text, noun, domain, whole):
            return several
        known = self._finding_of_name(phrase, domain, "exact") or self._finding_of_name(bare, domain, "exact")
        if known or whole:
            return known or no_concept("unknown", f"unknown name {phrase!r}", phrase)
        return self._finding_with_number(phrase, domain) or self._of_phrase(bare, domain)

    def _several(self, text: str, noun: str, domain: Domain, whole: bool) -> Finding | None:
        """Why a text names no single thing; or the first of things joined by `and`, where the others are its parts."""
        if _OF_THE_THING.search(text):
            return no_concept("part", "a part, a cover or a model", fold_text(text))
        if _SET_OF.search(text) or _AND_COUNTED.search(text):
            return no_concept("set", "several things", fold_text(text))
        first, *others = _AND.split(noun)
        if whole or not others:
            return None
        heads = (fold_text(noun_phrase(other)).rpartition(" ")[2] for other in others)
        if all({head, head.removesuffix("s")} & _PART_WORDS for head in heads):
            return self._new_finding(first, domain, whole)
        return no_concept("set", "several things", fold_text(text))

    def _finding_with_number(self, phrase: str, domain: Domain) -> Finding | None:
        """A name with a number in it that the phrase ends with (`karlstad 3 seters sofa`)."""
        for form in Phrase(phrase.split()).endings():
            numbered = " " in form and any(word.isdigit() for word in form.split())
            if numbered and (known := self._finding_of_name(form, domain, "compound")):
                return replace(known, subject=phrase)
        return None

    def _of_phrase(self, phrase: str, domain: Domain) -> Finding:
        before_of, of, _ = phrase.partition(" of ")
        words = Phrase((before_of if of else phrase).split())
        if not words:
            return no_concept("none", "no words", phrase)
        head = words[-1]
        alone = len(words) == 1 and head in _WHOLE_ALONE and not of
        if {head, head.removesuffix("s")} & _PART_WORDS and not alone:
            return no_concept("part", f"{head!r} is a part of something", phrase)
        for form, rule in _compounds(words):
            if known := self._finding_of_name(form, domain, rule):
                return replace(known, subject=phrase)
        return no_concept("unknown", f"unknown name {phrase!r}", phrase)

    def _finding_of_name(self, phrase: str, domain: Domain, rule: str) -> Finding | None:
        """The finding of a phrase that is a name in itself: by a reviewer's word on it, else by its senses."""
        forms = self.lexicon.forms(phrase)
        if ruled := next((self._meanings[form] for form in forms if form in self._meanings), None):
            return self._apply_decision(ruled, phrase, domain, rule)
        senses = (sense(concepts, domain, self.lexicon) for concepts in self.lexicon.concepts(phrase))
        chosen = next(filter(None, senses), None)
        if chosen is None:
            return None
        rule = f"{rule}/{chosen.certainty}"
        return Finding(chosen.concept, self.score(rule), self._reason(phrase, chosen), rule, phrase)

    def _apply_decision(self, ruled: Decision, phrase: str, domain: Domain, rule: str) -> Finding | None:
        if ruled.decision is None:
            return self.finding_of_decision(ruled, phrase)
        # a reviewer may call a handle a thing, which WordNet lists as a part; a narrow domain still has to fit
        if domain.narrow and not fits(ruled.decision, domain, self.lexicon):
            return None
        rule = f"{rule}/ruled"
        return Finding(ruled.decision, self.score(rule), f"reviewers' decision on {phrase!r}", rule, phrase)

    def _reason(self, phrase: str, chosen: Sense) -> str:
        why = {
            "sole": "its only sense that is a thing",
            "domain": "the sense of the source's domain",
            "frequent": "the most frequent sense",
            "rare": "its only sense that is a thing, though another is more frequent",
        }[chosen.certainty]
        kind = "insertion" if chosen.concept.startswith(PREFIX) else "WordNet"
        return f"{phrase!r} is {self.lexicon.name(chosen.concept)} ({kind}): {why}"


def _compounds(words: Phrase) -> Iterator[tuple[str, str]]:
    """Names to try, longest first: endings of two words or more, a modifier with the head, the head."""
    yield from ((form, "compound") for form in words.endings() if " " in form)
    yield from ((form, "compound") for form in words.pairs())
    yield words[-1], "exact" if len(words) == 1 else "head"
