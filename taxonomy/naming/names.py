"""Nodes of a release by name, with the evidence of each node: label lists, node names, senses, items."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple  # defined in a quarter of the time of a dataclass, in each query

from taxonomy.words.senses import Sense, label_votes, reviewed_meanings, senses
from taxonomy.words.spelling import by_letters, fold_text, passed_initials, plain_fold

#: Node of persons: a juicer is an appliance rather than a person.
PERSON = "person.n.01"

#: Suffix of the id of a leaf for items without a more specific name; only its complete name matches.
_OTHER = "/other"

#: Minimum difference of evidence between the best node and the best unrelated one; with less, the name is ambiguous.
MIN_CLEAR_MARGIN = 1.05

#: Evidence of the name of a node, in units in which 1 is a clear difference. A label of COCO has more evidence than the
#: name of a node, which has more than the order of senses in WordNet; items matter only for a ratio of about 400.
NODE_NAME_SCORE = 2.0
#: Evidence of an alias that a reviewer added.
REVIEWED_ALIAS_SCORE = 1.0
#: Evidence of the sense of a word that the tagged texts of WordNet use most.
FREQUENT_SENSE_SCORE = 1.0
#: Evidence that a sense loses for each sense before it in WordNet.
PRECEDING_SENSE_PENALTY = 0.15
#: Evidence of a food compared with the plant of the same name.
FOOD_SCORE = 0.8
#: Evidence of ten times as many items.
TENFOLD_ITEMS_SCORE = 0.42
#: Maximum evidence of items, in powers of ten.
MAX_ITEM_POWERS = 3
#: Maximum evidence of label lists.
MAX_LABEL_WEIGHT = 5.0
#: Evidence of every node of a name, so that no score is zero.
MIN_SCORE = 0.01
#: Evidence that the first of reviewed meanings has over the next, if the reviewer marked it as clear.
CLEAR_MEANING_SCORE = 2.0

#: Number of initials whose names are normalised separately; three take as long as all names.
MAX_INITIALS = 3

#: Minimum fraction of the uses of a word in the sense of an alias, 0 to 1; an alias with a rarer sense is ignored if an
#: earlier sense has the word as its lemma.
MIN_SENSE_FRACTION = 0.1


class Candidate(NamedTuple):
    """A possible node of a name."""

    node_id: str
    score: float  #: Evidence.
    how: str  #: Rule that matched (`metric_tree.node.Meaning`).


class NameMatch(NamedTuple):
    """The candidates of a text, the most likely first."""

    candidates: tuple[Candidate, ...]
    how: str  #: Rule that matched.
    margin: float  #: Difference of the evidence from the next unrelated candidate.
    form: str = ""  #: Normalised name that matched.
    note: str | None = None  #: Part of the text that was ignored.

    @property
    def node_id(self) -> str:
        """Most likely node."""
        return self.candidates[0].node_id

    @property
    def ambiguous(self) -> bool:
        """Return True if an unrelated node has almost the same evidence."""
        return self.margin < MIN_CLEAR_MARGIN


class Names:
    """The nodes of a release by normalised name.

    Parameters
    ----------
    ids, names : (n,) sequence of str
        Id and name of each node.
    aliases : (n,) sequence
        Further names of each node.
    items : (n,) sequence of int
        Number of items of the fit at or below each node.
    parents : (n,) sequence
        Id of the parent of each node, None for the root.
    hypernyms : callable
        Returns the synsets above a node; called only if nodes are compared.
    labels : callable
        Returns the weight of a label by node in the lists of detectors; called only if it may decide.
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
        self._columns = (ids, names, aliases)
        self._by_initial: dict[str, Mapping[str, Mapping[str, bool]]] = {}

    def __contains__(self, node_id: object) -> bool:
        return node_id in self._items

    @cached_property
    def forms(self) -> Mapping[str, Mapping[str, bool]]:
        """By normalised name, its nodes with True for the name of the node and False for an alias."""
        return self._normalised_names("")

    def _nodes_of(self, form: str) -> Mapping[str, bool]:
        """Return the entry of a normalised name in `_forms`.

        For the first `MAX_INITIALS` initials only the names with that initial are normalised.
        """
        initial = form[:1]
        if initial not in self._by_initial:
            is_separate = len(self._by_initial) < MAX_INITIALS
            forms = self._normalised_names(passed_initials(initial)) if is_separate else self.forms
            self._by_initial[initial] = forms
        return self._by_initial[initial].get(form, {})

    def _normalised_names(self, passed: str) -> Mapping[str, Mapping[str, bool]]:
        """Normalise all names, except for those that begin with a character of `passed`."""
        forms: defaultdict[str, dict[str, bool]] = defaultdict(dict)
        for node_id, name, aliases in zip(*self._columns, strict=True):
            for alias in aliases or ():
                if alias[:1] not in passed:
                    forms[plain_fold(alias)].setdefault(node_id, False)
            if name[:1] not in passed or node_id[:1] not in passed:
                for node_name in dict.fromkeys(node_names(node_id, name)):
                    forms[plain_fold(node_name)][node_id] = True
        return forms

    @cached_property
    def words(self) -> frozenset[str]:
        """Every word of a normalised name."""
        return frozenset(word for form in self.forms for word in form.split())

    @cached_property
    def letters(self) -> Mapping[str, tuple[str, ...]]:
        """Normalised names by their letters without spaces, such as `tvmonitor`."""
        return by_letters(self.forms)

    def display_name(self, node_id: str) -> str:
        """Return the name of a node."""
        return self._names[node_id]

    def items(self, node_id: str) -> int:
        """Return the number of items of the fit at or below a node."""
        return self._items[node_id]

    def nodes_named(self, form: str) -> tuple[str, ...]:
        """Return the nodes with a normalised name, the most items first."""
        return tuple(sorted(self._nodes_of(form), key=lambda node: -self._items[node]))

    def hypernyms(self, node_id: str) -> tuple[str, ...]:
        """Return the synsets above a node."""
        return tuple(self._hypernyms(node_id))

    def ancestors(self, node_id: str) -> tuple[str, ...]:
        """Return the ids above a node in the tree, the parent first."""
        parent = self._parents.get(node_id)
        return () if parent is None else (parent, *self.ancestors(parent))

    @cached_property
    def inner_nodes(self) -> frozenset[str | None]:
        """Ids of the nodes with children."""
        return frozenset(self._parents.values())

    def are_related(self, one: str, other: str) -> bool:
        """Return True if one of two nodes is above the other, in the tree or in WordNet."""
        if one in self.ancestors(other) or other in self.ancestors(one):
            return True
        return one in self._hypernyms(other) or other in self._hypernyms(one)

    def candidates(self, form: str) -> list[Candidate]:
        """Return the possible nodes of a normalised name, the most likely first.

        A reviewed order of the meanings of the name precedes the order by evidence.
        """
        named = self._nodes_of(form)
        votes: Mapping[str, float] = {}
        known = senses(form) if named and (len(named) > 1 or not all(named.values())) else ()
        if len(named) != 1 or known:
            votes = {node: weight for node, weight in self._labels(form).items() if node in self}
        nodes = dict.fromkeys((*named, *votes))
        scored = [self._candidate(form, node, named.get(node), votes.get(node, 0.0), known) for node in nodes]
        likely = sorted((c for c in scored if c.score > 0), key=lambda c: (-c.score, -self._items[c.node_id]))
        order = reviewed_meanings(form)
        reviewed = [node for node in order.nodes if node in self] if order else []
        if order is None or not reviewed:
            return likely
        top = max((one.score for one in likely), default=MIN_SCORE)
        how = {one.node_id: one.how for one in likely}
        first, *others = (Candidate(node, top, how.get(node, "alias")) for node in reviewed)
        if order.clear:
            first = first._replace(score=top + CLEAR_MEANING_SCORE)
        return [first, *others, *(one for one in likely if one.node_id not in reviewed)]

    def _candidate(
        self, form: str, node: str, is_node_name: bool | None, votes: float, known: Sequence[Sense]
    ) -> Candidate:
        """Return a node with its evidence; `is_node_name` is None if only label lists have the name."""
        index = next((index for index, sense in enumerate(known) if sense.chain[:1] == (node,)), None)
        score = min(votes, MAX_LABEL_WEIGHT)
        score += TENFOLD_ITEMS_SCORE * min(math.log10(1 + self._items[node]), MAX_ITEM_POWERS)
        if is_node_name:
            score += NODE_NAME_SCORE
        if index is not None:
            score += sense_score(index, known)
            if not is_node_name and not votes and is_misleading_alias(index, known, form):
                return Candidate(node, 0.0, "alias")
        elif is_node_name is False:
            score += REVIEWED_ALIAS_SCORE
        if "food.n.01" in self.ancestors(node):
            score += FOOD_SCORE
        how = "own name" if is_node_name else "alias" if is_node_name is False else "label list"
        return Candidate(node, score + MIN_SCORE, how)


