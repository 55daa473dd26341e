"""The categories of the tree: frozen inner nodes, reviewed leaves, and what WordNet states about both.

Everything is read from tables that ship with the project, so that a release can be rebuilt to the byte, and a tree
queried, where there is no WordNet.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

from metric_base.errors import expect, in_file
from metric_base.folders import taxonomy_directory
from metric_base.parsing import table_rows
from metric_base.records import record_of
from taxonomy.categories import PREFIX, Category, InsertedCategory, Pose, insertions
from taxonomy.label_lists import vocabularies, vocabulary
from taxonomy.levels import (
    KIND,
    LEAF,
    BadLevels,
    InnerNode,
    Levels,
    frozen_levels,
    parse_dims,
    replaced_ids,
)

#: Ends the id of a leaf that holds what a source names no closer than an inner node.
OTHER = "/other"

#: Lists whose labels are whole names that people use too, so that they serve as aliases.
_LABELLING_LISTS = ("coco_80", "lvis_v1", "openimages_601", "objects365_v2", "sunrgbd_10")

_LEAVES = ("node_id", "name", "parent_id", "hypernym", "pose", "dims", "aliases", "placed_by")
_SYNSETS = ("synset", "parents", "lemmas")
_ALIASES = ("node_id", "alias", "action")


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaf:
    """A leaf under its kind; `hypernym` is where a reviewer put an insertion; pose and dims only where they differ."""

    node_id: str
    name: str
    parent_id: str
    hypernym: str | None = None
    pose: Pose | None = None
    dims: tuple[str, ...] | None = None
    aliases: tuple[str, ...] = ()
    #: `rule` (the nearest kind) or `reviewer`.
    placed_by: str = "rule"


@dataclass(frozen=True, slots=True)
class ReviewedAliases:
    """Aliases by node that a reviewer added (`added`), or that lead astray and were dropped (`dropped`)."""

    added: Mapping[str, tuple[str, ...]]
    dropped: Mapping[str, tuple[str, ...]]


class SynsetTable:
    """Parents and words of the synsets that the tree uses, from `generated/synsets.csv`: an extract of WordNet 3.0."""

    def __init__(self, parents: Mapping[str, tuple[str, ...]], lemmas: Mapping[str, tuple[str, ...]]) -> None:
        self._parents = parents
        self._lemmas = lemmas

    def hypernyms(self, synset: str) -> tuple[str, ...]:
        """As `WordNet.hypernyms`; empty for a synset that the tree does not use."""
        seen: dict[str, None] = {}
        level = self._parents.get(synset, ())
        while level:
            fresh = [name for name in dict.fromkeys(level) if name not in seen]
            seen.update(dict.fromkeys(fresh))
            level = tuple(above for name in fresh for above in self._parents.get(name, ()))
        return tuple(seen)

    def path(self, synset: str) -> tuple[str, ...]:
        """The synset and what is above it by WordNet's first parents, root first."""
        parents = self._parents.get(synset)
        return (*self.path(parents[0]), synset) if parents else (synset,)

    def lemmas(self, synset: str) -> tuple[str, ...]:
        """As `WordNet.lemmas`; empty for a synset that the tree does not use."""
        return self._lemmas.get(synset, ())


