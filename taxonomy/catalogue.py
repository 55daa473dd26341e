"""Build the categories of the tree: frozen inner nodes, reviewed leaves, and their words and hypernyms in WordNet.

All input is in tables that ship with the project, so that a release can be rebuilt to the byte, and a tree queried,
without WordNet.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from metric_base.errors import expect, in_file
from metric_base.folders import taxonomy_directory
from metric_base.parsing import table_rows
from metric_base.records import record_of
from taxonomy.categories import PREFIX, Category, InsertedCategory, Pose, insertions
from taxonomy.label_lists import vocabularies, vocabulary
from taxonomy.levels import KIND, LEAF, BadLevels, Levels, frozen_levels, parse_dims, replaced_ids
from taxonomy.wordnet import nearest_first

#: Suffix of the id of a leaf for items that sources name no more precisely than an inner node.
OTHER = "/other"

#: Lists whose labels are common names, so that they are used as aliases.
_LABELLING_LISTS = ("coco_80", "lvis_v1", "openimages_601", "objects365_v2", "sunrgbd_10")

_LEAVES = ("node_id", "name", "parent_id", "hypernym", "pose", "dims", "aliases", "placed_by")
_SYNSETS = ("synset", "parents", "lemmas")
_ALIASES = ("node_id", "alias", "action")


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaf:
    """A leaf under its kind."""

    node_id: str
    name: str
    parent_id: str
    hypernym: str | None = None  #: Concept under which a reviewer placed an insertion.
    pose: Pose | None = None  #: None: that of the kind.
    dims: tuple[str, ...] | None = None  #: None: those of the kind.
    aliases: tuple[str, ...] = ()
    placed_by: str = "rule"  #: `rule` (the nearest kind) or `reviewer`.


@dataclass(frozen=True, slots=True)
class ReviewedAliases:
    """Aliases by node that a reviewer added, and misleading aliases that a reviewer dropped."""

    added: Mapping[str, tuple[str, ...]]
    dropped: Mapping[str, tuple[str, ...]]


class SynsetTable:
    """Parents and words of the synsets of the tree, an extract of WordNet 3.0 (`generated/synsets.csv`)."""

    def __init__(self, parents: Mapping[str, tuple[str, ...]], lemmas: Mapping[str, tuple[str, ...]]) -> None:
        self._parents = parents
        self._lemmas = lemmas

    def hypernyms(self, synset: str) -> tuple[str, ...]:
        """Return the result of `WordNet.hypernyms`, empty for synsets that are not in the table."""
        return nearest_first(synset, lambda name: self._parents.get(name, ()))

    def lemmas(self, synset: str) -> tuple[str, ...]:
        """Return the result of `WordNet.lemmas`, empty for synsets that are not in the table."""
        return self._lemmas.get(synset, ())


class Catalogue:
    """Inner nodes and leaves.

    Parameters
    ----------
    levels : Levels
        Frozen inner nodes.
    leaves : iterable of Leaf
        Leaves under kinds, in any order.
    words : SynsetTable
    successors : mapping of str to str, optional
        Nodes that replace removed ids, or synonymous synsets.
    inserted : mapping of str to InsertedCategory, optional
        Reviewed insertions, for their aliases.
    labels : mapping of str to tuple of str, optional
        Labels of detectors by node.
    reviewed : ReviewedAliases, optional
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
        """Node by alias that a reviewer added; if several nodes have an alias, the last one."""
        return {word: node for node, words in self._reviewed_aliases.added.items() for word in words}

    def leaf_of(self, concept: str) -> str | None:
        """Return the leaf of a synset or an insertion; None if the tree does not contain it.

        The leaf of an inner node is its leaf `/other`, the leaf of a removed id is the leaf of its successor.
        """
        concept = self.successors.get(concept, concept)
        if concept in self.leaves:
            return concept
        if concept not in self.levels.nodes:
            return None
        if self.levels.home_of(concept) is None and self.levels.nodes[concept].level == KIND:
            concept = self.levels.unspecified_parent(concept) or concept
        return None if self.levels.home_of(concept) is None else concept + OTHER

    @cached_property
    def categories(self) -> tuple[Category, ...]:
        """All nodes: inner nodes from the root down, leaves by id, leaves `/other` of inner nodes.

        A leaf whose name another node has gets the name of its kind in brackets.
        """
        nodes, categories = self.levels.nodes, list[Category]()

        def add(node_id: str, name: str, parent: str | None, above: tuple[str, ...], **other: Any) -> None:
            path = (*(self._names(parent) if parent else ()), name)
            place: dict[str, Any] = {"parent_id": parent, "path": path, "hypernyms": above}
            categories.append(Category(node_id=node_id, name=name, synset=_synset(node_id), **place, **other))

        for node in nodes.values():
            own = {"level": node.level, "pose": node.pose, "dims": node.dims}
            aliases = self._aliases(node.node_id, node.name, ())
            add(node.node_id, node.name, node.parent_id, self._hypernyms(node.node_id), aliases=aliases, **own)
        for leaf in self.leaves.values():
            kind = nodes[leaf.parent_id]
            own = {"level": LEAF, "pose": leaf.pose or kind.pose, "dims": leaf.dims or kind.dims}
            aliases = self._aliases(leaf.node_id, leaf.name, leaf.aliases)
            add(leaf.node_id, leaf.name, kind.node_id, self._hypernyms(leaf.node_id), aliases=aliases, **own)
        for node in nodes.values():
            if (home := self.levels.home_of(node.node_id)) is not None:
                synset = _synset(node.node_id)
                # the word of a source is `lighter`, and not `lighter, match and tobacco`
                is_joined = "," in node.name or " and " in node.name
                word = node.node_id.partition(".")[0].replace("_", " ") if is_joined and synset else node.name
                above = tuple(filter(None, (synset, *self._hypernyms(node.node_id))))
                own = {"level": LEAF, "pose": node.pose, "dims": node.dims}
                add(node.node_id + OTHER, f"{word} (unspecified)", home, above, **own)
        counts = Counter(category.name.casefold() for category in categories)
        for index, category in enumerate(categories):
            if category.level == LEAF and counts[category.name.casefold()] > 1:
                name = f"{category.name} ({category.path[-2]})"
                path, aliases = (*category.path[:-1], name), (category.name, *category.aliases)
                categories[index] = replace(category, name=name, path=path, aliases=aliases)
        return tuple(categories)

    def _hypernyms(self, concept: str) -> tuple[str, ...]:
        """Return the synsets above a leaf, through the hypernyms of insertions."""
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
        excluded = {name.casefold(), *(word.casefold() for word in self._reviewed_aliases.dropped.get(node_id, ()))}
        return tuple(word for word in dict.fromkeys(words) if word.casefold() not in excluded)


