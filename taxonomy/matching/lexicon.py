"""Names that can be matched, by folded spelling: nouns of WordNet, reviewed insertions and aliases."""

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
    """Senses by name, and hypernyms of concepts (WordNet synsets and `mt:` ids).

    Parameters
    ----------
    wordnet : WordNet
    inserted : mapping of str to InsertedCategory
        Insertions by id, parents before children.
    placed : mapping of str to InsertedCategory, optional
        Leaves that a reviewer added for label lists. Their names, and `aliases`, do not replace names of WordNet and
        of insertions.
    aliases : mapping of str to str, optional
        Concept by further name.
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
        """Return the senses of a folded phrase by its known forms: insertions first, then by frequency.

        The forms are the phrase as it is (scissors), its singular, and its spelling without spaces.
        """
        if phrase not in self._memory:
            named = ((form, self._names.get(form, ())) for form in self.forms(phrase))
            self._memory[phrase] = {form: tuple(map(self._sense_of, ids)) for form, ids in named if ids}
        return self._memory[phrase]

    def sense(self, concept: str) -> Sense:
        """Return the sense of a concept."""
        return Sense((concept, *self.hypernyms(concept)))

    def knows(self, concept: str) -> bool:
        """Return True if the id is an insertion or a noun synset."""
        return concept in self.inserted or (not concept.startswith(PREFIX) and self.wordnet.knows(concept))

    def canonical(self, concept: str) -> str:
        """Return the main name of a concept: `sofa.n.01` for `couch.n.01`."""
        return concept if concept in self.inserted else self.wordnet.canonical(concept)

    def hypernyms(self, concept: str) -> tuple[str, ...]:
        """Return all concepts above a concept, nearest first."""
        if concept not in self._chains:
            if concept in self.inserted:
                parent = self.inserted[concept].parent
                self._chains[concept] = (parent, *self.hypernyms(parent))
            else:
                self._chains[concept] = self.wordnet.hypernyms(concept)
        return self._chains[concept]

    def is_a(self, concept: str, kind: str) -> bool:
        """Return True if a concept is `kind` or below it."""
        return concept == kind or kind in self.hypernyms(concept)

    def name(self, concept: str) -> str:
        """Return the common name of a concept."""
        return self.inserted[concept].name if concept in self.inserted else self.wordnet.lemmas(concept)[0]

    def forms(self, phrase: str) -> Iterator[str]:
        """Return the possible names of a folded phrase (`written_forms`)."""
        return written_forms(phrase, lambda: self._letters, self.wordnet.irregular_plurals)

    def _sense_of(self, concept: str | int) -> Sense:
        return self.sense(concept if isinstance(concept, str) else self.wordnet.at(concept))

    @cached_property
    def _names(self) -> Mapping[str, tuple[str | int, ...]]:
        """Concepts by folded name; a synset by its offset, because reading all 82,115 takes seconds and 280 MB."""
        names: defaultdict[str, dict[str | int, None]] = defaultdict(dict)
        for insertion in self._reviewed.values():
            for name in (insertion.name, *insertion.aliases):
                names[fold_text(name)][insertion.id] = None
        for noun in sorted(self.wordnet.nouns):
            names[fold_text(noun)].update(dict.fromkeys(self.wordnet.offsets(noun)))
        placed = [(name, one.id) for one in self.inserted.values() for name in (one.name, *one.aliases)]
        further: defaultdict[str, dict[str | int, None]] = defaultdict(dict)
        for name, concept in (*placed, *self._aliases.items()):
            if fold_text(name) not in names:
                further[fold_text(name)][concept] = None
        return {name: tuple(ids) for name, ids in (names | further).items()}

    @cached_property
    def _letters(self) -> Mapping[str, tuple[str, ...]]:
        return by_letters(self._names)


@cache
def default_lexicon() -> Lexicon:
    """Return the lexicon of WordNet and of the insertions, leaves and reviewed aliases of this checkout."""
    catalogue = default_catalogue()
    placed = {
        leaf.node_id: InsertedCategory(id=leaf.node_id, name=leaf.name, parent=leaf.hypernym, aliases=leaf.aliases)
        for leaf in catalogue.leaves.values()
        if leaf.node_id.startswith(PREFIX) and leaf.hypernym
    }
    return Lexicon(default_wordnet(), insertions(), placed, catalogue.added_aliases)
