"""Resolve a text to a node: the one way in which the tree, the estimator and the commands look up a name.

The forms of a text are tried in this order, and the first that is the name of a node is used: the text itself; without
numbers and articles; singular; without spaces; two alternatives that agree (`couch/sofa`); the last part of a dotted
path; the noun after a count (`pair of scissors`); the name before `with` or `riding`; a word of WordNet with a hypernym
in the tree; the name without adjectives, colours, materials and rooms; the head noun, if most known compounds with it
belong to its node; a name with one wrong letter. The note of a match states the ignored words.

The resolver also finds similar names, for search and for the message of an unknown name.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence

from metric_base.spelling import near_spellings
from taxonomy.naming.names import PERSON, Candidate, NameMatch, Names, folded_forms
from taxonomy.words import phrases
from taxonomy.words.senses import coded_node, head_trust, is_english, other_names, senses
from taxonomy.words.spelling import fold_text, one_edit, plain_fold, singular_phrases, singulars, written_forms

#: Minimum ratio of similarity (`difflib`) of names that are compared letter by letter.
MIN_SPELLING_RATIO = 0.75
#: Minimum level of a hypernym that is suggested for an unknown name; the root has level 1.
MIN_SUGGESTED_LEVEL = 3
#: Number of similar names among the results of a search.
N_SIMILAR_NAMES = 10
#: Relevance of a name that begins with the text of a search, and of one with words that begin with all of its words. It
#: is 1 less for each further letter, up to `MAX_EXTRA_LETTERS`; the search in the browser has the same values.
BEGINNING_SCORE, CONTAINED_SCORE, MAX_EXTRA_LETTERS = 80, 55, 20
#: Relevance of ten times as many items, and its maximum; relevance that each further node of a name loses.
TENFOLD_RELEVANCE, MAX_USE_RELEVANCE, NEXT_NODE_PENALTY = 3.0, 10.0, 6
#: Score added to a candidate that the words in brackets name; it exceeds all other evidence.
HINT_SCORE = 10.0
#: Minimum fraction of the known compounds of a head noun that belong to its node, 0 to 1.
MIN_HEAD_FRACTION = 0.65
#: Minimum number of known compounds of a head noun.
MIN_HEAD_COMPOUNDS = 4
#: Minimum fraction of the tagged uses of a head noun in a sense that makes compounds with it ambiguous, 0 to 1. Of the
#: uses of *wheel* 0.29 are steering wheels, of *bag* 0.16 are bases of baseball.
MIN_RIVAL_FRACTION = 0.25
#: Maximum number of words of a compound whose head noun is used.
MAX_COMPOUND_WORDS = 4
#: Minimum level of a hypernym that is used for a text: footwear is too general for the size of a stocking.
MIN_BROADER_LEVEL = 4
#: Minimum level of a hypernym whose name the text contains: an electric car is a car. A higher node (a container, a
#: vehicle) is never used.
MIN_NAMED_LEVEL = 3
#: Minimum number of letters of a word that may have one wrong letter; shorter words have too many neighbours.
MIN_FUZZY_LETTERS = 5
#: Minimum number of letters of a word that may differ in suggestions.
MIN_SLIP_LETTERS = 4
#: Nodes above all living beings.
_LIVING = {"animal.n.01", "mt:human", PERSON, "organism.n.01"}
#: Nodes above animals, plants and food.
_GROWING = {"animal.n.01", "plant.n.02", "food.n.01"}
_CODE = re.compile(r"^(?:n\d{8}|/m/[0-9a-z_]+|/g/[0-9a-z_]+)$")
_BRACKETS = re.compile(r"[\s_]*\(([^()]*)\)")
_LANGUAGES = {"de": "German", "fr": "French", "es": "Spanish", "it": "Italian"}
_COUNTING = re.compile(r"(?:an?|the|one|two|three|four|five|six|of|\d[\d.,]*|inch(?:es)?|cm|mm|m|ft)$", re.IGNORECASE)
#: Beginnings of images and copies, which do not have the size of the object. "Photo" is not one of them: labels of
#: detectors with prompts are "a photo of a chair".
_DEPICTING = re.compile(
    r"(?:an?\s+|the\s+)?(?P<noun>picture|painting|drawing|poster|statue|sculpture|sticker|figurine|toy|portrait|mural|"
    r"image|print|sketch|replica|model|miniature|photograph)s?\s+of\s",
    re.IGNORECASE,
)
#: Modifiers of copies, and those that also occur in names of breeds.
_COPIES, _BREEDS = frozenset({"miniature", "plush", "stuffed", "toy", "lego", "replica"}), frozenset({"miniature"})
_ALTERNATIVES = re.compile(r"\s*(?:/|\||\bor\b)\s*")


class Resolver:
    """Resolve texts to the nodes of one release, given by their names."""

    def __init__(self, names: Names) -> None:
        self._names = names

    def match(self, text: str) -> NameMatch | None:
        """Return the nodes of a text, with a note of the ignored words; None if the tree has no node for it."""
        match = self._match(text) or self._misspelt(text)
        if match is None or match.how in {"id", "code"}:
            return match
        if phrases.is_copy_or_part(text) and not self._keeps_size(text, match):
            return None
        if match.note:
            return match
        return match._replace(note=self._note(text, match))

    def _keeps_size(self, text: str, match: NameMatch) -> bool:
        """Return True if a text about a copy or a part is itself a name, or names a toy or a breed of animals."""
        node = match.node_id
        is_breed = self._is_living(node) and "mt:human" not in (node, *self._names.ancestors(node)) and node != PERSON
        is_toy = "plaything.n.01" in (node, *self._names.ancestors(node), *self._names.hypernyms(node))
        depicted = _DEPICTING.match(text)  # the match of `statue of a dog` is the statue
        is_name = self.is_name(text) or bool(senses(plain_fold(text)))
        return is_name or is_toy or depicted is not None or (is_breed and "miniature" in text.lower().split())

    def is_name(self, text: str) -> bool:
        """Return True if a text, with its numbers, is the name of a node."""
        return any(self._of_form(form) is not None for form in folded_forms(text))

    def names(self) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Yield every normalised name with its nodes, the most likely first; for an index outside of Python."""
        for form in self._names.forms:
            if nodes := tuple(one.node_id for one in self._names.candidates(form)):
                yield form, nodes

    def nodes_by_relevance(self, text: str, limit: int) -> Iterator[str]:
        """Yield up to `limit` nodes for a partial or misspelt text: its nodes, names that contain it, similar names."""
        seen: set[str] = set()
        for node_id in self._relevant_nodes(text):
            if len(seen) == limit:
                return
            if node_id not in seen:
                seen.add(node_id)
                yield node_id

    def nearest(self, text: str, count: int = 3) -> list[str]:
        """Return up to `count` known names for an unknown text: with similar spelling, its hypernym, its head noun."""
        form = plain_fold(text)
        words = form.split()
        similar = near_spellings(form, self._names.forms, n=10 * count, cutoff=MIN_SPELLING_RATIO)
        names = []
        for name in similar:
            others = name.split()
            same_words = len(words) == len(others) and all(map(is_slip, words, others))
            if is_slip(form.replace(" ", ""), name.replace(" ", "")) or same_words:
                names.append(name)
        meant = next(iter(senses(form)), None)
        kind = next((node for node in meant.chain if node in self._names), None) if meant else None
        if kind is not None and kind != PERSON and self._level(kind) >= MIN_SUGGESTED_LEVEL:
            names.append(plain_fold(self._names.display_name(kind)))
        if len(words) > 1:
            names += [head for head in (words[-1], *singular_phrases(words[-1])) if self._names.nodes_named(head)][:1]
        return list(dict.fromkeys(name for name in names if name != form))[:count]

    def _relevant_nodes(self, text: str) -> Iterator[str]:
        form = plain_fold(text)
        match = self.match(text)
        if match is not None and match.form != form:  # "ofice chair" is rather an office chair than any chair
            match = self._misspelt(text) or match
        if match is not None:
            yield from (one.node_id for one in match.candidates)
        if not form:
            return
        words = form.split()
        scored: list[tuple[float, str]] = []
        for name in self._names.forms:
            if not all(word in name for word in words):
                continue
            own = name.split()
            if name.startswith(form):
                score = BEGINNING_SCORE - min(len(name) - len(form), MAX_EXTRA_LETTERS)
            elif all(any(one.startswith(word) for one in own) for word in words):
                score = CONTAINED_SCORE - min(len(name) - len(form), MAX_EXTRA_LETTERS)
            else:
                continue
            for place, node in enumerate(self._names.nodes_named(name)):
                used = min(TENFOLD_RELEVANCE * math.log10(1 + self._names.items(node)), MAX_USE_RELEVANCE)
                scored.append((score + used - NEXT_NODE_PENALTY * place, node))
        yield from (node for _, node in sorted(scored, key=lambda one: (-one[0], one[1])))
        yield from (node for one in self.nearest(text, N_SIMILAR_NAMES) for node in self._names.nodes_named(one))

    def _note(self, text: str, match: NameMatch) -> str | None:
        """Return a note of the ignored words, of a hypernym that was used, or of another meaning in a language."""
        name = self._names.display_name(match.node_id)
        if not match.form:
            return f"taken as {name}, the nearest kind in the tree"
        if match.form == plain_fold(text):
            languages = other_names(match.form)
            other = next((node for node in languages if node in self._names), None)
            if other is None or self._is_same(other, match.node_id) or languages[other] not in _LANGUAGES:
                return None
            return f"in {_LANGUAGES[languages[other]]} also {self._names.display_name(other)}"
        if _ALTERNATIVES.search(text) or phrases.container_and_content(text):
            return None
        ignored = _ignored_words(phrases.after_counts(text) or text, match.form)
        verb = "is" if len(ignored) == 1 else "are"
        return f"taken as {name}: {', '.join(map(repr, ignored))} {verb} not in the tree" if ignored else None

    def _match(self, text: str) -> NameMatch | None:
        """Return the match of a text as an id, a code, a name, or a phrase."""
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
        if len(parts) <= 1:
            return self._compound(text) or self._phrase(text)
        matches = [match for part in parts if (match := self.match(part)) is not None]
        agree = len(matches) == len(parts) and all(self._is_same(matches[0].node_id, one.node_id) for one in matches)
        return matches[0] if agree and matches else None

    def _written(self, text: str) -> NameMatch | None:
        """Return the match of a text that is a name, with brackets, counts, plurals or missing spaces."""
        hint = _BRACKETS.search(text)
        bare = _BRACKETS.sub("", text) if hint else text
        for form in folded_forms(text):
            if match := self._best(self._names.candidates(form), None):
                return match._replace(form=form)
        for plain in dict.fromkeys((bare, phrases.without_numbers(bare))):
            for form in folded_forms(plain):
                if match := self._of_form(form, hint[1] if hint else None):
                    return match
        return None

    def _other_name(self, text: str) -> NameMatch | None:
        """Return the match of a name of a standard, or of a foreign, not English name."""
        form = plain_fold(text)
        named = next(filter(None, map(other_names, (form, *singular_phrases(form)))), {})
        known = {node: language for node, language in named.items() if node in self._names}
        if not known or (senses(form) and "norm" not in known.values()):
            return None
        nodes = sorted(known, key=lambda node: -self._names.items(node))
        rival = next((node for node in nodes[1:] if not self._is_same(nodes[0], node)), None)
        language = _LANGUAGES.get(known[nodes[0]])
        name = self._names.display_name(nodes[0])
        note = f"taken as {name}: {language} {text.strip()!r}" if language else None
        candidates = tuple(Candidate(node, 0.0, "other name") for node in nodes)
        return NameMatch(candidates, "other name", 0.0 if rival else math.inf, form, note)

    def _misspelt(self, text: str) -> NameMatch | None:
        """Return the match of a text with one wrong letter in one word, if all such names have the same node."""
        form = plain_fold(text)
        if not form.replace(" ", "").isalpha() or senses(form):
            return None
        near = [name for name in self._names.forms if one_edit(form, name) and self._is_misspelling(form, name)]
        matches = [match for name in near if (match := self._best(self._names.candidates(name), "misspelt"))]
        first = matches[0] if matches else None
        if first is None or first.ambiguous or not all(self._is_same(first.node_id, one.node_id) for one in matches):
            return None
        name = self._names.display_name(first.node_id)
        return first._replace(form=near[0], note=f"taken as {name}: {text.strip()!r} is not in the tree")

    def _is_misspelling(self, form: str, name: str) -> bool:
        """Return True if a text differs from a name in one long word, which is neither English nor in any name."""
        words, name_words = form.split(), name.split()
        unlike = [pair for pair in zip(words, name_words, strict=False) if pair[0] != pair[1]]
        if len(words) != len(name_words) or len(unlike) != 1 or min(map(len, unlike[0])) < MIN_FUZZY_LETTERS - 1:
            return False
        word = unlike[0][0]
        return len(word) >= MIN_FUZZY_LETTERS and not (word in self._names.words or is_english(word))

    def _of_form(self, form: str, hint: str | None = None) -> NameMatch | None:
        """Return the match of a normalised form: the form itself, its singulars, or without its spaces."""
        for written in written_forms(form, lambda: self._names.letters) if form else ():
            if candidates := self._names.candidates(written):
                match = self._best(candidates, None if written == form else "folded", hint)
                return match and match._replace(form=written if " " in form or written != form else form)
        return None

    def _best(self, candidates: Sequence[Candidate], how: str | None, hint: str | None = None) -> NameMatch | None:
        """Return candidates as a match, or None if there are none.

        Candidates with an ancestor or a hypernym that the words in brackets (`hint`) name come first: `bow (weapon)`.
        """
        if not candidates:
            return None
        if hint is not None:
            words = set(plain_fold(hint).split())

            def is_hinted(one: Candidate) -> bool:
                kinds = (one.node_id, *self._names.ancestors(one.node_id), *self._names.hypernyms(one.node_id))
                names = (plain_fold(node.partition(".")[0].removeprefix("mt:")) for node in kinds)
                return any(words & set(name.split()) for name in names)

            hinted = [one._replace(score=one.score + HINT_SCORE) for one in candidates if is_hinted(one)]
            candidates = hinted + [one for one in candidates if not is_hinted(one)]
        best = candidates[0]
        rival = next((one for one in candidates[1:] if not self._is_same(best.node_id, one.node_id)), None)
        return NameMatch(tuple(candidates), how or best.how, best.score - rival.score if rival else math.inf)

    def _is_same(self, one: str, other: str) -> bool:
        """Return True if two nodes are equal or one is above the other."""
        return one == other or self._names.are_related(one, other)

    def _compound(self, text: str) -> NameMatch | None:
        """Return the match of a dotted path or of an inverted name (`table, dining`)."""
        if "." in text.strip(".") and " " not in text.strip():
            *_, before, last = ["", *filter(None, text.split("."))]
            return self._written(last) or (self._written(before) if before and plain_fold(last) else None)
        parts = [part.strip() for part in text.split(",") if part.strip()]
        if len(parts) > 1:
            inverted = " ".join((*parts[1:], parts[0])) if len(parts) == 2 else ""
            matches = (self.match(part) for part in (inverted, *parts) if part)
            return next((match for match in matches if match is not None), None)
        return None

    def _phrase(self, text: str) -> NameMatch | None:
        """Return the match of a phrase: the noun after a count, the name before `with`, a hypernym, the bare name."""
        plain = text.replace("_", " ").replace("-", " ") if " " not in text.strip() else text
        if holding := phrases.container_and_content(plain):
            container, content = holding
            return self._of_form(plain_fold(f"{content} {container}")) or self._of_form(container)
        counted = phrases.after_counts(plain)
        if counted and (match := self.match(counted)):
            return match
        form = plain_fold(phrases.without_numbers(plain))
        words = form.split()
        has_adjective = len(words) > 1 and phrases.is_plain_adjective(words[0])
        match = self._without_modifiers(words) if has_adjective else self._hypernym(form)
        if match and has_adjective:
            # A blue tit is a bird: ignore the match if exactly one of complete name and remainder is a living being.
            kinds = [sense.concept for sense in senses(form) if sense.chain and sense.concept in self._names]
            if kinds and all(self._is_living(kind) != self._is_living(match.node_id) for kind in kinds):
                return self._hypernym(form)
        if match:
            return match
        leading = phrases.leading_phrase(plain)
        if leading and (match := self.match(leading)):
            return match
        return self._without_modifiers(words) if not leading else None

    def _without_modifiers(self, words: Sequence[str]) -> NameMatch | None:
        """Return the match of a name after removing its modifiers one by one from the left."""
        of_living, copy = False, _COPIES & set(words[:-1])
        while len(words) > 1 and (leading := phrases.modifiers(words)):
            of_living = of_living or words[0] in phrases.word_list("of_the_living")
            words = words[leading:]
            form = " ".join(words)
            match = self._of_form(form) or self._hypernym(form)
            if match:
                is_copy = copy and not (copy <= _BREEDS and self._is_living(match.node_id))
                is_thing = of_living and not self._is_living(match.node_id)
                if is_copy or is_thing or self._is_too_broad(match.node_id, words[-1]):
                    return None
                return match._replace(how="modifier stripped")
            if senses(form):
                return None
        return None if copy else self._head(words)

    def _head(self, words: Sequence[str]) -> NameMatch | None:
        """Return the match of the head noun, if the known compounds with it belong to its node."""
        if not 1 < len(words) <= MAX_COMPOUND_WORDS or phrases.word_list("alienating") & set(words[:-1]):
            return None
        head = next((one for one in (words[-1], *singular_phrases(words[-1])) if self._names.candidates(one)), None)
        match = self._best(self._names.candidates(head), "broader kind") if head else None
        if head is None or match is None or match.ambiguous or senses(" ".join(words)):
            return None  # WordNet lists this compound as another object; otherwise an earlier form would have matched
        # A modifier that is an animal, a plant or food changes the object: a garlic bulb is not a light bulb.
        modifier = self._names.candidates(words[-2])
        if modifier and self._is_growing(modifier[0].node_id) and not self._is_growing(match.node_id):
            return None
        kinds, compounds = head_trust(head).get(match.node_id, (0, 0))
        is_trusted = compounds >= MIN_HEAD_COMPOUNDS and kinds / compounds >= MIN_HEAD_FRACTION
        if not is_trusted and head not in phrases.word_list("containers"):
            return None
        # The commonest sense of the head noun is not the sense in the compound: a pen pot is not a cooking pot.
        uses = [(sense.concept, sense.count) for sense in senses(head) if sense.chain and sense.count]
        common = [node for node, count in uses if count >= MIN_RIVAL_FRACTION * sum(count for _, count in uses)]
        known = {one.node_id for one in match.candidates}
        added = [node for node in common if node in self._names and node not in known and not self._is_living(node)]
        candidates = (*match.candidates, *(Candidate(node, 0.0, "broader kind") for node in added))
        is_ambiguous = any(not self._is_same(match.node_id, one.node_id) for one in candidates)
        return NameMatch(candidates, "broader kind", 0.0 if is_ambiguous else math.inf, head)

    def _hypernym(self, form: str) -> NameMatch | None:
        """Return the closest hypernym in the tree of a word that the tree does not contain."""
        known = next(filter(None, map(senses, (form, *singular_phrases(form), form.replace(" ", "")))), ())
        objects = [sense for sense in known if sense.chain and not sense.is_a((PERSON,))]
        # a piranha is more likely a fish than a person
        people = list(known) if all(sense.chain for sense in known) else []
        meant = [known[0]] if any(sense.count for sense in known) else objects or people
        nodes = [next((node for node in sense.chain if node in self._names), None) for sense in meant]
        node = nodes[0] if nodes else None
        if node is None or any(other is None or not self._is_same(node, other) for other in nodes):
            return None  # the first sense has no size or no node, or the senses are different objects
        return None if self._is_too_broad(node, form.rpartition(" ")[2]) else _certain(node, "broader kind")

    def _is_too_broad(self, node: str, head: str) -> bool:
        """Return True if a node is too general for a size; one level higher is accepted if the text has its name."""
        has_name = any(node in self._names.nodes_named(one) for one in {head, *singular_phrases(head)})
        level = self._level(node)
        is_broad = level < MIN_NAMED_LEVEL or (level < MIN_BROADER_LEVEL and not has_name)
        return is_broad and node != PERSON and node in self._names.inner_nodes

    def _level(self, node: str) -> int:
        return len(self._names.ancestors(node)) + 1

    def _is_living(self, node: str) -> bool:
        """Return True if a node is a living being, in the tree or in WordNet."""
        return bool(_LIVING & {node, *self._names.ancestors(node), *self._names.hypernyms(node)})

    def _is_growing(self, node: str) -> bool:
        """Return True if a node is an animal, a plant or food in the tree."""
        return bool(_GROWING & {node, *self._names.ancestors(node)})


