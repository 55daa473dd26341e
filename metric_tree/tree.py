"""The tree of a release, as a program asks it: names, nodes, items, pictures, priors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow as pa

from metric_base.faults import InputFault
from metric_tree.names import NameIndex
from metric_tree.prior import Prior
from metric_tree.release import Release, open_release
from metric_tree.releases import release_directory

__all__ = ["AmbiguousName", "NoPrior", "Node", "Tree", "UnknownName", "open_tree"]

#: Of several nodes that bear a name, one is meant without saying so if it has ten times the items.
DOMINANCE = 10


class UnknownName(InputFault, KeyError):
    """A name that no node bears; the message names the nearest."""

    def __str__(self) -> str:
        return str(self.args[0])


class AmbiguousName(UnknownName):
    """A name that several nodes bear; the message lists them."""


class NoPrior(UnknownName):
    """Dimensions for which a node has no prior; the message names what exists."""


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """A category of the tree. `path` holds names from the root; `level` is 1 at the root and 5 at a leaf."""

    tree: Tree
    node_id: str
    name: str
    synset: str | None
    parent_id: str | None
    level: int
    path: tuple[str, ...]
    hypernyms: tuple[str, ...]
    aliases: tuple[str, ...]
    pose: str
    dims: tuple[str, ...]
    n_items: int
    n_own: int

    def __repr__(self) -> str:
        return f"<Node {self.node_id}: {' > '.join(self.path)}>"

    @property
    def parent(self) -> Node | None:
        """The node above, None at the root."""
        return None if self.parent_id is None else self.tree.node(self.parent_id)

    @property
    def children(self) -> tuple[Node, ...]:
        """The nodes right below."""
        return self.tree.children(self.node_id)

    def descendants(self) -> Iterator[Node]:
        """The node itself and all below it, parents first."""
        yield self
        for child in self.children:
            yield from child.descendants()

    def items(self) -> pa.Table:
        """The shipped items at or below this node (`metric_tree.schema.ITEMS`)."""
        return self._rows("items")

    def images(self) -> pa.Table:
        """The pictures of items at or below this node (`metric_tree.schema.IMAGES`)."""
        return self._rows("images")

    @property
    def prior_dims(self) -> tuple[tuple[str, ...], ...]:
        """The sets of dimensions that have a fitted row of their own."""
        return self.tree.prior_dims(self.node_id)

    def prior(self, dims: Sequence[str] | None = None) -> Prior:
        """The size prior over `dims` (`node.dims` by default), in that order.

        It is the exact row, else the marginal of the smallest row that contains them. One name may stand alone.

        Raises
        ------
        NoPrior
            No row contains them.
        """
        if isinstance(dims, str):  # a sequence of letters, which nobody means
            dims = (dims,)
        return self.tree.prior(self.node_id, tuple(dims) if dims is not None else self.dims)

    def _rows(self, table: str) -> pa.Table:
        return self.tree.release.table(table, {node.node_id for node in self.descendants()})


class Tree:
    """A release in memory: a node, priors and items are read when they are asked for."""

    def __init__(self, release: Release) -> None:
        self.release = release
        self._table = release.table("nodes")
        self._places = {node_id: place for place, node_id in enumerate(self._table["node_id"].to_pylist())}
        self._nodes: dict[str, Node] = {}

    def __repr__(self) -> str:
        return f"<Tree {self.name} {self.version}: {len(self)} nodes>"

    def __iter__(self) -> Iterator[Node]:
        if len(self._nodes) < len(self):  # all at once, where one by one takes ten times as long
            for row in self._table.to_pylist():
                self._nodes.setdefault(row["node_id"], _node(self, row))
        return (self._nodes[node_id] for node_id in self._places)

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, name: object) -> bool:
        """Whether `find` answers a name; a node is asked for by its id."""
        if isinstance(name, Node):
            return name.node_id in self._places
        return isinstance(name, str) and (name in self._places or _meant(self._bearers(name)) is not None)

    @property
    def name(self) -> str:
        """The release's name."""
        return str(self.release.manifest["name"])

    @property
    def version(self) -> str:
        """The release's semantic version."""
        return str(self.release.manifest["version"])

    @property
    def root(self) -> Node:
        """The one node of level 1."""
        return self.node(self._below[None][0])

    def leaves(self) -> tuple[Node, ...]:
        """The nodes without children."""
        return tuple(node for node in self if node.node_id not in self._below)

    def node(self, node_id: str) -> Node:
        """The node of an id; UnknownName where there is none."""
        if node_id not in self._places:
            raise UnknownName(f"{node_id}: no node has this id")
        if node_id not in self._nodes:
            (row,) = self._table.slice(self._places[node_id], 1).to_pylist()
            self._nodes.setdefault(node_id, _node(self, row))
        return self._nodes[node_id]

    def children(self, node_id: str) -> tuple[Node, ...]:
        """The nodes right below a node."""
        return tuple(self.node(child) for child in self._below.get(node_id, ()))

    def find(self, name: str, vocabulary: str | None = None) -> Node:
        """The node that a name means: an id, synset, name, alias or detector label.

        Case, `_`, `-` and plurals are folded. With `vocabulary` the name is read as that label list does.

        Raises
        ------
        UnknownName
            No node bears it.
        AmbiguousName
            Several do, and none of them has ten times the items of the next.
        """
        if not isinstance(name, str):
            raise UnknownName(f"name: expected a name; found {name!r}")
        if vocabulary is not None:
            return self.node(_labelled(name, vocabulary, self._bearer_ids))
        if name in self._places:
            return self.node(name)
        found = self._bearers(name)
        if not found:
            nearest = ", ".join(self._index.nearest(name)) or "nothing like it"
            raise UnknownName(f"{name!r}: no node bears this name; nearest: {nearest}")
        meant = _meant(found)
        if meant is None:
            candidates = ", ".join(f"{node.node_id} ({node.n_items} items)" for node in found)
            raise AmbiguousName(f"{name!r}: several nodes bear this name: {candidates}")
        return meant

    def _bearers(self, name: str) -> list[Node]:
        """The nodes that bear a name, those of most items first."""
        return sorted(map(self.node, self._bearer_ids(name)), key=lambda node: -node.n_items)

    def _bearer_ids(self, name: str) -> tuple[str, ...]:
        return self._index.ids(name)  # a method, so that who hands it on does not build the index

    def prior_dims(self, node_id: str) -> tuple[tuple[str, ...], ...]:
        """The sets of dimensions for which a node has a fitted row."""
        return tuple(dims for dims, _ in self._prior_rows.get(node_id, ()))

    def prior(self, node_id: str, dims: tuple[str, ...]) -> Prior:
        """The prior of a node over `dims`; see `Node.prior`."""
        key = (node_id, dims)
        if key not in self._priors:
            self._priors[key] = self._read_prior(node_id, dims)
        return self._priors[key]

    def _read_prior(self, node_id: str, dims: tuple[str, ...]) -> Prior:
        rows = self._prior_rows.get(node_id, [])
        containing = [(len(had), row) for had, row in rows if set(dims) <= set(had)]
        if not containing or not dims:
            exists = "; ".join(", ".join(had) for had, _ in rows) or "none"
            wanted = ", ".join(dims) or "no dimension"
            raise NoPrior(f"{node_id}: dims: expected a prior that holds {wanted}; found {exists}")
        prior: Prior = Prior.of_row(self._prior_table.slice(min(containing)[1], 1).to_pylist()[0])
        return prior if prior.dims == dims else prior.marginal(dims)

    @cached_property
    def _priors(self) -> dict[tuple[str, tuple[str, ...]], Prior]:
        return {}

    @cached_property
    def _prior_table(self) -> pa.Table:
        return self.release.table("priors")

    @cached_property
    def _prior_rows(self) -> dict[str, list[tuple[tuple[str, ...], int]]]:
        table = self._prior_table.select(["node_id", "dims"]).to_pydict()
        rows: dict[str, list[tuple[tuple[str, ...], int]]] = {}
        for number, (node_id, dims) in enumerate(zip(table["node_id"], table["dims"], strict=True)):
            rows.setdefault(node_id, []).append((tuple(dims), number))
        return rows

    @cached_property
    def _below(self) -> dict[str | None, list[str]]:
        """Ids of the nodes right below each; those of no parent under None."""
        parents = self._table["parent_id"].to_pylist()
        below: dict[str | None, list[str]] = {}
        for node_id, place in self._places.items():
            below.setdefault(parents[place], []).append(node_id)
        return below

    @cached_property
    def _index(self) -> NameIndex:
        columns = self._table.select(["node_id", "name", "aliases", "synset"]).to_pydict().values()
        return NameIndex(
            (node_id, (name, *(aliases or ()), *([synset] if synset else [])))
            for node_id, name, aliases, synset in zip(*columns, strict=True)
        )


def open_tree(ref: str | Path | None = None) -> Tree:
    """The tree of a release: the shipped one, or that of an available version, or of a folder.

    Raises
    ------
    metric_tree.release.BadRelease
        There is none, or it is damaged, or of a schema that this version does not read.
    """
    return Tree(open_release(release_directory(ref)))


def _node(tree: Tree, row: dict[str, Any]) -> Node:
    lists = {name: tuple(row[name] or ()) for name in ("path", "hypernyms", "aliases", "dims")}
    return Node(tree=tree, **{**{name: row[name] for name in row if name in Node.__dataclass_fields__}, **lists})


def _meant(found: Sequence[Node]) -> Node | None:
    """Of the nodes that bear a name, most items first, the one that is meant without saying so."""
    if not found or (len(found) > 1 and found[0].n_items < DOMINANCE * max(found[1].n_items, 1)):
        return None
    return found[0]


def _labelled(name: str, vocabulary: str, meant: Callable[[str], Sequence[str]]) -> str:
    from taxonomy.label_lists import labelled_node  # read only where a list is named

    node_id: str = labelled_node(name, vocabulary, meant)
    return node_id
