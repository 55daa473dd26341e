"""The categories of the tree: frozen inner nodes, reviewed leaves, and what WordNet says of both.

Everything is read from tables that ship with the project, so that a release can be rebuilt to the byte, and a tree
queried, where there is no WordNet.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Protocol, get_args

from taxonomy.categories import Category, Pose
from taxonomy.levels import KIND, LEAF, BadLevels, InnerNode, Levels, dims_of, frozen_levels, table_rows
from taxonomy.places import taxonomy_directory

__all__ = ["OTHER", "Catalogue", "Hypernyms", "Leaf", "SynsetTable", "default_catalogue"]

#: Ends the id of a leaf that holds what a source names no closer than an inner node.
OTHER = "/other"

_LEAVES = ("node_id", "name", "parent_id", "hypernym", "pose", "dims", "aliases", "placed_by")
_SYNSETS = ("synset", "parents", "lemmas")
_SUCCESSORS = ("node_id", "successor", "reason", "reader")


class Hypernyms(Protocol):
    """What the catalogue asks of WordNet (`taxonomy.wordnet.WordNet`, or a `SynsetTable`)."""

    def hypernyms(self, synset: str) -> tuple[str, ...]:
        """All synsets above it, nearest first, each once; not the synset itself."""

    def lemmas(self, synset: str) -> tuple[str, ...]:
        """Words of the synset, with spaces."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaf:
    """A leaf under its kind; `hypernym` is where a reader put an insertion; pose and dims only where they differ."""

    node_id: str
    name: str
    parent_id: str
    hypernym: str | None = None
    pose: Pose | None = None
    dims: tuple[str, ...] | None = None
    aliases: tuple[str, ...] = ()
    #: `rule` (the nearest kind) or `reader`.
    placed_by: str = "rule"