def node_names(node_id: str, name: str) -> tuple[str, ...]:
    """Return the name of a node, the name without brackets, and the word of its synset (`bat` for `bat.n.05`)."""
    if node_id.endswith(_OTHER):
        return (name,)
    lemma, dot, _ = node_id.partition(".n.")
    bare = name.partition(" (")[0]
    return (name, bare, lemma) if dot else (name, bare)


def sense_score(index: int, known: Sequence[Sense]) -> float:
    """Return the evidence of a sense of a word, from the counts of WordNet and the number of senses before it."""
    most = max(sense.count for sense in known)
    before = sum(bool(sense.chain) for sense in known[:index])
    return FREQUENT_SENSE_SCORE * (known[index].count + 1) / (most + 1) - PRECEDING_SENSE_PENALTY * before


def is_misleading_alias(index: int, known: Sequence[Sense], form: str) -> bool:
    """Return True if the sense of an alias is rare, and an earlier sense is an item with the word as its lemma."""
    lemma = form.replace(" ", "_")
    has_item_before = any(sense.chain and sense.concept.partition(".")[0] == lemma for sense in known[:index])
    counts = [sense.count + 1 for sense in known if sense.chain]
    is_rare = known[index].count == 0 or (known[index].count + 1) / sum(counts) < MIN_SENSE_FRACTION
    return has_item_before and is_rare


def folded_forms(text: str) -> tuple[str, ...]:
    """Return the normalised forms of a text: `iPhone` as one word, then `TrafficLight` as two."""
    return tuple(dict.fromkeys((plain_fold(text), fold_text(text))))
