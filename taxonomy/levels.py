"""Frozen levels 1 to 4 of the tree, and the rule that assigns synsets to them (docs/explanation/taxonomy.md).

A synset belongs to the kind (level 4) that claims it or the nearest of its WordNet hypernyms. The distance is the
number of steps over all paths; the order of WordNet breaks ties. The result therefore depends on the synset only, and
not on earlier items. A reviewer assigns synsets that no kind claims.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

from metric_base.errors import InputError, expect, in_file
from metric_base.folders import taxonomy_directory
from metric_base.parsing import table_rows
from taxonomy.categories import Pose

#: Level of the kinds, the parents of leaves; the root has level 1.
KIND = 4
#: Level of the leaves.
LEAF = 5

#: Letters of the `dims` column.
DIMENSIONS = {"L": "length", "W": "width", "H": "height"}

_FILE = "levels.csv"
_COLUMNS = ("node_id", "name", "level", "parent_id", "pose", "dims", "claims")
_SUCCESSORS = ("node_id", "successor", "reason", "reviewer")


class BadLevels(InputError):
    """A table of the tree is invalid."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InnerNode:
    """A node of levels 1 to 4."""

    node_id: str
    name: str
    level: int
    parent_id: str | None
    pose: Pose
    dims: tuple[str, ...]
    claims: tuple[str, ...] = ()  #: Synsets whose hyponyms belong to the kind, with its id.


class Levels:
    """Inner nodes, parents before children.

    Raises
    ------
    FieldError
        An id or a claim occurs twice, a parent is missing or not one level above, or the number of roots is not 1.
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
        counts = Counter(claim for node in self.nodes.values() for claim in node.claims)
        repeated = sorted(claim for claim, count in counts.items() if count > 1)
        expect(not repeated, "claims", "each once", repeated)

    @cached_property
    def kinds(self) -> tuple[InnerNode, ...]:
        """Nodes of level 4."""
        return tuple(node for node in self.nodes.values() if node.level == KIND)

    @cached_property
    def claimant(self) -> Mapping[str, str]:
        """Kind by claimed synset."""
        return {claim: kind.node_id for kind in self.kinds for claim in kind.claims}

    def home_of(self, node_id: str) -> str | None:
        """Return the kind that contains the leaf `<id>/other` of an inner node.

        For a kind it is the kind; for a node above, it is the kind that claims it and that then has no other such leaf.
        None if there is no such kind: the size of "furniture" is undetermined.
        """
        if self.nodes[node_id].level < KIND:
            return self.claimant.get(node_id)
        return None if self.unspecified_parent(node_id) in self.nodes else node_id

    def unspecified_parent(self, kind: str) -> str | None:
        """Return the node above whose unspecified items a kind contains (`dog.n.01` for "other dog"), or None."""
        return next((claim for claim in self.nodes[kind].claims if claim != kind and claim in self.nodes), None)

    def path(self, node_id: str) -> tuple[str, ...]:
        """Return the ids from the root to an inner node."""
        parent = self.nodes[node_id].parent_id
        return (node_id,) if parent is None else (*self.path(parent), node_id)


def frozen_levels(path: Path | None = None) -> Levels:
    """Return the reviewed levels that ship with the project, or the levels of another file.

    Raises
    ------
    BadLevels
        A cell is invalid, or the nodes do not form levels (see `Levels`).
    """
    from metric_base.records import record_of  # importing msgspec takes a tenth of a query, and most need no levels

    file = path or taxonomy_directory() / _FILE
    nodes = []
    with in_file(file, BadLevels):
        for place, row in table_rows(file, _COLUMNS, BadLevels):
            cells = {"parent_id": row["parent_id"] or None, "claims": row["claims"].split()}
            with in_file(place, BadLevels):
                nodes.append(record_of(row | cells | {"dims": parse_dims(row["dims"])}, InnerNode, cells=True))
        return Levels(nodes)


@cache
def replaced_ids(directory: Path | None = None) -> Mapping[str, str]:
    """Return the nodes that replace removed ids, or synonymous synsets (`successors.csv`).

    Raises
    ------
    BadLevels
        The table is missing or invalid.
    """
    rows = table_rows((directory or taxonomy_directory()) / "successors.csv", _SUCCESSORS, BadLevels)
    return {row["node_id"]: row["successor"] for _, row in rows}


def parse_dims(letters: str) -> tuple[str, ...]:
    """Return the dimensions of a cell such as `LH`; FieldError if it contains other letters."""
    expect(bool(letters) and set(letters) <= set(DIMENSIONS), "dims", "letters of LWH", letters)
    return tuple(DIMENSIONS[letter] for letter in letters)