class SynsetTable:
    """Parents and words of the synsets that the tree uses, from `synsets.csv`: an extract of WordNet 3.0."""

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
    successors : ids that are gone, or synsets that mean the same thing, and the node that stands for them.
    """

    def __init__(
        self, levels: Levels, leaves: Iterable[Leaf], words: Hypernyms, successors: Mapping[str, str] | None = None
    ) -> None:
        self.levels = levels
        self.leaves = {leaf.node_id: leaf for leaf in sorted(leaves, key=lambda leaf: leaf.node_id)}
        self.successors = dict(successors or {})
        self._words = words
        for leaf in self.leaves.values():
            if leaf.parent_id not in {kind.node_id for kind in levels.kinds} or leaf.node_id in levels.nodes:
                raise BadLevels(f"leaf {leaf.node_id}: expected a new id under a kind; found {leaf.parent_id!r}")

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
            concept = self.levels.unnamed(concept) or concept
        return None if self.levels.home_of(concept) is None else concept + OTHER

    def placed(self, concepts: Mapping[str, str | None], names: Mapping[str, str], words: Hypernyms) -> Catalogue:
        """The catalogue with further leaves by the rule.

        Parameters
        ----------
        concepts : synsets, and insertions with the synset that a reader put them under.
        names : what to call an insertion.
        words : WordNet, for synsets that the tree has not used.
        """
        fresh = []
        for concept, above in sorted(concepts.items()):
            if self.leaf_of(concept) is None and concept not in self.levels.nodes:
                start = above or concept
                kind = self.levels.kind_of(start, words.hypernyms(start))
                if kind is not None:
                    name = names.get(concept) or words.lemmas(concept)[0]
                    fresh.append(Leaf(node_id=concept, name=name, parent_id=kind, hypernym=above))
        return Catalogue(self.levels, (*self.leaves.values(), *fresh), _Both(self._words, words), self.successors)

    @cached_property
    def categories(self) -> tuple[Category, ...]:
        """All nodes, root first and parents before children, leaves in the order of their ids."""
        inner = [self._inner(node) for node in self.levels.nodes.values()]
        home = {node.node_id: self.levels.home_of(node.node_id) for node in self.levels.nodes.values()}
        other = [self._other(node, kind) for node in self.levels.nodes.values() if (kind := home[node.node_id])]
        leaves = [self._leaf(leaf) for leaf in self.leaves.values()]
        return (*inner, *_named_apart([*inner, *leaves, *other])[len(inner) :])

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
        above = leaf.hypernym
        return Category(
            node_id=leaf.node_id,
            name=leaf.name,
            synset=_synset(leaf.node_id),
            parent_id=kind.node_id,
            level=LEAF,
            path=(*self._names(kind.node_id), leaf.name),
            hypernyms=(above, *self._words.hypernyms(above)) if above else self._words.hypernyms(leaf.node_id),
            aliases=self._aliases(leaf.node_id, leaf.name, leaf.aliases),
            pose=leaf.pose or kind.pose,
            dims=leaf.dims or kind.dims,
        )

    def _other(self, node: InnerNode, kind: str) -> Category:
        name = f"{node.name} (unspecified)"
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

    def _names(self, node_id: str) -> tuple[str, ...]:
        return tuple(self.levels.nodes[above].name for above in self.levels.path(node_id))

    def _aliases(self, node_id: str, name: str, further: tuple[str, ...]) -> tuple[str, ...]:
        merged = (word for old, new in self.successors.items() if new == node_id for word in self._words.lemmas(old))
        words = (*self._words.lemmas(node_id), *further, *merged)
        return tuple(word for word in dict.fromkeys(words) if word.casefold() != name.casefold())


class _Both:
    """Two sources of words, the first before the second."""

    def __init__(self, first: Hypernyms, second: Hypernyms) -> None:
        self._sources = (first, second)

    def hypernyms(self, synset: str) -> tuple[str, ...]:
        return self._sources[0].hypernyms(synset) or self._further(synset, "hypernyms")

    def lemmas(self, synset: str) -> tuple[str, ...]:
        return self._sources[0].lemmas(synset) or self._further(synset, "lemmas")

    def _further(self, synset: str, what: str) -> tuple[str, ...]:
        if _synset(synset) is None:
            return ()
        found: tuple[str, ...] = getattr(self._sources[1], what)(synset)
        return found


@cache
def default_catalogue(directory: Path | None = None) -> Catalogue:
    """The catalogue of the tables that ship with the project, or of those in another folder.

    Raises
    ------
    BadLevels
        A table is missing or breaks a rule.
    """
    folder = directory or taxonomy_directory()
    synsets = [row for _, row in table_rows(folder / "synsets.csv", _SYNSETS)]
    words = SynsetTable(
        {row["synset"]: tuple(row["parents"].split()) for row in synsets},
        {row["synset"]: tuple(filter(None, row["lemmas"].split("; "))) for row in synsets},
    )
    leaves = [_leaf(row, where) for where, row in table_rows(folder / "leaves.csv", _LEAVES)]
    gone = {row["node_id"]: row["successor"] for _, row in table_rows(folder / "successors.csv", _SUCCESSORS)}
    return Catalogue(frozen_levels(folder / "levels.csv"), leaves, words, gone)


def _leaf(row: dict[str, str], where: str) -> Leaf:
    pose = row["pose"] or None
    if pose is not None and pose not in get_args(Pose):
        raise BadLevels(f"{where}: pose: expected one of {get_args(Pose)}; found {pose!r}")
    return Leaf(
        node_id=row["node_id"],
        name=row["name"],
        parent_id=row["parent_id"],
        hypernym=row["hypernym"] or None,
        pose=pose,  # type: ignore[arg-type]  # checked above
        dims=dims_of(row["dims"], where) if row["dims"] else None,
        aliases=tuple(filter(None, row["aliases"].split("; "))),
        placed_by=row["placed_by"],
    )


def _synset(node_id: str) -> str | None:
    return None if node_id.startswith("mt:") or node_id.endswith(OTHER) else node_id


def _named_apart(categories: list[Category]) -> list[Category]:
    """Categories whose names differ: a leaf that shares its name says in brackets what kind of thing it is."""
    bearers: dict[str, list[str]] = {}
    for category in categories:
        bearers.setdefault(category.name.casefold(), []).append(category.node_id)
    return [_apart(c) if c.level == LEAF and len(bearers[c.name.casefold()]) > 1 else c for c in categories]


def _apart(category: Category) -> Category:
    name = f"{category.name} ({category.path[-2]})"
    return replace(category, name=name, path=(*category.path[:-1], name), aliases=(category.name, *category.aliases))
