"""Names and nodes near a text: for people who search, and for the message about a name that is unknown."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from metric_base.spelling import near_spellings
from taxonomy.naming.names import PERSON, NameAnswer, Names
from taxonomy.words.senses import senses
from taxonomy.words.spelling import plain_fold, singular_phrases

__all__ = ["Nearest"]

#: Likeness of spelling (`difflib`'s ratio) from which a name is worth comparing letter by letter.
NEAR_SPELLING = 0.75

#: Levels from the root from which a broader kind is offered.
LEAST_OFFERED = 3


class Nearest:
    """What lies near a text among one release's names.

    Parameters
    ----------
    names : the nodes by their names; answer : what a text means.
    """

    def __init__(self, names: Names, answer: Callable[[str], NameAnswer | None]) -> None:
        self._names = names
        self._answer = answer

    def nodes(self, text: str, limit: int) -> Iterator[str]:
        """At most `limit` nodes for what a person types: meanings, names that begin so or hold it, like spellings."""
        yield from _unique(self._nodes(text), limit)

    def _nodes(self, text: str) -> Iterator[str]:
        answer = self._answer(text)
        if answer is not None:
            yield from (one.node_id for one in answer.candidates)
        form = plain_fold(text)
        if not form:
            return
        forms = list(self._names.forms)
        begin = sorted((one for one in forms if one.startswith(form)), key=len)
        hold = sorted((one for one in forms if f" {form}" in one), key=len)
        yield from (node for one in (*begin, *hold) for node in self._names.owners(one))
        yield from (node for one in self.names(text, 10) for node in self._names.owners(one))

    def names(self, text: str, count: int = 3) -> list[str]:
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
        words = form.split()
        like = near_spellings(form, self._names.forms, n=10 * count, cutoff=NEAR_SPELLING)
        return [one for one in like if _slip(form.replace(" ", ""), one.replace(" ", "")) or _slips(words, one.split())]

    def _kinds(self, form: str) -> list[str]:
        """The name of the nearest kind of what WordNet states about the text first, if it states a size."""
        meant = next(iter(senses(form)), None)
        kind = next((node for node in meant.chain if node in self._names), None) if meant else None
        usable = kind is not None and kind != PERSON and len(self._names.ancestors(kind)) + 1 >= LEAST_OFFERED
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
