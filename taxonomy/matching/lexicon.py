"""Every name that can be matched: WordNet's nouns, the reviewed insertions and aliases, by their folded spelling."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from functools import cache, cached_property

from taxonomy.catalogue import default_catalogue
from taxonomy.categories import PREFIX, InsertedCategory, insertions
from taxonomy.wordnet import WordNet, default_wordnet
from taxonomy.words.senses import Sense
from taxonomy.words.spelling import by_letters, fold_text, written_forms


class Lexicon:
    """Senses (of a WordNet synset or an `mt:` id) by name, and what is above each concept.

    Parameters
    ----------
    wordnet : WordNet
    inserted : insertions by id, parents before children.
    placed : leaves that a reviewer gave the tree for label lists; a name of theirs that WordNet or an insertion has too
        means that one.
    aliases : concept by further names that reviewers gave it; a name that WordNet or an insertion has means that one.
    """

    def __init__(
        self,
        wordnet: WordNet,
        inserted: Mapping[str, InsertedCategory],
        placed: Mapping[str, InsertedCategory] | None = None,
        aliases: Mapping[str, str] | None = None,
    ) -> None:
        self.wordnet = wordnet
        self.inserted = {**(placed or {}), **inserted}
        self._reviewed = inserted
        self._aliases = aliases or {}
        self._chains: dict[str, tuple[str, ...]] = {}
        self._memory: dict[str, Mapping[str, tuple[Sense, ...]]] = {}

    def senses(self, phrase: str) -> Mapping[str, tuple[Sense, ...]]:
        """What a folded phrase may name, by the form it is taken for: insertions first, then senses by frequency.

        A plural is taken as such first (scissors), then for its singular, then for a name without spaces; empty if
        the phrase is unknown in every form.
        """
        known = self._memory.get(phrase)
        if known is None:
            named = ((form, self._names.get(form, ())) for form in self.forms(phrase))
            known = self._memory[phrase] = {form: tuple(map(self.sense, ids)) for form, ids in named if ids}
        return known

    def sense(self, concept: str) -> Sense:
        """A concept with what is above it."""
        return Sense((concept, *self.hypernyms(concept)))

    def knows(self, concept: str) -> bool:
        """Return True if the id is an insertion or a noun synset."""
        return concept in self.inserted or (not concept.startswith(PREFIX) and self.wordnet.knows(concept))

    def canonical(self, concept: str) -> str:
        """The one name of a concept: `couch.n.01` is `sofa.n.01`, as WordNet names the synset."""
        return concept if concept in self.inserted else self.wordnet.canonical(concept)

    def hypernyms(self, concept: str) -> tuple[str, ...]:
        """All concepts above, nearest first."""
        if concept not in self._chains:
            self._chains[concept] = self._hypernyms(concept)
        return self._chains[concept]

    def is_a(self, concept: str, kind: str) -> bool:
        """Return True if the concept is the kind or below it."""
        return concept == kind or kind in self.hypernyms(concept)

    def name(self, concept: str) -> str:
        """The plain name that people use."""
        return self.inserted[concept].name if concept in self.inserted else self.wordnet.lemmas(concept)[0]

    def forms(self, phrase: str) -> Iterator[str]:
        """What a folded phrase may be a spelling or a plural of, itself first."""
        return written_forms(phrase, lambda: self._letters, self.wordnet.irregular_plurals)

    def _hypernyms(self, concept: str) -> tuple[str, ...]:
        if concept in self.inserted:
            parent = self.inserted[concept].parent
            return (parent, *self.hypernyms(parent))
        return self.wordnet.hypernyms(concept)

    @cached_property
    def _names(self) -> Mapping[str, tuple[str, ...]]:
        names: defaultdict[str, dict[str, None]] = defaultdict(dict)
        for insertion in self._reviewed.values():
            for name in (insertion.name, *insertion.aliases):
                names[fold_text(name)][insertion.id] = None
        for noun in sorted(self.wordnet.nouns):
            names[fold_text(noun)].update(dict.fromkeys(self.wordnet.senses(noun)))
        placed = [(name, one.id) for one in self.inserted.values() for name in (one.name, *one.aliases)]
        further: defaultdict[str, dict[str, None]] = defaultdict(dict)
        for name, concept in (*placed, *self._aliases.items()):
            if fold_text(name) not in names:
                further[fold_text(name)][concept] = None
        return {name: tuple(ids) for name, ids in (names | further).items()}

    @cached_property
    def _letters(self) -> Mapping[str, tuple[str, ...]]:
        return by_letters(self._names)


@cache
def default_lexicon() -> Lexicon:
    """WordNet, the insertions, the leaves and the reviewed aliases of this checkout, read once."""
    catalogue = default_catalogue()
    placed = {
        leaf.node_id: InsertedCategory(id=leaf.node_id, name=leaf.name, parent=leaf.hypernym, aliases=leaf.aliases)
        for leaf in catalogue.leaves.values()
        if leaf.node_id.startswith(PREFIX) and leaf.hypernym
    }
    return Lexicon(default_wordnet(), insertions(), placed, catalogue.added_aliases)
