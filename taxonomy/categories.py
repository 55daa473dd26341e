"""Categories of the tree, matches of items to categories, and reviewed insertions (`mt:` ids) that WordNet lacks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol

import msgspec

from metric_base.errors import InputError, expect, in_file
from metric_base.folders import taxonomy_directory
from metric_base.records import json_lines

if TYPE_CHECKING:
    from crawler.items import RawItem

#: Usual pose: height vertical (`upright`), largest face down (`flat`), or none (`any`).
Pose = Literal["upright", "flat", "any"]
#: Prefix of the ids of reviewed insertions.
PREFIX = "mt:"
_FILE = "insertions.jsonl"


@dataclass(frozen=True, slots=True, kw_only=True)
class Category:
    """A node of the tree, without items."""

    node_id: str
    name: str
    synset: str | None
    parent_id: str | None
    level: int
    path: tuple[str, ...]  #: Names from the root to the node.
    hypernyms: tuple[str, ...] = ()
    aliases: tuple[str, ...] = ()
    pose: Pose = "upright"
    dims: tuple[str, ...] = ("length", "width", "height")


@dataclass(frozen=True, slots=True)
class Match:
    """The category of an item."""

    node_id: str | None  #: Leaf, or None.
    score: float  #: 0 to 1.
    reason: str  #: Explanation for a reviewer.


class Taxonomy(Protocol):
    """Interface of a taxonomy for `metric_tree.pipeline.build`."""

    def categories(self) -> Sequence[Category]:
        """Return all nodes, root first and parents before children, with leaves at level 5."""

    def match(self, item: RawItem) -> Match:
        """Return the leaf of an item, which depends only on its source, category path, title and synset."""


class BadInsertion(InputError):
    """A line of the insertions file is invalid."""


class InsertedCategory(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A category under `parent`, a WordNet synset or an earlier insertion of the file."""

    id: str
    name: str
    parent: str
    aliases: tuple[str, ...] = ()
    pose: Pose = "upright"
    definition: str = ""

    def __post_init__(self) -> None:
        expect(self.id.startswith(PREFIX), "id", f"{PREFIX}<name>", self.id)


def insertions(path: Path | None = None) -> Mapping[str, InsertedCategory]:
    """Return all insertions by id, parents before children.

    Raises
    ------
    BadInsertion
        A line is not an insertion, repeats an id, or precedes its parent.
    """
    by_id: dict[str, InsertedCategory] = {}
    for place, insertion in json_lines(path or taxonomy_directory() / _FILE, InsertedCategory, BadInsertion):
        above = insertion.parent
        with in_file(place, BadInsertion):
            expect(insertion.id not in by_id, "id", "a new id", insertion.id)
            known = not above.startswith(PREFIX) or above in by_id
            expect(known, "parent", "a synset or an insertion above this line", above)
        by_id[insertion.id] = insertion
    return by_id
