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
from dataclasses import dataclass

from taxonomy.naming.candidates import Candidate, Names, folded_forms
from taxonomy.naming.evidence import coded_node, head_trust, senses
from taxonomy.naming.modifiers import (
    ALIENATING,
    CONTAINERS,
    OF_THE_LIVING,
    after_counts,
    container_and_content,
    is_plain_adjective,
    leading_phrase,
    modifiers,
    without_numbers,
)
from taxonomy.naming.spelling import plain_fold, singular_phrases

__all__ = ["NEAR", "Answer", "Resolver"]

#: Two senses whose evidence differs by less are both meant.
NEAR = 1.05

#: Share of the known compounds of a head noun that are such things, from which the head alone is taken.
HEAD_TRUST = 0.65
#: Compounds that must be known before a head noun is taken.
HEAD_COMPOUNDS = 4

#: Likeness of spelling (`difflib`'s ratio) from which a name is worth comparing letter by letter.
NEAR_SPELLING = 0.75

#: What words in brackets add to a candidate that they name: more than anything else does.
HINT = 10.0

#: Shortest name that is looked up without its spaces: shorter ones meet by accident.
SHORTEST_COMPACT = 5

#: Levels of the tree (the root is 1) from which a broader kind is taken: a stocking is no footwear of 30 by 10 cm. One
#: level further up only by its own name (an electric car is a car), and never further (no container, no vehicle).
LEAST_DEPTH = 4
LEAST_NAMED = 3

#: Above everything that lives.
_LIVING = {"animal.n.01", "mt:human", "person.n.01", "organism.n.01"}

#: A juicer is a thing before it is somebody.
_PERSON = "person.n.01"

_CODE = re.compile(r"^(?:n\d{8}|/m/[0-9a-z_]+|/g/[0-9a-z_]+)$")
_ALTERNATIVES = re.compile(r"\s*(?:/|\||\bor\b)\s*")
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


