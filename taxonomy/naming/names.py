"""Which nodes have a name, and how much evidence each of them has: label lists, own names, senses, items."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple  # which takes a quarter of a dataclass's time in each query

from taxonomy.words.senses import Sense, label_votes, reviewed_meanings, senses
from taxonomy.words.spelling import by_letters, fold_text, passed_initials, plain_fold

#: A juicer is an appliance before it is somebody.
PERSON = "person.n.01"

#: Ends the id of a leaf of items that no source names closer; only its full name means it.
_OTHER = "/other"

#: Two senses whose evidence differs by less are both meant.
NEAR_RATIO = 1.05

#: The evidence for a node, in units in which a difference of one is clear. A label of COCO is worth more than a name of
#: one's own, that more than WordNet's order of senses; items decide only by a difference of some four hundred times.
OWN_NAME = 2.0
REVIEWED_ALIAS = 1.0
USED_MOST = 1.0
EACH_SENSE_BEFORE = 0.15
FOOD_BEFORE_PLANT = 0.8
TENFOLD_ITEMS = 0.42
MAX_LABEL_WEIGHT = 5.0

#: What the first of a reviewed order has before the next, where the reviewer calls it clear.
CLEAR_RATIO = 2.0

#: Initials of which names are folded by themselves: three take as long as all at once.
MOST_INITIALS = 3

#: An alias of WordNet that is used so rarely in this sense, while an item is meant more often, leads astray.
LEAST_SHARE = 0.1


class Candidate(NamedTuple):
    """A node that may be meant, how much evidence it has, and how it was reached."""

    node_id: str
    score: float
    how: str


class NameAnswer(NamedTuple):
    """What a text means: the likeliest candidate first; `how` it was reached; `margin` to the next that is not kin.

    `form` is the name that answered; `note` says what of the text it leaves out, if anything.
    """

    candidates: tuple[Candidate, ...]
    how: str
    margin: float
    form: str = ""
    note: str | None = None

    @property
    def node_id(self) -> str:
        """The node that is meant."""
        return self.candidates[0].node_id

    @property
    def ambiguous(self) -> bool:
        """Return True if another sense is as likely."""
        return self.margin < NEAR_RATIO


class Names:
    """The nodes of a release by their names.

    Parameters
    ----------
    ids : (n,) node ids.
    names : (n,) the name of each.
    aliases : (n,) further words for each.
    items : (n,) items of the fit at or below each.
    parents : (n,) node above each, None at the root.
    hypernyms : gives the synsets above a node; asked only where two nodes compete.
    labels : node and weight of a label by the lists of detectors; asked only where it decides.
    """

    def __init__(
        self,
        ids: Sequence[str],
        names: Sequence[str],
        aliases: Sequence[Sequence[str] | None],
        items: Sequence[int],
        parents: Sequence[str | None],
        hypernyms: Callable[[str], Sequence[str]],
        labels: Callable[[str], Mapping[str, float]] = label_votes,
    ) -> None:
        self._items = dict(zip(ids, items, strict=True))
        self._parents = dict(zip(ids, parents, strict=True))
        self._names = dict(zip(ids, names, strict=True))
        self._hypernyms = hypernyms
        self._labels = labels
        self._given = (ids, names, aliases)
        self._by_initial: dict[str, Mapping[str, Mapping[str, bool]]] = {}

    def __contains__(self, node_id: object) -> bool:
        return node_id in self._items

    @cached_property
    def _forms(self) -> Mapping[str, Mapping[str, bool]]:
        """By folded name: its nodes, and whether it is their own name or a further word."""
        return self._names_folded("")

    def _meant(self, form: str) -> Mapping[str, bool]:
        """The same of one folded name: of the first names those with its initial are folded, later all at once."""
        initial = form[:1]
        if initial not in self._by_initial:
            few = len(self._by_initial) < MOST_INITIALS
            self._by_initial[initial] = self._names_folded(passed_initials(initial)) if few else self._forms
        return self._by_initial[initial].get(form, {})

    def _names_folded(self, passed: str) -> Mapping[str, Mapping[str, bool]]:
        """All folded names but those of words that begin with one of the letters `passed`."""
        forms: defaultdict[str, dict[str, bool]] = defaultdict(dict)
        for node_id, name, words in zip(*self._given, strict=True):
            for word in words or ():
                if word[:1] not in passed:
                    forms[plain_fold(word)].setdefault(node_id, False)
            if name[:1] not in passed or node_id[:1] not in passed:
                for own in dict.fromkeys(own_names(node_id, name)):
                    forms[plain_fold(own)][node_id] = True
        return forms

    @property
    def forms(self) -> Iterable[str]:
        """Every folded name."""
        return self._forms

    @cached_property
    def words(self) -> frozenset[str]:
        """Every word of a folded name."""
        return frozenset(word for form in self._forms for word in form.split())

    @cached_property
    def letters(self) -> Mapping[str, tuple[str, ...]]:
        """Folded names by their letters alone: `tvmonitor`."""
        return by_letters(self._forms)

    def shown(self, node_id: str) -> str:
        """The name of a node."""
        return self._names[node_id]

    def items(self, node_id: str) -> int:
        """Items of the fit at or below a node."""
        return self._items[node_id]

    def owners(self, form: str) -> tuple[str, ...]:
        """The nodes that have a folded form among their names, those with most items first."""
        return tuple(sorted(self._meant(form), key=lambda node: -self._items[node]))

    def hypernyms(self, node_id: str) -> tuple[str, ...]:
        """Synsets above a node."""
        return tuple(self._hypernyms(node_id))

    def ancestors(self, node_id: str) -> tuple[str, ...]:
        """Ids above a node in the tree, nearest first."""
        parent = self._parents.get(node_id)
        return () if parent is None else (parent, *self.ancestors(parent))

    def has_kinds(self, node_id: str) -> bool:
        """Return True if there are nodes right below one."""
        return node_id in self._above

    @cached_property
    def _above(self) -> frozenset[str | None]:
        return frozenset(self._parents.values())

    def kin(self, one: str, other: str) -> bool:
        """Return True if one of two nodes is above the other, in the tree or in WordNet."""
        if one in self.ancestors(other) or other in self.ancestors(one):
            return True
        return one in self._hypernyms(other) or other in self._hypernyms(one)

    def candidates(self, form: str) -> list[Candidate]:
        """The nodes that a folded form may mean, the likeliest first."""
        owners = self._meant(form)
        votes: Mapping[str, float] = {}
        known = senses(form) if owners and (len(owners) > 1 or not all(owners.values())) else ()
        if len(owners) != 1 or known:
            votes = {node: weight for node, weight in self._labels(form).items() if node in self}
        nodes = dict.fromkeys((*owners, *votes))
        scored = [self._candidate(form, node, owners.get(node), votes.get(node, 0.0), known) for node in nodes]
        likely = sorted((c for c in scored if c.score > 0), key=lambda c: (-c.score, -self._items[c.node_id]))
        return self._in_reviewed_order(form, likely)

    def _in_reviewed_order(self, form: str, likely: list[Candidate]) -> list[Candidate]:
        """The candidates in the order that a reviewer gave the word; those that no reviewer named come last."""
        order = reviewed_meanings(form)
        nodes = [node for node in order.nodes if node in self] if order else []
        if order is None or not nodes:
            return likely
        rest = [one for one in likely if one.node_id not in nodes]
        top = max((one.score for one in likely), default=0.01)
        how = {one.node_id: one.how for one in likely}
        listed = [Candidate(node, top, how.get(node, "alias")) for node in nodes]
        first = Candidate(nodes[0], top + CLEAR_RATIO, listed[0].how) if order.clear else listed[0]
        return [first, *listed[1:], *rest]

    def _candidate(self, form: str, node: str, own: bool | None, votes: float, known: Sequence[Sense]) -> Candidate:
        places = [place for place, sense in enumerate(known) if sense.chain[:1] == (node,)]
        score = min(votes, MAX_LABEL_WEIGHT) + TENFOLD_ITEMS * min(math.log10(1 + self._items[node]), 3)
        if own:
            score += OWN_NAME
        if places:
            score += _sense_score(places[0], known)
            if not own and not votes and _astray(places[0], known, form):
                return Candidate(node, 0.0, "alias")
        elif own is False:
            score += REVIEWED_ALIAS
        if "food.n.01" in self.ancestors(node):
            score += FOOD_BEFORE_PLANT
        return Candidate(node, score + 0.01, "own name" if own else "alias" if own is False else "label list")


def own_names(node_id: str, name: str) -> tuple[str, ...]:
    """A node's name, without what distinguishes it in brackets, and the word of its synset (`bat` of `bat.n.05`)."""
    if node_id.endswith(_OTHER):
        return (name,)
    lemma, dot, _ = node_id.partition(".n.")
    bare = name.partition(" (")[0]
    return (name, bare, lemma) if dot else (name, bare)


def _sense_score(place: int, known: Sequence[Sense]) -> float:
    most = max(sense.count for sense in known)
    before = sum(bool(sense.chain) for sense in known[:place])
    return USED_MOST * (known[place].count + 1) / (most + 1) - EACH_SENSE_BEFORE * before


def _astray(place: int, known: Sequence[Sense], form: str) -> bool:
    """Return True if the taxonomy calls another item by the word, which it means first, and this one hardly ever."""
    lemma = form.replace(" ", "_")
    first = any(sense.chain and sense.concept.partition(".")[0] == lemma for sense in known[:place])
    counts = [sense.count + 1 for sense in known if sense.chain]
    rare = known[place].count == 0 or (known[place].count + 1) / sum(counts) < LEAST_SHARE
    return first and rare


def folded_forms(text: str) -> tuple[str, ...]:
    """The ways to fold a text, the plainest first: `iPhone` as one word, `TrafficLight` as two."""
    return tuple(dict.fromkeys((plain_fold(text), fold_text(text))))
