"""Every name that can be matched: WordNet's nouns and the reviewed insertions, by their folded spelling."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from functools import cache, cached_property

from metric_base.folders import taxonomy_directory
from taxonomy.insertions import PREFIX, Insertion, insertions
from taxonomy.levels import table_rows
from taxonomy.naming.spelling import fold_text, singulars
from taxonomy.wordnet import WordNet, default_wordnet

__all__ = ["Lexicon", "default_lexicon"]

#: Shortest word that is looked up without its spaces (barstool, tvstand): shorter ones meet by accident.
_SHORTEST_COMPOUND = 6


class Lexicon:
    """Concepts (a WordNet synset or an `mt:` id) by name, and what is above each.

    Parameters
    ----------
    wordnet : WordNet
    inserted : insertions by id, parents before children.
    placed : leaves that a reviewer gave the tree for label lists; a name of theirs that WordNet or an insertion has too
        means that one.
    """

    def __init__(
        self, wordnet: WordNet, inserted: Mapping[str, Insertion], placed: Mapping[str, Insertion] | None = None
    ) -> None:
        self.wordnet = wordnet
        self.inserted = {**(placed or {}), **inserted}
        self._placed = frozenset(placed or ()) - frozenset(inserted)
        self._above: dict[str, tuple[str, ...]] = {}
        self._memory: dict[str, tuple[tuple[str, ...], ...]] = {}

    def concepts(self, phrase: str) -> tuple[tuple[str, ...], ...]:
        """What a folded phrase may name, by the form it is taken for: insertions first, then senses by frequency.

        A plural is taken as such first (scissors), then for its singular, then for a name without spaces; empty if
        the phrase is unknown in every form.
        """
        concepts = self._memory.get(phrase)
        if concepts is None:
            forms = (self._of_form(form) for form in dict.fromkeys(self.forms(phrase)))
            concepts = self._memory[phrase] = tuple(senses for senses in forms if senses)
        return concepts

    def knows(self, concept: str) -> bool:
        """Whether the id is an insertion or a noun synset."""
        return concept in self.inserted or (not concept.startswith(PREFIX) and self.wordnet.knows(concept))

    def canonical(self, concept: str) -> str:
        """The one name of a concept: `couch.n.01` is `sofa.n.01`, as WordNet names the synset."""
        return concept if concept in self.inserted else self.wordnet.canonical(concept)

    def hypernyms(self, concept: str) -> tuple[str, ...]:
        """All concepts above, nearest first."""
        above = self._above.get(concept)
        if above is None:
            above = self._above[concept] = self._hypernyms(concept)
        return above

    def is_a(self, concept: str, kinds: Iterable[str]) -> bool:
        """Whether the concept is one of the kinds or below one."""
        above = self.hypernyms(concept)
        return any(kind == concept or kind in above for kind in kinds)

    def name(self, concept: str) -> str:
        """The plain name that people use."""
        if concept in self.inserted:
            return self.inserted[concept].name
        return self.wordnet.lemmas(concept)[0]

    def _hypernyms(self, concept: str) -> tuple[str, ...]:
        if concept in self.inserted:
            parent = self.inserted[concept].parent
            return (parent, *self.hypernyms(parent))
        return self.wordnet.hypernyms(concept)

    def _of_form(self, form: str) -> tuple[str, ...]:
        senses = (sense for lemma in self._lemmas.get(form, ()) for sense in self.wordnet.senses(lemma))
        return tuple(dict.fromkeys((*self._insertions_by_name.get(form, ()), *senses)))

    def forms(self, phrase: str) -> Iterator[str]:
        """What a folded phrase may be a spelling or a plural of, itself first."""
        yield phrase
        head, _, last = phrase.rpartition(" ")
        for single in (*self.wordnet.irregular_plurals.get(last, ()), *singulars(last)):
            yield f"{head} {single}".strip()
        first, of, rest = phrase.partition(" of ")
        if of:
            yield from (f"{single} of {rest}" for single in singulars(first))
        compact = phrase.replace(" ", "")
        if len(compact) >= _SHORTEST_COMPOUND:
            yield from self._names_without_spaces.get(compact, ())
            for single in singulars(compact):
                yield from self._names_without_spaces.get(single, ())

    @cached_property
    def _insertions_by_name(self) -> Mapping[str, tuple[str, ...]]:
        names: defaultdict[str, dict[str, None]] = defaultdict(dict)
        placed: defaultdict[str, dict[str, None]] = defaultdict(dict)
        for insertion in self.inserted.values():
            into = placed if insertion.id in self._placed else names
            for name in (insertion.name, *insertion.aliases):
                into[fold_text(name)][insertion.id] = None
        fresh = {name: ids for name, ids in placed.items() if name not in names and name not in self._lemmas}
        return {name: tuple(ids) for name, ids in (names | fresh).items()}

    @cached_property
    def _lemmas(self) -> Mapping[str, tuple[str, ...]]:
        lemmas: defaultdict[str, list[str]] = defaultdict(list)
        for noun in sorted(self.wordnet.nouns):
            lemmas[fold_text(noun)].append(noun)
        return {name: tuple(nouns) for name, nouns in lemmas.items()}

    @cached_property
    def _names_without_spaces(self) -> Mapping[str, tuple[str, ...]]:
        """Names by their spelling without spaces, where that differs: `barstool` to `bar stool`."""
        spaced: defaultdict[str, list[str]] = defaultdict(list)
        for name in (*self._insertions_by_name, *self._lemmas):
            spaced[name.replace(" ", "")].append(name)
        return {compact: tuple(names) for compact, names in spaced.items()}


@cache
def default_lexicon() -> Lexicon:
    """WordNet, the insertions and the leaves of this checkout, read once."""
    return Lexicon(default_wordnet(), insertions(), _placed_leaves())


def _placed_leaves() -> dict[str, Insertion]:
    """Leaves with an id of ours, as insertions: those that label lists asked for are in `leaves.csv` alone."""
    rows = table_rows(taxonomy_directory() / "leaves.csv", ("node_id", "name", "hypernym", "aliases"))
    return {
        row["node_id"]: Insertion(
            id=row["node_id"],
            name=row["name"],
            parent=row["hypernym"],
            aliases=tuple(filter(None, row["aliases"].split("; "))),
        )
        for _, row in rows
        if row["node_id"].startswith(PREFIX) and row["hypernym"]
    }
