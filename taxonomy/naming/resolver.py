"""From a text to a node: the one way in which the tree, the estimator and the commands read a name.

The forms of a text are tried from the plainest to the boldest, and the first that names a node answers: as it is
written, without numbers and articles, singular, without spaces; two alternatives that agree (`couch/sofa`), the last
part of a dotted path; what a count names (`pair of scissors`), the name before `with` or `riding`; a word of WordNet
whose kind is in the tree; the name without adjectives, colours, materials and rooms; the head noun, if compounds that
end in it are known to be such items; a name that is one letter off. An answer says what was dropped on the way.

Names and nodes near a text: for people who search, and for the message about a name that is unknown.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence

from metric_base.spelling import near_spellings
from taxonomy.naming.names import PERSON, Candidate, NameAnswer, Names, folded_forms
from taxonomy.words.phrases import (
    after_counts,
    container_and_content,
    is_plain_adjective,
    leading_phrase,
    modifiers,
    without_numbers,
    word_list,
)
from taxonomy.words.senses import coded_node, head_trust, is_english, other_names, senses
from taxonomy.words.spelling import fold_text, one_edit, plain_fold, singular_phrases, singulars, written_forms

#: Likeness of spelling (`difflib`'s ratio) from which a name is worth comparing letter by letter.
NEAR_SPELLING = 0.75
#: Levels from the root from which a broader kind is offered.
LEAST_OFFERED = 3
#: What words in brackets add to a candidate that they name: more than anything else does.
HINT_RATIO = 10.0
#: Share of the known compounds of a head noun that are such items, from which the head alone is taken.
HEAD_TRUST = 0.65
#: Compounds that must be known before a head noun is taken.
HEAD_COMPOUNDS = 4
#: Words of the longest compound whose head noun is taken.
MAX_COMPOUND_WORDS = 4
#: Levels of the tree (the root is 1) from which a broader kind is taken: a stocking is not footwear of 30 by 10 cm. One
#: level further up only by its own name (an electric car is a car), and never further (not a container or a vehicle).
MIN_BROADER_LEVEL = 4
MIN_NAMED_LEVEL = 3
#: Above everything that lives.
_LIVING = {"animal.n.01", "mt:human", PERSON, "organism.n.01"}
#: Above what grows and what is eaten, people left out.
_GROWING = {"animal.n.01", "plant.n.02", "food.n.01"}
_CODE = re.compile(r"^(?:n\d{8}|/m/[0-9a-z_]+|/g/[0-9a-z_]+)$")
_BRACKETS = re.compile(r"[\s_]*\(([^()]*)\)")
#: Letters from which a name may be one letter off: short words are too near each other.
MIN_FUZZY_LETTERS = 5
_LANGUAGES = {"de": "German", "fr": "French", "es": "Spanish", "it": "Italian"}
_COUNTING = re.compile(r"(?:an?|the|one|two|three|four|five|six|of|\d[\d.,]*|inch(?:es)?|cm|mm|m|ft)$", re.IGNORECASE)
#: An image of a chair has no size of a chair, and neither has what is made after one. A photo does not begin so:
#: labels of detectors that read prompts are "a photo of a chair".
_DEPICTING = re.compile(
    r"(?:an?\s+|the\s+)?(?P<noun>picture|painting|drawing|poster|statue|sculpture|sticker|figurine|toy|portrait|mural|"
    r"image|print|sketch|replica|model|miniature|photograph)s?\s+of\s",
    re.IGNORECASE,
)
_COPIES, _BREEDS = frozenset({"miniature", "plush", "stuffed", "toy", "lego", "replica"}), frozenset({"miniature"})
_ALTERNATIVES = re.compile(r"\s*(?:/|\||\bor\b)\s*")


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
    """Return True if two names have the same words but for slips of spelling."""
    return len(words) == len(others) and all(map(_slip, words, others))


def _slip(word: str, other: str) -> bool:
    """Return True if a word is the other but for a slip: the same beginning, at most a letter in four differs."""
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


class Resolver:
    """Reads names for the nodes of one release.

    Parameters
    ----------
    names : the nodes by their names.
    """

    def __init__(self, names: Names) -> None:
        self._names = names
        self._nearest = Nearest(names, self.answer)

    def answer(self, text: str) -> NameAnswer | None:
        """What a text means, with a note of what is left out of it; None if nothing of the tree is meant."""
        answer = self._answer(text) or self._misspelt(text)
        if answer is None or answer.note or answer.how in {"id", "code"}:
            return answer
        return answer._replace(note=self._note(text, answer))

    def _note(self, text: str, answer: NameAnswer) -> str | None:
        """What an answer leaves out of a text, or that it stands for a kind that the tree lacks."""
        name = self._names.shown(answer.node_id)
        if not answer.form:
            return f"taken as {name}, the nearest kind in the tree"
        if answer.form == plain_fold(text):
            return self._in_another_language(answer)
        if _ALTERNATIVES.search(text) or container_and_content(text):
            return None
        left = _left_out(after_counts(text) or text, answer.form)
        verb = "is" if len(left) == 1 else "are"
        return f"taken as {name}: {', '.join(map(repr, left))} {verb} not in the tree" if left else None

    def _in_another_language(self, answer: NameAnswer) -> str | None:
        """What the name means in another language, where that is another item."""
        named = other_names(answer.form)
        elsewhere = next((node for node in named if node in self._names), None)
        if elsewhere is None or self._same(elsewhere, answer.node_id) or named[elsewhere] not in _LANGUAGES:
            return None
        return f"in {_LANGUAGES[named[elsewhere]]} also {self._names.shown(elsewhere)}"

    def _answer(self, text: str) -> NameAnswer | None:
        if text in self._names:
            return _certain(text, "id")
        if _CODE.match(text):
            node = coded_node(text)
            return _certain(node, "code") if node and node in self._names else None
        depicting = _DEPICTING.match(text)
        written = self._written(text) if depicting is None else self._of_form(depicting["noun"])
        if written or depicting:
            return written
        if other := self._other_name(text):
            return other
        parts = [part for part in _ALTERNATIVES.split(text) if part]
        if len(parts) > 1:
            return self._common_answer(parts)
        return self._compound_answer(text) or self._phrase(text)

    def names(self) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Every folded name with the nodes it may mean, the likeliest first: for an index outside of Python."""
        for form in self._names.forms:
            if owners := tuple(one.node_id for one in self._names.candidates(form)):
                yield form, owners

    def nodes_by_relevance(self, text: str, limit: int) -> Iterator[str]:
        """At most `limit` nodes for what a person types: meanings, names that begin so or hold it, like spellings."""
        return self._nearest.nodes(text, limit)

    def nearest(self, text: str, count: int = 3) -> list[str]:
        """Known names that may help with an unknown text: of near spelling, a broader kind, the head noun; or none."""
        return self._nearest.names(text, count)

    def _written(self, text: str) -> NameAnswer | None:
        """The answer for a text that is a name as it is, in brackets, counted, plural, or without its spaces."""
        hint = _BRACKETS.search(text)
        bare = _BRACKETS.sub("", text) if hint else text
        for form in folded_forms(text):
            if answer := self._best(self._names.candidates(form), None):
                return answer._replace(form=form)
        for plain in dict.fromkeys((bare, without_numbers(bare))):
            for form in folded_forms(plain):
                if answer := self._of_form(form, hint[1] if hint else None):
                    return answer
        return None

    def _other_name(self, text: str) -> NameAnswer | None:
        """The answer for the name of a norm, or for a name in another language that English does not have."""
        form = plain_fold(text)
        named = next(filter(None, map(other_names, (form, *singular_phrases(form)))), {})
        known = {node: language for node, language in named.items() if node in self._names}
        if not known or (senses(form) and "norm" not in known.values()):
            return None
        most = sorted(known, key=lambda node: -self._names.items(node))
        rival = next((node for node in most[1:] if not self._same(most[0], node)), None)
        language = _LANGUAGES.get(known[most[0]])
        note = f"taken as {self._names.shown(most[0])}: {language} {text.strip()!r}" if language else None
        candidates = tuple(Candidate(node, 0.0, "other name") for node in most)
        return NameAnswer(candidates, "other name", 0.0 if rival else math.inf, form, note)

    def _misspelt(self, text: str) -> NameAnswer | None:
        """The answer for a text whose one word is a letter off that of a name, if all such names mean one node."""
        form = plain_fold(text)
        if not form.replace(" ", "").isalpha() or senses(form):
            return None
        near = [name for name in self._names.forms if one_edit(form, name) and self._is_slip(form, name)]
        answers = [answer for name in near if (answer := self._best(self._names.candidates(name), "misspelt"))]
        first = answers[0] if answers else None
        if first is None or first.ambiguous or not all(self._same(first.node_id, one.node_id) for one in answers):
            return None
        name = self._names.shown(first.node_id)
        return first._replace(form=near[0], note=f"taken as {name}: {text.strip()!r} is not in the tree")

    def _is_slip(self, form: str, name: str) -> bool:
        """Return True if two names differ in one word, which is long and neither English nor of a name in the first."""
        words, of_name = form.split(), name.split()
        unlike = [pair for pair in zip(words, of_name, strict=False) if pair[0] != pair[1]]
        if len(words) != len(of_name) or len(unlike) != 1 or min(map(len, unlike[0])) < MIN_FUZZY_LETTERS - 1:
            return False
        return len(unlike[0][0]) >= MIN_FUZZY_LETTERS and not (
            unlike[0][0] in self._names.words or is_english(unlike[0][0])
        )

    def _of_form(self, form: str, hint: str | None = None) -> NameAnswer | None:
        """The answer for a folded form: as it is, singular, without its spaces."""
        for written in written_forms(form, lambda: self._names.letters) if form else ():
            if candidates := self._names.candidates(written):
                answer = self._best(candidates, None if written == form else "folded", hint)
                return answer and answer._replace(form=written if " " in form or written != form else form)
        return None

    def _best(self, candidates: Sequence[Candidate], how: str | None, hint: str | None = None) -> NameAnswer | None:
        """The likeliest of several candidates, as an answer; None of none."""
        if not candidates:
            return None
        if hint is not None:
            candidates = self._order_by_hint(candidates, hint)
        best = candidates[0]
        rival = next((one for one in candidates[1:] if not self._same(best.node_id, one.node_id)), None)
        margin = best.score - rival.score if rival else math.inf
        return NameAnswer(tuple(candidates), how or best.how, margin)

    def _order_by_hint(self, candidates: Sequence[Candidate], hint: str) -> list[Candidate]:
        """Candidates whose kinds the words in brackets name come first (`bow (weapon)`)."""
        words = set(plain_fold(hint).split())

        def names(one: Candidate) -> bool:
            above = (one.node_id, *self._names.ancestors(one.node_id), *self._names.hypernyms(one.node_id))
            shown = (plain_fold(node.partition(".")[0].removeprefix("mt:")) for node in above)
            return any(words & set(name.split()) for name in shown)

        hinted = [one._replace(score=one.score + HINT_RATIO) for one in candidates if names(one)]
        return hinted + [one for one in candidates if not names(one)]

    def _same(self, one: str, other: str) -> bool:
        return one == other or self._names.kin(one, other)

    def _compound_answer(self, text: str) -> NameAnswer | None:
        """The answer for dotted paths and inverted names (`table, dining`)."""
        if "." in text.strip(".") and " " not in text.strip():
            *_, before, last = ["", *filter(None, text.split("."))]
            return self._written(last) or (self._written(before) if before and plain_fold(last) else None)
        parts = [part.strip() for part in text.split(",") if part.strip()]
        if len(parts) > 1:
            inverted = " ".join((*parts[1:], parts[0])) if len(parts) == 2 else ""
            tried = (self.answer(part) for part in (inverted, *parts) if part)
            return next((answer for answer in tried if answer is not None), None)
        return None

    def _common_answer(self, parts: Sequence[str]) -> NameAnswer | None:
        """The one answer of several alternatives, or None where they disagree."""
        answers = [answer for part in parts if (answer := self.answer(part)) is not None]
        first = answers[0] if len(answers) == len(parts) else None
        same = first is not None and all(self._same(first.node_id, one.node_id) for one in answers)
        return first if same else None

    def _phrase(self, text: str) -> NameAnswer | None:
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
        if answer and adjective and self._misleads(form, answer):
            return self._of_wordnet(form)
        if answer:
            return answer
        led = leading_phrase(plain)
        if led and (answer := self.answer(led)):
            return answer
        return self._bare(words) if not led else None

    def _bare(self, words: Sequence[str]) -> NameAnswer | None:
        """The answer for a name after its modifiers are taken away, one by one from the left."""
        living, copy = False, _COPIES & set(words[:-1])
        while len(words) > 1 and (leading := modifiers(words)):
            living = living or words[0] in word_list("of_the_living")
            words = words[leading:]
            form = " ".join(words)
            answer = self._of_form(form) or self._of_wordnet(form)
            if answer and copy and not (copy <= _BREEDS and self._lives(answer.node_id)):
                return None
            if answer and (self._too_broad(answer.node_id, words[-1]) or (living and not self._lives(answer.node_id))):
                return None
            if answer:
                return answer._replace(how="modifier stripped")
            if senses(form):
                return None
        return None if copy else self._head(words)

    def _head(self, words: Sequence[str]) -> NameAnswer | None:
        """The answer for the head noun, if the compounds that end in it are such items."""
        if not 1 < len(words) <= MAX_COMPOUND_WORDS or word_list("alienating") & set(words[:-1]):
            return None
        head = next((one for one in (words[-1], *singular_phrases(words[-1])) if self._names.candidates(one)), None)
        answer = self._best(self._names.candidates(head), "broader kind") if head else None
        if head is None or answer is None or answer.ambiguous or senses(" ".join(words)):
            return None  # what WordNet knows as a whole is not such an item, or would have been found
        if self._is_of_another_kind(words[-2], answer.node_id):
            return None
        kinds, compounds = head_trust(head).get(answer.node_id, (0, 0))
        trusted = compounds >= HEAD_COMPOUNDS and kinds / compounds >= HEAD_TRUST
        return answer._replace(form=head) if trusted or head in word_list("containers") else None

    def _of_wordnet(self, form: str) -> NameAnswer | None:
        """The nearest kind in the tree of a word that the tree lacks."""
        forms = (form, *singular_phrases(form), form.replace(" ", ""))
        known = next(filter(None, map(senses, forms)), ())
        objects = [sense for sense in known if sense.chain and not sense.is_a((PERSON,))]
        people = list(known) if all(sense.chain for sense in known) else []  # a piranha is not a person but a fish
        meant = [known[0]] if any(sense.count for sense in known) else objects or people
        places = [next((node for node in sense.chain if node in self._names), None) for sense in meant]
        node = places[0] if places else None
        if node is None or any(other is None or not self._same(node, other) for other in places):
            return None  # what is meant first has no size, has no place in the tree, or is one of several items
        return None if self._too_broad(node, form.rpartition(" ")[2]) else _certain(node, "broader kind")

    def _too_broad(self, node: str, head: str) -> bool:
        """Return True if a node is too general for a size, unless the text has its name."""
        heads = {head, *singular_phrases(head)}
        depth = len(self._names.ancestors(node)) + 1
        named = any(node in self._names.owners(one) for one in heads)
        broad = depth < MIN_NAMED_LEVEL or (depth < MIN_BROADER_LEVEL and not named)
        return broad and node != PERSON and self._names.has_kinds(node)

    def _misleads(self, form: str, answer: NameAnswer) -> bool:
        """Return True if, in WordNet, either the whole name or its rest is a living being, but not both.

        A blue tit is a bird and not a blue tit.
        """
        kinds = [sense.concept for sense in senses(form) if sense.chain and sense.concept in self._names]
        return bool(kinds) and all(self._lives(kind) != self._lives(answer.node_id) for kind in kinds)

    def _is_of_another_kind(self, modifier: str, head: str) -> bool:
        """Return True if a compound's first noun is something that lives or is eaten, and its head is neither.

        The bulb of garlic is not a light bulb, and a dog's bed is not for people.
        """
        candidates = self._names.candidates(modifier)
        return bool(candidates) and self._grows(candidates[0].node_id) and not self._grows(head)

    def _grows(self, node: str) -> bool:
        return bool(_GROWING & {node, *self._names.ancestors(node)})

    def _lives(self, node: str) -> bool:
        return bool(_LIVING & {node, *self._names.ancestors(node), *self._names.hypernyms(node)})


def _left_out(text: str, form: str) -> list[str]:
    """The words of a text that a name does not have; a count before the name is not one of them."""
    kept = set(form.split())
    letters = form.replace(" ", "")
    left: list[str] = []
    for word in re.split(r"[\s_,/()]+", text.strip()):
        parts = {
            one for part in (*plain_fold(word).split(), *fold_text(word).split()) for one in (part, *singulars(part))
        }
        irregular = {one for part in tuple(parts) for one in singular_phrases(part)}
        if parts | irregular and not (parts | irregular) & kept and plain_fold(word) not in letters:
            left.append(word)
    while left and text.strip().startswith(left[0]) and _COUNTING.match(left[0]):
        text = text.strip()[len(left[0]) :]
        left = left[1:]
    return left


def _certain(node: str, how: str) -> NameAnswer:
    """The answer that is one node."""
    return NameAnswer((Candidate(node, math.inf if how == "id" else 0.0, how),), how, math.inf)