class Catalogue:
    """Inner nodes and leaves together.

    Parameters
    ----------
    levels : the frozen inner nodes.
    leaves : each under a kind; order does not matter.
    words : what WordNet says.
    successors : ids that are gone, or synsets that mean the same item, and the node that replaces each
    inserted : reviewed insertions, for their aliases
    labels : what detectors call a node.
    reviewed : aliases that a reviewer added, and those of WordNet that a reviewer dropped, by node
    """

    def __init__(
        self,
        levels: Levels,
        leaves: Iterable[Leaf],
        words: SynsetTable,
        successors: Mapping[str, str] | None = None,
        inserted: Mapping[str, InsertedCategory] | None = None,
        labels: Mapping[str, tuple[str, ...]] | None = None,
        reviewed: ReviewedAliases | None = None,
    ) -> None:
        self.levels = levels
        self.leaves = {leaf.node_id: leaf for leaf in sorted(leaves, key=lambda leaf: leaf.node_id)}
        self.successors = dict(successors or {})
        self._words = words
        self._inserted = dict(inserted or {})
        self._labels = dict(labels or {})
        self._reviewed_aliases = reviewed or ReviewedAliases({}, {})
        for leaf in self.leaves.values():
            if leaf.parent_id not in {kind.node_id for kind in levels.kinds} or leaf.node_id in levels.nodes:
                raise BadLevels(f"leaf {leaf.node_id}: expected a new id under a kind; found {leaf.parent_id!r}")

    @property
    def added_aliases(self) -> Mapping[str, str]:
        """The leaf or kind of each alias that a reviewer added; the last one's of an alias that several have."""
        return {word: node for node, words in self._reviewed_aliases.added.items() for word in words}

    def leaf_of(self, concept: str) -> str | None:
        """The leaf of what a source names: a synset or an insertion; None where it has no place yet.

        An inner node answers with its leaf `/other`, a deprecated id with its successor's.
        """
        concept = self.successors.get(concept, concept)
        if concept in self.leaves:
            return concept
        if concept not in self.levels.nodes:
            return None
        if self.levels.home_of(concept) is None and self.levels.nodes[concept].level == KIND:
            concept = self.levels.unspecified_parent(concept) or concept
        return None if self.levels.home_of(concept) is None else concept + OTHER

    def wordnet_path(self, leaf: str) -> tuple[str, ...]:
        """WordNet's path to a leaf by first parents, root first; an insertion hangs below what it was put under."""
        if leaf.endswith(OTHER):
            return (*self.wordnet_path(leaf.removesuffix(OTHER)), leaf)
        above = self.leaves[leaf].hypernym if leaf in self.leaves else None
        return self._words.path(leaf) if above is None else (*self.wordnet_path(above), leaf)

    @cached_property
    def categories(self) -> tuple[Category, ...]:
        """All nodes, root first and parents before children, leaves in the order of their ids."""
        inner = [self._inner(node) for node in self.levels.nodes.values()]
        home = {node.node_id: self.levels.home_of(node.node_id) for node in self.levels.nodes.values()}
        other = [self._other(node, kind) for node in self.levels.nodes.values() if (kind := home[node.node_id])]
        leaves = [self._leaf(leaf) for leaf in self.leaves.values()]
        return (*inner, *_with_distinct_names([*inner, *leaves, *other])[len(inner) :])

    def _inner(self, node: InnerNode) -> Category:
        return Category(
            node_id=node.node_id,
            name=node.name,
            synset=_synset(node.node_id),
            parent_id=node.parent_id,
            level=node.level,
            path=self._names(node.node_id),
            hypernyms=self._words.hypernyms(node.node_id),
            aliases=self._aliases(node.node_id, node.name, ()),
            pose=node.pose,
            dims=node.dims,
        )

    def _leaf(self, leaf: Leaf) -> Category:
        kind = self.levels.nodes[leaf.parent_id]
        return Category(
            node_id=leaf.node_id,
            name=leaf.name,
            synset=_synset(leaf.node_id),
            parent_id=kind.node_id,
            level=LEAF,
            path=(*self._names(kind.node_id), leaf.name),
            hypernyms=self._hypernyms(leaf.node_id),
            aliases=self._aliases(leaf.node_id, leaf.name, leaf.aliases),
            pose=leaf.pose or kind.pose,
            dims=leaf.dims or kind.dims,
        )

    def _other(self, node: InnerNode, kind: str) -> Category:
        name = f"{_source_words(node)} (unspecified)"
        return Category(
            node_id=node.node_id + OTHER,
            name=name,
            synset=None,
            parent_id=kind,
            level=LEAF,
            path=(*self._names(kind), name),
            hypernyms=tuple(filter(None, (_synset(node.node_id), *self._words.hypernyms(node.node_id)))),
            pose=node.pose,
            dims=node.dims,
        )

    def _hypernyms(self, concept: str) -> tuple[str, ...]:
        """Synsets above a leaf, through the concepts that insertions were put under."""
        above = self.leaves[concept].hypernym if concept in self.leaves else None
        if above is None:
            return self._words.hypernyms(concept)
        return tuple(filter(None, (_synset(above), *self._hypernyms(above))))

    def _names(self, node_id: str) -> tuple[str, ...]:
        return tuple(self.levels.nodes[above].name for above in self.levels.path(node_id))

    def _aliases(self, node_id: str, name: str, further: tuple[str, ...]) -> tuple[str, ...]:
        merged = (word for old, new in self.successors.items() if new == node_id for word in self._words.lemmas(old))
        inserted = self._inserted[node_id].aliases if node_id in self._inserted else ()
        added = self._reviewed_aliases.added.get(node_id, ())
        words = (*self._words.lemmas(node_id), *inserted, *further, *self._labels.get(node_id, ()), *merged, *added)
        unwanted = {name.casefold(), *(word.casefold() for word in self._reviewed_aliases.dropped.get(node_id, ()))}
        return tuple(word for word in dict.fromkeys(words) if word.casefold() not in unwanted)


