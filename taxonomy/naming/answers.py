"""What a text means: the likeliest candidates, how they were reached, how sure that is; names as they are written.

A form of a text is looked up as it is, singular, and without its spaces.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from taxonomy.naming.candidates import Candidate, Names, folded_forms
from taxonomy.naming.modifiers import without_numbers
from taxonomy.naming.spelling import plain_fold, singular_phrases

__all__ = ["NEAR", "Answer", "Lookup"]

#: Two senses whose evidence differs by less are both meant.
NEAR = 1.05

#: What words in brackets add to a candidate that they name: more than anything else does.
HINT = 10.0

#: Shortest name that is looked up without its spaces: shorter ones meet by accident.
SHORTEST_COMPACT = 5

_BRACKETS = re.compile(r"[\s_]*\(([^()]*)\)")


@dataclass(frozen=True, slots=True)
class Answer:
    """What a text means: the likeliest candidate first; `how` it was reached; `margin` to the next that is not kin."""

    candidates: tuple[Candidate, ...]
    how: str
    margin: float

    @property
    def node_id(self) -> str:
        """The node that is meant."""
        return self.candidates[0].node_id

    @property
    def ambiguous(self) -> bool:
        """Whether another sense is as likely."""
        return self.margin < NEAR


class Lookup:
    """Names of one release, looked up as they are written.

    Parameters
    ----------
    names : the nodes by their names.
    """

    def __init__(self, names: Names) -> None:
        self._names = names

    def literal(self, text: str) -> Answer | None:
        """The answer for a text that is a name as it is, in brackets, counted, plural, or without its spaces."""
        hint = _BRACKETS.search(text)
        bare = _BRACKETS.sub("", text) if hint else text
        for form in folded_forms(text):
            if answer := self.best(self._names.candidates(form), None):
                return answer
        for plain in dict.fromkeys((bare, without_numbers(bare))):
            for form in folded_forms(plain):
                if answer := self.of_form(form, hint[1] if hint else None):
                    return answer
        return None

    def of_form(self, form: str, hint: str | None = None) -> Answer | None:
        """The answer for a folded form: as it is, singular, without its spaces."""
        if not form:
            return None
        if candidates := self._names.candidates(form):
            return self.best(candidates, None, hint)
        for single in singular_phrases(form):
            if candidates := self._names.candidates(single):
                return self.best(candidates, "folded", hint)
        return self._of_letters(form, hint)

    def _of_letters(self, form: str, hint: str | None) -> Answer | None:
        for letters in dict.fromkeys(one.replace(" ", "") for one in (form, *singular_phrases(form))):
            if len(letters) >= SHORTEST_COMPACT:
                for spelt in self._names.compact.get(letters, ()):
                    if candidates := self._names.candidates(spelt):
                        return self.best(candidates, "folded", hint)
        return None

    def best(self, candidates: Sequence[Candidate], how: str | None, hint: str | None = None) -> Answer | None:
        """The likeliest of several candidates, as an answer; None of none."""
        if not candidates:
            return None
        if hint is not None:
            candidates = self._order_by_hint(candidates, hint)
        best = candidates[0]
        rival = next((one for one in candidates[1:] if not self.same(best.node_id, one.node_id)), None)
        margin = best.score - rival.score if rival else math.inf
        return Answer(tuple(candidates), how or best.how, margin)

    def _order_by_hint(self, candidates: Sequence[Candidate], hint: str) -> list[Candidate]:
        """Candidates whose kinds the words in brackets name come first (`bow (weapon)`)."""
        words = set(plain_fold(hint).split())

        def names(one: Candidate) -> bool:
            above = (one.node_id, *self._names.ancestors(one.node_id), *self._names.hypernyms(one.node_id))
            shown = (plain_fold(node.partition(".")[0].removeprefix("mt:")) for node in above)
            return any(words & set(name.split()) for name in shown)

        hinted = [Candidate(one.node_id, one.score + HINT, one.how) for one in candidates if names(one)]
        return hinted + [one for one in candidates if not names(one)]

    def same(self, one: str, other: str) -> bool:
        """Whether two nodes are one, or kin."""
        return one == other or self._names.kin(one, other)

    def at(self, node: str, how: str) -> Answer | None:
        """The answer that is one node, if the release has it."""
        if node not in self._names:
            return None
        return Answer((Candidate(node, 0.0, how),), how, math.inf)