@cache
def default_catalogue(directory: Path | None = None) -> Catalogue:
    """Return the catalogue of the tables that ship with the project, or of the tables in another folder.

    Raises
    ------
    BadLevels
        A table is missing or invalid.
    """
    folder = directory or taxonomy_directory()
    synsets = [row for _, row in table_rows(folder / "generated" / "synsets.csv", _SYNSETS, BadLevels)]
    words = SynsetTable(
        {row["synset"]: tuple(row["parents"].split()) for row in synsets},
        {row["synset"]: tuple(filter(None, row["lemmas"].split("; "))) for row in synsets},
    )
    leaves = []
    for place, row in table_rows(folder / "leaves.csv", _LEAVES, BadLevels):
        with in_file(place, BadLevels):
            aliases, dims = row["aliases"] and row["aliases"].split("; "), row["dims"] and parse_dims(row["dims"])
            values = row | {"aliases": aliases, "dims": dims}
            leaves.append(record_of({name: cell for name, cell in values.items() if cell}, Leaf, cells=True))
    inserted = insertions(folder / "insertions.jsonl")
    levels = frozen_levels(folder / "levels.csv")
    return Catalogue(
        levels, leaves, words, replaced_ids(folder), inserted, _labels(directory), _reviewed_aliases(folder)
    )


def _reviewed_aliases(folder: Path) -> ReviewedAliases:
    """Return the aliases of the table `aliases.csv`, which is optional.

    Raises
    ------
    BadLevels
        An action is neither `add` nor `drop`.
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
    """Return labels by node, without labels with brackets, because their word alone has another meaning."""
    labels: dict[str, dict[str, None]] = {}
    for name in sorted(set(_LABELLING_LISTS) & set(vocabularies(directory)), key=_LABELLING_LISTS.index):
        for label in vocabulary(name, directory):
            if label.node_id and "(" not in label.label:
                labels.setdefault(label.node_id, {})[label.label.strip().replace("_", " ").lower()] = None
    return {node_id: tuple(words) for node_id, words in labels.items()}


def _synset(node_id: str) -> str | None:
    return None if node_id.startswith(PREFIX) or node_id.endswith(OTHER) else node_id
