"""From one text to a concept: the whole name if it is known, else its longest known compound, else its head noun."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from taxonomy.inserted_categories import PREFIX
from taxonomy.matching.decisions import Decision
from taxonomy.matching.finding import ConceptMatch, believed_reliability, no_concept
from taxonomy.matching.lexicon import Lexicon
from taxonomy.matching.sense_choice import Certainty, Domain, chosen_sense, fits
from taxonomy.words.phrases import endings, noun_phrase, pairs, word_list
from taxonomy.words.senses import Sense
from taxonomy.words.spelling import fold_text

__all__ = ["Namer"]


#: Several items under one name: `cup and saucer`, `table+4 chairs`, `set of spoons`.
_AND = re.compile(r"\s(?:and|&|\+|plus)\s|(?<=\w)\+\s?(?=\w)|\s\+", re.IGNORECASE)
_AND_COUNTED = re.compile(r"(?:\+|\band\b|&)\s?(?:\d+|two|three|four|six)\b", re.IGNORECASE)
_SET_OF = re.compile(r"^(?:an?\s+)?(?:set|suite|group|collection|pieces|assortment)\b", re.IGNORECASE)

#: A part, a model or a cover of an item; the last two are Norwegian (cover, legs for).
_OF_AN_ITEM = re.compile(
    r"\b(?:fragments?|model (?:for|of)|covers? for|legs? for|part of|trekk|ben til)\b", re.IGNORECASE
)

_NUMBER = re.compile(r"\b\d+\b\s*")


_WHY: Mapping[Certainty, str] = {
    "sole": "its only sense that is an object",
    "domain": "the sense of the source's domain",
    "path": "the sense that the category path names too",
    "usual": "the usual sense, as a reviewer ordered them",
    "frequent": "the most frequent sense",
    "rare": "its only sense that is an object, though another is more frequent",
}

#: Concepts that the category path of an item names besides the text that is read.
Near = tuple[str, ...]


class Usage(NamedTuple):
    """What a source's words are about: its domain, and what else the item's category path names."""

    domain: Domain
    near: Near = ()


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
        self._memory: dict[tuple[int, str, bool, Near], ConceptMatch] = {}

    def finding(self, text: str, domain: Domain, whole: bool = False, near: Near = ()) -> ConceptMatch:
        """The concept that a text names in a domain.

        With `whole`, only where the whole name is known; `near` is what else the item's category path names.
        """
        key = (id(domain), text, whole, near)
        finding = self._memory.get(key)
        if finding is None:
            finding = self._memory[key] = self._new_finding(text, Usage(domain, near), whole)
        return finding

    def score(self, rule: str) -> float:
        """Measured share of right matches of a rule; before it is measured, what is believed of it."""
        return self._reliability.get(rule) or believed_reliability(rule)

    def finding_of_decision(self, ruling: Decision, subject: str) -> ConceptMatch:
        """The finding of a reviewers' decision."""
        why = f"reviewers' decision: {ruling.why}" if ruling.why else "reviewers' decision"
        return ConceptMatch(ruling.decision, self.score("decision"), why, "decision", subject)

    def _new_finding(self, text: str, usage: Usage, whole: bool) -> ConceptMatch:
        said = fold_text(text)
        noun = noun_phrase(text)
        phrase = fold_text(noun)
        bare = _NUMBER.sub("", phrase)
        if known := self._finding_of_name(said, usage, "exact"):
            return known
        if several := self._several(text, noun, usage, whole):
            return several
        known = self._finding_of_name(phrase, usage, "exact") or self._finding_of_name(bare, usage, "exact")
        if known or whole:
            return known or no_concept("unknown", f"unknown name {phrase!r}", phrase)
        return self._finding_with_number(phrase, usage) or self._of_phrase(bare, usage)

    def _several(self, text: str, noun: str, usage: Usage, whole: bool) -> ConceptMatch | None:
        """Why a text names no single item; or the first of items joined by `and`, where the others are its parts."""
        if _OF_AN_ITEM.search(text):
            return no_concept("part", "a part, a cover or a model", fold_text(text))
        if _SET_OF.search(text) or _AND_COUNTED.search(text):
            return no_concept("set", "several items", fold_text(text))
        first, *others = _AND.split(noun)
        if whole or not others:
            return None
        heads = (fold_text(noun_phrase(other)).rpartition(" ")[2] for other in others)
        if all({head, head.removesuffix("s")} & word_list("parts") for head in heads):
            return self._new_finding(first, usage, whole)
        return no_concept("set", "several items", fold_text(text))

    def _finding_with_number(self, phrase: str, usage: Usage) -> ConceptMatch | None:
        """A name with a number in it that the phrase ends with (`karlstad 3 seters sofa`)."""
        for form in endings(phrase.split()):
            numbered = " " in form and any(word.isdigit() for word in form.split())
            if numbered and (known := self._finding_of_name(form, usage, "compound")):
                return replace(known, subject=phrase)
        return None

    def _of_phrase(self, phrase: str, usage: Usage) -> ConceptMatch:
        before_of, of, _ = phrase.partition(" of ")
        words = (before_of if of else phrase).split()
        if not words:
            return no_concept("none", "no words", phrase)
        head = words[-1]
        alone = len(words) == 1 and head in word_list("whole_alone") and not of
        if {head, head.removesuffix("s")} & word_list("parts") and not alone:
            return no_concept("part", f"{head!r} is a part of something", phrase)
        for form, rule in _compounds(words):
            if known := self._finding_of_name(form, usage, rule):
                return replace(known, subject=phrase)
        return no_concept("unknown", f"unknown name {phrase!r}", phrase)

    def _finding_of_name(self, phrase: str, usage: Usage, rule: str) -> ConceptMatch | None:
        """The finding of a phrase that is a name in itself: by a reviewer's word on it, else by its senses."""
        forms = self.lexicon.forms(phrase)
        if ruled := next((self._meanings[form] for form in forms if form in self._meanings), None):
            return self._apply_decision(ruled, phrase, usage, rule)
        choices = (
            chosen_sense(known, usage.domain, form, usage.near) for form, known in self.lexicon.senses(phrase).items()
        )
        choice = next(filter(None, choices), None)
        if choice is None:
            return None
        chosen, certainty = choice
        rule = f"{rule}/{certainty}"
        return ConceptMatch(chosen.concept, self.score(rule), self._reason(phrase, chosen, certainty), rule, phrase)

    def _apply_decision(self, ruled: Decision, phrase: str, usage: Usage, rule: str) -> ConceptMatch | None:
        if ruled.decision is None:
            return self.finding_of_decision(ruled, phrase)
        # a reviewer may call a handle an item, which WordNet lists as a part; a narrow domain still has to fit
        if usage.domain.narrow and not fits(self.lexicon.sense(ruled.decision), usage.domain):
            return None
        rule = f"{rule}/ruled"
        return ConceptMatch(ruled.decision, self.score(rule), f"reviewers' decision on {phrase!r}", rule, phrase)

    def _reason(self, phrase: str, chosen: Sense, certainty: Certainty) -> str:
        kind = "insertion" if chosen.concept.startswith(PREFIX) else "WordNet"
        return f"{phrase!r} is {self.lexicon.name(chosen.concept)} ({kind}): {_WHY[certainty]}"


def _compounds(words: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Names to try, longest first: endings of two words or more, a modifier with the head, the head."""
    yield from ((form, "compound") for form in endings(words) if " " in form)
    yield from ((form, "compound") for form in pairs(words))
    yield words[-1], "exact" if len(words) == 1 else "head"