class Resolver:
    """Reads names for the nodes of one release.

    Parameters
    ----------
    names : the nodes by their names.
    """

    def __init__(self, names: Names) -> None:
        self._names = names

    def answer(self, text: str) -> Answer | None:
        """What a text means, or None if nothing of the tree is meant."""
        if text in self._names:
            return Answer((Candidate(text, math.inf, "id"),), "id", math.inf)
        if _CODE.match(text):
            node = coded_node(text)
            return self._at(node, "code") if node else None
        if written := self._literal_answer(text):
            return written
        parts = [part for part in _ALTERNATIVES.split(text) if part]
        if len(parts) > 1:
            return self._common_answer(parts)
        return self._compound_answer(text) or self._phrase(text)

    def _literal_answer(self, text: str) -> Answer | None:
        """The answer for a text that is a name as it is, in brackets, counted, plural, or without its spaces."""
        hint = _BRACKETS.search(text)
        bare = _BRACKETS.sub("", text) if hint else text
        for form in folded_forms(text):
            if answer := self._of(self._names.candidates(form), None):
                return answer
        for plain in dict.fromkeys((bare, without_numbers(bare))):
            for form in folded_forms(plain):
                if answer := self._of_form(form, hint[1] if hint else None):
                    return answer
        return None

    def _of_form(self, form: str, hint: str | None = None) -> Answer | None:
        if not form:
            return None
        if candidates := self._names.candidates(form):
            return self._of(candidates, None, hint)
        for single in singular_phrases(form):
            if candidates := self._names.candidates(single):
                return self._of(candidates, "folded", hint)
        return self._of_letters(form, hint)

    def _of_letters(self, form: str, hint: str | None) -> Answer | None:
        for letters in dict.fromkeys(one.replace(" ", "") for one in (form, *singular_phrases(form))):
            if len(letters) >= SHORTEST_COMPACT:
                for spelt in self._names.compact.get(letters, ()):
                    if candidates := self._names.candidates(spelt):
                        return self._of(candidates, "folded", hint)
        return None

    def _compound_answer(self, text: str) -> Answer | None:
        """The answer for dotted paths and inverted names (`table, dining`)."""
        if "." in text.strip(".") and " " not in text.strip():
            *_, before, last = ["", *filter(None, text.split("."))]
            return self._literal_answer(last) or (self._literal_answer(before) if before and plain_fold(last) else None)
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
        same = first is not None and all(self._same(first.node_id, one.node_id) for one in answers)
        return first if same else None

    def _phrase(self, text: str) -> Answer | None:
        """The answer for a phrase: what it counts, what comes before `with`, its kind in WordNet, its bare name."""
        plain = text.replace("_", " ").replace("-", " ") if " " not in text.strip() else text
        if holding := container_and_content(plain):
            container, content = holding
            return self._of_form(plain_fold(f"{content} {container}")) or self._of_form(container)
        counted = after_counts(plain)
        if counted and (answer := self.answer(counted)):
            return answer
        form = plain_fold(without_numbers(plain))
        words = form.split()
        adjective = len(words) > 1 and is_plain_adjective(words[0])
        answer = self._bare(words) if adjective else self._of_wordnet(form)
        if answer:
            return answer
        led = leading_phrase(plain)
        if led and (answer := self.answer(led)):
            return answer
        return self._bare(words) if not led else None

    def _bare(self, words: Sequence[str]) -> Answer | None:
        """The answer for a name after its modifiers are taken away, one by one from the left."""
        living = False
        while len(words) > 1 and (leading := modifiers(words)):
            living = living or words[0] in OF_THE_LIVING
            words = words[leading:]
            form = " ".join(words)
            answer = self._of_form(form) or self._of_wordnet(form)
            if answer and (self._too_broad(answer.node_id, words[-1]) or (living and not self._lives(answer.node_id))):
                return None
            if answer:
                return Answer(answer.candidates, "modifier stripped", answer.margin)
            if senses(form):
                return None
        return self._head(words)

    def _head(self, words: Sequence[str]) -> Answer | None:
        """The answer for the head noun, if the compounds that end in it are such things."""
        if len(words) < 2 or len(words) > 4 or ALIENATING & set(words[:-1]):
            return None
        head = next((one for one in (words[-1], *singular_phrases(words[-1])) if self._names.candidates(one)), None)
        answer = self._of(self._names.candidates(head), None) if head else None
        if head is None or answer is None or answer.ambiguous:
            return None
        kinds, compounds = head_trust(head).get(answer.node_id, (0, 0))
        trusted = compounds >= HEAD_COMPOUNDS and kinds / compounds >= HEAD_TRUST
        if trusted or head in CONTAINERS:
            return Answer(answer.candidates, "broader kind", answer.margin)
        return None

    def _of_wordnet(self, form: str) -> Answer | None:
        """The nearest kind in the tree of a word that the tree lacks."""
        forms = (form, *singular_phrases(form), form.replace(" ", ""))
        known = next(filter(None, map(senses, forms)), ())
        things = [sense for sense in known if sense.nodes and _PERSON not in sense.nodes]
        people = list(known) if all(sense.nodes for sense in known) else []  # a piranha is no person but a fish
        meant = [known[0]] if any(sense.count for sense in known) else things or people
        places = [next((node for node in sense.nodes if node in self._names), None) for sense in meant]
        node = places[0] if places else None
        if node is None or any(other is None or not self._same(node, other) for other in places):
            return None  # what is meant first is no thing, has no place in the tree, or is one of several things
        return None if self._too_broad(node, form.rpartition(" ")[2]) else self._at(node, "broader kind")

    def _too_broad(self, node: str, head: str) -> bool:
        """Whether a node is so far up that it says little of a size, unless the text calls it by its own name."""
        heads = {head, *singular_phrases(head)}
        depth = len(self._names.ancestors(node)) + 1
        named = any(node in self._names.owners(one) for one in heads)
        broad = depth < LEAST_NAMED or (depth < LEAST_DEPTH and not named)
        return broad and node != _PERSON and self._names.has_kinds(node)

    def _lives(self, node: str) -> bool:
        return bool(_LIVING & {node, *self._names.ancestors(node), *self._names.hypernyms(node)})

    def _of(self, candidates: Sequence[Candidate], how: str | None, hint: str | None = None) -> Answer | None:
        if not candidates:
            return None
        if hint is not None:
            candidates = self._order_by_hint(candidates, hint)
        best = candidates[0]
        rival = next((one for one in candidates[1:] if not self._same(best.node_id, one.node_id)), None)
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

    def _same(self, one: str, other: str) -> bool:
        return one == other or self._names.kin(one, other)

    def _at(self, node: str, how: str) -> Answer | None:
        if node not in self._names:
            return None
        return Answer((Candidate(node, 0.0, how),), how, math.inf)

    def nodes_by_relevance(self, text: str, limit: int) -> Iterator[str]:
        """At most `limit` nodes for what a person types: meanings, names that begin so or hold it, like spellings."""
        yield from _unique(self._nodes_by_relevance(text), limit)

    def _nodes_by_relevance(self, text: str) -> Iterator[str]:
        answer = self.answer(text)
        if answer is not None:
            yield from (one.node_id for one in answer.candidates)
        form = plain_fold(text)
        if not form:
            return
        forms = list(self._names.forms)
        begin = sorted((one for one in forms if one.startswith(form)), key=len)
        hold = sorted((one for one in forms if f" {form}" in one), key=len)
        yield from (node for one in (*begin, *hold) for node in self._names.owners(one))
        yield from (node for one in self.nearest(text, 10) for node in self._names.owners(one))

    def nearest(self, text: str, count: int = 3) -> list[str]:
        """Known names that may help with an unknown text: of near spelling, a broader kind, the head noun; or none."""
        form = plain_fold(text)
        words = form.split()
        names = [*self._spelt_like(form, count), *self._kinds(form)]
        if len(words) > 1:
            heads = (words[-1], *singular_phrases(words[-1]))
            names += [head for head in heads if self._names.owners(head)][:1]
        return list(dict.fromkeys(name for name in names if name != form))[:count]

    def _spelt_like(self, form: str, count: int) -> list[str]:
        """Known names each of whose words is nearly spelt like that of the text: a slip of a letter or two."""
        import difflib  # only a name that is unknown needs it

        words = form.split()
        like = difflib.get_close_matches(form, list(self._names.forms), n=10 * count, cutoff=NEAR_SPELLING)
        return [one for one in like if _slip(form.replace(" ", ""), one.replace(" ", "")) or _slips(words, one.split())]

    def _kinds(self, form: str) -> list[str]:
        """The name of the nearest kind of what WordNet says of the text first, if it says something of a size."""
        meant = next(iter(senses(form)), None)
        kind = next((node for node in meant.nodes if node in self._names), None) if meant else None
        usable = kind is not None and kind != _PERSON and len(self._names.ancestors(kind)) + 1 >= LEAST_NAMED
        return [plain_fold(self._names.shown(kind))] if kind is not None and usable else []


def _slips(words: Sequence[str], others: Sequence[str]) -> bool:
    """Whether two names have the same words but for slips of spelling."""
    return len(words) == len(others) and all(map(_slip, words, others))


def _slip(word: str, other: str) -> bool:
    """Whether a word is the other but for a slip: the same beginning, at most a letter in four differs."""
    import difflib

    same = sum(block.size for block in difflib.SequenceMatcher(None, word, other).get_matching_blocks())
    longer = max(len(word), len(other))
    return word == other or (word[:1] == other[:1] and longer >= 4 and longer - same <= max(1, longer // 4))


def _unique(ids: Iterator[str], limit: int) -> Iterator[str]:
    seen: set[str] = set()
    for one in ids:
        if len(seen) == limit:
            return
        if one not in seen:
            seen.add(one)
            yield one
