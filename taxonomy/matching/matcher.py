"""From a source's words to a concept: a WordNet synset or a reviewed insertion, with a score and a reason."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache

from taxonomy.matching.decisions import EVERY_SOURCE, Decision, default_rulings
from taxonomy.matching.finding import THRESHOLD, ConceptMatch, measured_reliability, no_concept
from taxonomy.matching.lexicon import Lexicon, default_lexicon
from taxonomy.matching.namer import Namer
from taxonomy.matching.sense_choice import DOMAINS, Domain, fits
from taxonomy.matching.source_reading import BadReading, Reading, default_readings, reading_of
from taxonomy.wordnet import UnknownSynset
from taxonomy.words.phrases import noun_phrase
from taxonomy.words.spelling import fold_text

__all__ = ["THRESHOLD", "ConceptMatch", "Matcher", "default_matcher"]

#: What parts a shop's title: `FREKVENS: Bar stool, in/outdoor`, `Acme - Folding Chair | Black`.
_TITLE_BREAKS = re.compile(r"\s*[:;,|()]\s*|\s+[-–—]\s+")

#: A brand or a series in capitals before a colon, which may well be a word (`BILLY: Bookcase`).
_SERIES = re.compile(r"^[^a-z:]+:\s*")


class Matcher:
    """Finds the concepts of items; deterministic, and as fast as a look-up for words it has met.

    Parameters
    ----------
    lexicon : names that can be matched.
    readings : how each source is read.
    rulings : reviewers' decisions by source (or `*`) and subject.
    reliability : measured share of right matches by rule.

    Raises
    ------
    BadReading
        A reading gives a class a concept that the lexicon does not know.
    """

    def __init__(
        self,
        lexicon: Lexicon,
        readings: Mapping[str, Reading],
        rulings: Mapping[tuple[str, str], Decision],
        reliability: Mapping[str, float] | None = None,
    ) -> None:
        for source, reading in readings.items():
            for name, concept in reading.classes.items():
                if not lexicon.knows(concept):
                    raise BadReading(f"{source}: class {name}: expected a synset or an insertion; found {concept!r}")
        meanings = {words: ruling for (source, words), ruling in rulings.items() if source == EVERY_SOURCE}
        self.lexicon = lexicon
        self._readings = readings
        self._rulings = rulings
        self._namer = Namer(lexicon, meanings, reliability)

    def finding(
        self, source: str, category_path: tuple[str, ...], title: str = "", synset: str | None = None
    ) -> ConceptMatch:
        """The concept of an item, or the reason why it has no concept.

        A reviewer's decision counts first, then the synset that the source itself names, then a whole class of the
        source (a museum's paintings), then the words.
        """
        reading = reading_of(source, self._readings)
        texts = _texts(reading, category_path, title)
        subject = fold_text(texts[0]) if texts else fold_text(title)
        finding = (
            self._finding_by_decision(source, category_path, texts)
            or self._finding_by_source_synset(synset, subject)
            or self._of_class(reading, category_path, subject)
            or self._of_title(reading, category_path, texts, title)
            or self._of_words(reading, texts, subject, category_path)
        )
        return self._narrow(finding, reading, title)

    def _finding_by_decision(self, source: str, path: tuple[str, ...], texts: tuple[str, ...]) -> ConceptMatch | None:
        whole_path = " > ".join(fold_text(part) for part in path)
        nouns = (fold_text(noun_phrase(text)) for text in texts)
        for subject in dict.fromkeys((*map(fold_text, texts[:1]), whole_path, *map(fold_text, texts), *nouns)):
            if ruling := self._rulings.get((source, subject)):
                return self._namer.finding_of_decision(ruling, subject)
        return None

    def _finding_by_source_synset(self, synset: str | None, subject: str) -> ConceptMatch | None:
        if not synset:
            return None
        try:
            concept = self.lexicon.wordnet.synset_at(synset) if synset[1:].isdigit() else synset
        except UnknownSynset:
            return None
        if not (self.lexicon.knows(concept) and fits(self.lexicon.sense(concept), DOMAINS["objects"])):
            return None
        return ConceptMatch(
            concept, self._namer.score("source synset"), "the source names it", "source synset", subject
        )

    def _of_class(self, reading: Reading, path: tuple[str, ...], subject: str) -> ConceptMatch | None:
        concept = reading.classes.get(path[0]) if path else None
        if concept is None:
            return None
        return ConceptMatch(concept, self._namer.score("class"), f"all of the source's {path[0]}", "class", subject)

    def _of_title(
        self, reading: Reading, path: tuple[str, ...], texts: tuple[str, ...], title: str
    ) -> ConceptMatch | None:
        """What the title alone names, by rules and scores of its own, where a source gives neither path nor synset."""
        if path or texts or not title:
            return None
        named = _SERIES.sub("", title)
        form = "title" if named == title else "title of series"
        for part in filter(None, _TITLE_BREAKS.split(named)):
            finding = self._namer.finding(part, DOMAINS[reading.domain])
            if finding.concept or finding.rule in {"part", "set"}:
                rule = f"{form} {finding.rule}"
                score = self._namer.score(rule) if finding.concept else finding.score
                return replace(
                    finding, rule=rule, score=score, reason=f"title: {finding.reason}", subject=fold_text(title)
                )
        return no_concept("unknown", "no name in the title", fold_text(title))

    def _of_words(self, reading: Reading, texts: tuple[str, ...], subject: str, path: tuple[str, ...]) -> ConceptMatch:
        domain = DOMAINS[reading.domain]
        near = tuple(self._named_by_path(path[:-1], domain)) if reading.words == "last" else ()
        findings = [self._namer.finding(text, domain, reading.whole, near) for text in texts]
        named = (one for one in findings if one.rule == "decision" or one.concept)
        return replace(
            next(named, findings[0] if findings else no_concept("none", "no words", subject)), subject=subject
        )

    def _named_by_path(self, path: tuple[str, ...], domain: Domain) -> Iterator[str]:
        """The concepts that elements of a category path are names of."""
        for part in path:
            finding = self._namer.finding(part, domain, whole=True)
            if finding.concept:
                yield finding.concept

    def _narrow(self, finding: ConceptMatch, reading: Reading, title: str) -> ConceptMatch:
        """A narrower concept that the title's noun phrase names, where the source is read so."""
        if not (reading.refined and finding.concept and title):
            return finding
        narrower = self._namer.finding(title, DOMAINS[reading.domain])
        if narrower.concept in (None, finding.concept) or not narrower.rule.startswith(("exact", "compound")):
            return finding
        if not self.lexicon.is_a(narrower.concept or "", finding.concept):
            return finding
        return replace(narrower, subject=finding.subject, reason=f"{finding.reason}; title: {narrower.reason}")


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
    return Matcher(default_lexicon(), default_readings(), default_rulings(), measured_reliability())