def is_slip(word: str, other: str) -> bool:
    """Return True if two words have the same first letter and differ in one letter, or a quarter of their letters."""
    import difflib  # only for suggestions

    same = sum(block.size for block in difflib.SequenceMatcher(None, word, other).get_matching_blocks())
    longer = max(len(word), len(other))
    is_similar = longer >= MIN_SLIP_LETTERS and longer - same <= max(1, longer // 4)
    return word == other or (word[:1] == other[:1] and is_similar)


def _ignored_words(text: str, form: str) -> list[str]:
    """Return the words of a text that are not in a name; a count before the name is left out."""
    name_words = set(form.split())
    letters = form.replace(" ", "")
    ignored: list[str] = []
    for word in re.split(r"[\s_,/()]+", text.strip()):
        parts = {
            one for part in (*plain_fold(word).split(), *fold_text(word).split()) for one in (part, *singulars(part))
        }
        irregular = {one for part in tuple(parts) for one in singular_phrases(part)}
        if parts | irregular and not (parts | irregular) & name_words and plain_fold(word) not in letters:
            ignored.append(word)
    while ignored and text.strip().startswith(ignored[0]) and _COUNTING.match(ignored[0]):
        text = text.strip()[len(ignored[0]) :]
        ignored = ignored[1:]
    return ignored


def _certain(node: str, how: str) -> NameMatch:
    """Return the match of one node."""
    return NameMatch((Candidate(node, math.inf if how == "id" else 0.0, how),), how, math.inf)
