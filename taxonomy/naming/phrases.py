"""Names that the tree lacks: a word of WordNet by its kind, a name without its modifiers, a compound's head noun."""

from __future__ import annotations

from collections.abc import Sequence

from taxonomy.naming.answers import Answer, Lookup
from taxonomy.naming.candidates import Names
from taxonomy.naming.evidence import head_trust, senses
from taxonomy.naming.modifiers import ALIENATING, CONTAINERS, OF_THE_LIVING, modifiers
from taxonomy.naming.spelling import singular_phrases

__all__ = ["LEAST_NAMED", "PERSON", "Phrases"]

#: Share of the known compounds of a head noun that are such things, from which the head alone is taken.
HEAD_TRUST = 0.65
#: Compounds that must be known before a head noun is taken.
HEAD_COMPOUNDS = 4

#: Levels of the tree (the root is 1) from which a broader kind is taken: a stocking is no footwear of 30 by 10 cm. One
#: level further up only by its own name (an electric car is a car), and never further (no container, no vehicle).
LEAST_DEPTH = 4
LEAST_NAMED = 3

#: Above everything that lives.
_LIVING = {"animal.n.01", "mt:human", "person.n.01", "organism.n.01"}

#: Above what grows and what is eaten, people left out.
_GROWING = {"animal.n.01", "plant.n.02", "food.n.01"}

#: A juicer is a thing before it is somebody.
PERSON = "person.n.01"


class Phrases:
    """Phrases of one release's names.

    Parameters
    ----------
    names : the nodes by their names; lookup : looks up a name as it is.
    """

    def __init__(self, names: Names, lookup: Lookup) -> None:
        self._names = names
        self._lookup = lookup

    def bare(self, words: Sequence[str]) -> Answer | None:
        """The answer for a name after its modifiers are taken away, one by one from the left."""
        living = False
        while len(words) > 1 and (leading := modifiers(words)):
            living = living or words[0] in OF_THE_LIVING
            words = words[leading:]
            form = " ".join(words)
            answer = self._lookup.of_form(form) or self.of_wordnet(form)
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
        answer = self._lookup.best(self._names.candidates(head), None) if head else None
        if head is None or answer is None or answer.ambiguous or senses(" ".join(words)):
            return None  # what WordNet knows as a whole is no such thing, or would have been found
        if self._is_of_another_kind(words[-2], answer.node_id):
            return None
        kinds, compounds = head_trust(head).get(answer.node_id, (0, 0))
        trusted = compounds >= HEAD_COMPOUNDS and kinds / compounds >= HEAD_TRUST
        if trusted or head in CONTAINERS:
            return Answer(answer.candidates, "broader kind", answer.margin)
        return None

    def of_wordnet(self, form: str) -> Answer | None:
        """The nearest kind in the tree of a word that the tree lacks."""
        forms = (form, *singular_phrases(form), form.replace(" ", ""))
        known = next(filter(None, map(senses, forms)), ())
        things = [sense for sense in known if sense.nodes and PERSON not in sense.nodes]
        people = list(known) if all(sense.nodes for sense in known) else []  # a piranha is no person but a fish
        meant = [known[0]] if any(sense.count for sense in known) else things or people
        places = [next((node for node in sense.nodes if node in self._names), None) for sense in meant]
        node = places[0] if places else None
        if node is None or any(other is None or not self._lookup.same(node, other) for other in places):
            return None  # what is meant first is no thing, has no place in the tree, or is one of several things
        return None if self._too_broad(node, form.rpartition(" ")[2]) else self._lookup.at(node, "broader kind")

    def _too_broad(self, node: str, head: str) -> bool:
        """Whether a node is so far up that it says little of a size, unless the text calls it by its own name."""
        heads = {head, *singular_phrases(head)}
        depth = len(self._names.ancestors(node)) + 1
        named = any(node in self._names.owners(one) for one in heads)
        broad = depth < LEAST_NAMED or (depth < LEAST_DEPTH and not named)
        return broad and node != PERSON and self._names.has_kinds(node)

    def misleads(self, form: str, answer: Answer) -> bool:
        """Whether WordNet knows a whole name as something that lives, and what is left of it does not, or the reverse.

        A blue tit is a bird and no blue thing of that name.
        """
        kinds = [sense.nodes[0] for sense in senses(form) if sense.nodes and sense.nodes[0] in self._names]
        return bool(kinds) and all(self._lives(kind) != self._lives(answer.node_id) for kind in kinds)

    def _is_of_another_kind(self, modifier: str, head: str) -> bool:
        """Whether a compound's first noun is something that lives or is eaten, and its head is neither.

        The bulb of garlic is no light bulb, and a dog's bed is not for people.
        """
        candidates = self._names.candidates(modifier)
        return bool(candidates) and self._grows(candidates[0].node_id) and not self._grows(head)

    def _grows(self, node: str) -> bool:
        return bool(_GROWING & {node, *self._names.ancestors(node)})

    def _lives(self, node: str) -> bool:
        return bool(_LIVING & {node, *self._names.ancestors(node), *self._names.hypernyms(node)})
