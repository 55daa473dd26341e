"""From a text to a node: the one way in which the tree, the estimator and the commands read a name.

The forms of a text are tried from the plainest to the boldest, and the first that names a node answers: as it is
written, without numbers and articles, singular, without spaces; two alternatives that agree (`couch/sofa`), the last
part of a dotted path; what a count names (`pair of scissors`), the name before `with` or `riding`; a word of WordNet
whose kind is in the tree; the name without adjectives, colours, materials and rooms; the head noun, if compounds that
end in it are known to be such things. What is left is unknown: no likeness of spelling is ever taken for a name.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence

from taxonomy.naming.answers import NEAR, Answer, Lookup
from taxonomy.naming.candidates import Candidate, Names
from taxonomy.naming.evidence import coded_node
from taxonomy.naming.modifiers import (
    after_counts,
    container_and_content,
    is_plain_adjective,
    leading_phrase,
    without_numbers,
)
from taxonomy.naming.nearest import Nearest
from taxonomy.naming.phrases import Phrases
from taxonomy.naming.spelling import plain_fold

__all__ = ["NEAR", "Answer", "Resolver"]

_CODE = re.compile(r"^(?:n\d{8}|/m/[0-9a-z_]+|/g/[0-9a-z_]+)$")
_ALTERNATIVES = re.compile(r"\s*(?:/|\||\bor\b)\s*")


class Resolver:
    """Reads names for the nodes of one release.

    Parameters
    ----------
    names : the nodes by their names.
    """

    def __init__(self, names: Names) -> None:
        self._names = names
        self._lookup = Lookup(names)
        self._phrases = Phrases(names, self._lookup)
        self._nearest = Nearest(names, self.answer)

    def answer(self, text: str) -> Answer | None:
        """What a text means, or None if nothing of the tree is meant."""
        if text in self._names:
            return Answer((Candidate(text, math.inf, "id"),), "id", math.inf)
        if _CODE.match(text):
            node = coded_node(text)
            return self._lookup.at(node, "code") if node else None
        if written := self._lookup.literal(text):
            return written
        parts = [part for part in _ALTERNATIVES.split(text) if part]
        if len(parts) > 1:
            return self._common_answer(parts)
        return self._compound_answer(text) or self._phrase(text)

    def _compound_answer(self, text: str) -> Answer | None:
        """The answer for dotted paths and inverted names (`table, dining`)."""
        if "." in text.strip(".") and " " not in text.strip():
            *_, before, last = ["", *filter(None, text.split("."))]
            return self._lookup.literal(last) or (self._lookup.literal(before) if before and plain_fold(last) else None)
        parts = [part.strip() for part in text.split(",") if part.strip()]
        if len(parts) > 1:
            inverted = " ".join((*parts[1:], parts[0])) if len(parts) == 2 else ""
            tried = (self.answer(part) for part in (inverted, *parts) if part)
            return next((answer for answer in tried if answer is not None), None)
        return None

    def _common_answer(self, parts: Sequence[str]) -> Answer | None:
        """The one answer of several alternatives, or None where they disagree."""
        answers = [answer for part in parts if (answer := self.answer(part)) is not None]
        first = answers[0] if len(answers) == len(parts) else None
        same = first is not None and all(self._lookup.same(first.node_id, one.node_id) for one in answers)
        return first if same else None

    def _phrase(self, text: str) -> Answer | None:
        """The answer for a phrase: what it counts, what comes before `with`, its kind in WordNet, its bare name."""
        plain = text.replace("_", " ").replace("-", " ") if " " not in text.strip() else text
        if holding := container_and_content(plain):
            container, content = holding
            return self._lookup.of_form(plain_fold(f"{content} {container}")) or self._lookup.of_form(container)
        counted = after_counts(plain)
        if counted and (answer := self.answer(counted)):
            return answer
        form = plain_fold(without_numbers(plain))
        words = form.split()
        adjective = len(words) > 1 and is_plain_adjective(words[0])
        answer = self._phrases.bare(words) if adjective else self._phrases.of_wordnet(form)
        if answer and adjective and self._phrases.misleads(form, answer):
            return self._phrases.of_wordnet(form)
        if answer:
            return answer
        led = leading_phrase(plain)
        if led and (answer := self.answer(led)):
            return answer
        return self._phrases.bare(words) if not led else None

    def nodes_by_relevance(self, text: str, limit: int) -> Iterator[str]:
        """At most `limit` nodes for what a person types: meanings, names that begin so or hold it, like spellings."""
        return self._nearest.nodes(text, limit)

    def nearest(self, text: str, count: int = 3) -> list[str]:
        """Known names that may help with an unknown text: of near spelling, a broader kind, the head noun; or none."""
        return self._nearest.names(text, count)