@cache
def default_catalogue(directory: Path | None = None) -> Catalogue:
    """The catalogue of the tables that ship with the project, or of those in another folder.

    Raises
    ------
    BadLevels
        A table is missing or breaks a rule.
    """
    folder = directory or taxonomy_directory()
    synsets = [row for _, row in table_rows(folder / "generated" / "synsets.csv", _SYNSETS, BadLevels)]
    words = SynsetTable(
        {row["synset"]: tuple(row["parents"].split()) for row in synsets},
        {row["synset"]: tuple(filter(None, row["lemmas"].split("; "))) for row in synsets},
    )
    leaves = list(_leaf_rows(folder / "leaves.csv"))
    inserted = insertions(folder / "insertions.jsonl")
    levels = frozen_levels(folder / "levels.csv")
    return Catalogue(
        levels, leaves, words, replaced_ids(folder), inserted, _labels(directory), _reviewed_aliases(folder)
    )


def _reviewed_aliases(folder: Path) -> ReviewedAliases:
    """The table `aliases.csv`; a folder without it has no reviewed aliases.

    Raises
    ------
    BadLevels
        An action that is neither `add` nor `drop`.
    """
    by_action: dict[str, dict[str, list[str]]] = {"add": {}, "drop": {}}
    file = folder / "aliases.csv"
    for place, row in table_rows(file, _ALIASES, BadLevels) if file.is_file() else ():
        with in_file(place, BadLevels):
            expect(row["action"] in by_action, "action", "add or drop", row["action"])
        by_action[row["action"]].setdefault(row["node_id"], []).append(row["alias"])
    added, dropped = ({node: tuple(words) for node, words in rows.items()} for rows in by_action.values())
    return ReviewedAliases(added, dropped)


def _labels(directory: Path | None) -> dict[str, tuple[str, ...]]:
    """Labels by node, without those whose brackets say that the bare word means something else."""
    labels: dict[str, dict[str, None]] = {}
    for name in sorted(set(_LABELLING_LISTS) & set(vocabularies(directory)), key=_LABELLING_LISTS.index):
        for label in vocabulary(name, directory):
            if label.node_id and "(" not in label.label:
                labels.setdefault(label.node_id, {})[label.label.strip().replace("_", " ").lower()] = None
    return {node_id: tuple(words) for node_id, words in labels.items()}


def _leaf_rows(file: Path) -> Iterator[Leaf]:
    for place, row in table_rows(file, _LEAVES, BadLevels):
        with in_file(place, BadLevels):
            cells = {
                "hypernym": row["hypernym"] or None,
                "pose": row["pose"] or None,
                "dims": parse_dims(row["dims"]) if row["dims"] else None,
                "aliases": list(filter(None, row["aliases"].split("; "))),
            }
            yield record_of(row | cells, Leaf, cells=True)


def _source_words(node: InnerNode) -> str:
    """What a source said that named no more than an inner node: `lighter`, not `lighter, match and tobacco`."""
    joined = "," in node.name or " and " in node.name
    return node.node_id.partition(".")[0].replace("_", " ") if joined and _synset(node.node_id) else node.name


def _synset(node_id: str) -> str | None:
    return None if node_id.startswith(PREFIX) or node_id.endswith(OTHER) else node_id


def _with_distinct_names(categories: list[Category]) -> list[Category]:
    """Categories whose names differ: a leaf that shares its name says in brackets what kind of item it is."""
    bearers: dict[str, list[str]] = {}
    for category in categories:
        bearers.setdefault(category.name.casefold(), []).append(category.node_id)
    return [_apart(c) if c.level == LEAF and len(bearers[c.name.casefold()]) > 1 else c for c in categories]


def _apart(category: Category) -> Category:
    name = f"{category.name} ({category.path[-2]})"
    return replace(category, name=name, path=(*category.path[:-1], name), aliases=(category.name, *category.aliases))
