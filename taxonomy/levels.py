"""The frozen levels 1 to 4, and the rule that places a synset under them (docs/explanation/taxonomy.md).

A synset belongs to the nearest of its WordNet hypernyms that a kind (level 4) claims, itself first. Distance is counted
in steps over all paths, and WordNet's own order breaks a tie, so that a place depends on the synset alone and never on
what came in before it. What no kind claims waits for a reviewer.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

from metric_base.errors import InputError, expect, in_file
from metric_base.folders import taxonomy_directory
from metric_base.parsing import table_rows
from taxonomy.categories import Pose

#: Depth of the kinds, on which leaves hang, and of the leaves; the root is 1.
KIND = 4
LEAF = 5

#: Letters of the `dims` column.
DIMENSIONS = {"L": "length", "W": "width", "H": "height"}

_FILE = "levels.csv"
_COLUMNS = ("node_id", "name", "level", "parent_id", "pose", "dims", "claims")
_SUCCESSORS = ("node_id", "successor", "reason", "reviewer")


class BadLevels(InputError):
    """A table of the tree that breaks a rule: the message names file, line, expected and found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InnerNode:
    """A node of levels 1 to 4; `claims` are the synsets whose hyponyms a kind takes, its own id among them."""

    node_id: str
    name: str
    level: int
    parent_id: str | None
    pose: Pose
    dims: tuple[str, ...]
    claims: tuple[str, ...] = ()


class Levels:
    """Inner nodes, parents before children.

    Raises
    ------
    FieldError
        An id or a claim occurs twice, a parent is missing or not one level above, or there is not one root.
    """

    def __init__(self, nodes: Iterable[InnerNode]) -> None:
        self.nodes: dict[str, InnerNode] = {}
        for node in nodes:
            expect(node.node_id not in self.nodes, "node_id", "a new id", node.node_id)
            above = self.nodes[node.parent_id].level if node.parent_id in self.nodes else 0
            expect(node.level == above + 1 <= KIND, f"{node.node_id}: level", f"{above + 1}", node.level)
            self.nodes[node.node_id] = node
        roots = [node.node_id for node in self.nodes.values() if node.level == 1]
        expect(len(roots) == 1, "level", "one root", roots)
        claims = [claim for node in self.nodes.values() for claim in node.claims]
        expect(len(claims) == len(set(claims)), "claims", "each once", sorted(_duplicates(claims)))

    @cached_property
    def kinds(self) -> tuple[InnerNode, ...]:
        """Nodes of level 4."""
        return tuple(node for node in self.nodes.values() if node.level == KIND)

    @cached_property
    def claimant(self) -> Mapping[str, str]:
        """Kind by claimed synset."""
        return {claim: kind.node_id for kind in self.kinds for claim in kind.claims}

    def kind_of(self, synset: str, hypernyms: Sequence[str]) -> str | None:
        """The kind of a synset whose `hypernyms` are given nearest first; None where no kind claims any of them."""
        return next((self.claimant[above] for above in (synset, *hypernyms) if above in self.claimant), None)

    def home_of(self, node_id: str) -> str | None:
        """The kind that holds the leaf `<id>/other` of an inner node.

        That is the kind itself; for a node further up, the kind that claims it, which then holds no other such leaf.
        None where there is no such kind: items that say no more than "furniture" tell nothing of a size.
        """
        if self.nodes[node_id].level < KIND:
            return self.claimant.get(node_id)
        return None if self.unspecified_parent(node_id) in self.nodes else node_id

    def unspecified_parent(self, kind: str) -> str | None:
        """The node further up whose unspecified items a kind takes in, such as `dog.n.01` of "other dog"."""
        return next((claim for claim in self.nodes[kind].claims if claim != kind and claim in self.nodes), None)

    def path(self, node_id: str) -> tuple[str, ...]:
        """Ids from the root to an inner node."""
        parent = self.nodes[node_id].parent_id
        return (node_id,) if parent is None else (*self.path(parent), node_id)


def frozen_levels(path: Path | None = None) -> Levels:
    """The reviewed levels that ship with the project, or those of another file.

    Raises
    ------
    BadLevels
        The file breaks a rule of `Levels` or a cell is not what it must be.
    """
    file = path or taxonomy_directory() / _FILE
    with in_file(file, BadLevels):
        return Levels(_inner_nodes(file))


@cache
def replaced_ids(directory: Path | None = None) -> Mapping[str, str]:
    """Ids that are gone, or synsets that mean the same item, with the node that replaced each (`successors.csv`).

    Raises
    ------
    BadLevels
        The table cannot be read.
    """
    rows = table_rows((directory or taxonomy_directory()) / "successors.csv", _SUCCESSORS, BadLevels)
    return {row["node_id"]: row["successor"] for _, row in rows}


def _inner_nodes(file: Path) -> Iterator[InnerNode]:
    from metric_base.records import record_of  # msgspec is a tenth of what a query costs, and most ask for no node here

    for place, row in table_rows(file, _COLUMNS, BadLevels):
        cells = {"parent_id": row["parent_id"] or None, "claims": row["claims"].split()}
        with in_file(place, BadLevels):
            yield record_of(row | cells | {"dims": parse_dims(row["dims"])}, InnerNode, cells=True)


def parse_dims(letters: str) -> tuple[str, ...]:
    """Names of the dimensions of a cell such as `LH`; FieldError if it has other letters."""
    expect(bool(letters) and set(letters) <= set(DIMENSIONS), "dims", "letters of LWH", letters)
    return tuple(DIMENSIONS[letter] for letter in letters)


def _duplicates(values: Sequence[str]) -> set[str]:
    seen: set[str] = set()
    return {value for value in values if value in seen or seen.add(value)}  # type: ignore[func-returns-value]
