"""What the taxonomy hands on: categories with a place in the tree, and the match of an item to one of them.

Categories that WordNet lacks, each put under a parent by two reviewers (`mt:` ids).
"""

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

#: Ordinary pose: `upright` has its height vertical, `flat` rests on its largest face, `any` has no ordinary pose.
Pose = Literal["upright", "flat", "any"]
#: What sets a reviewed insertion apart from a WordNet synset.
PREFIX = "mt:"
_FILE = "insertions.jsonl"


@dataclass(frozen=True, slots=True, kw_only=True)
class Category:
    """A node of the tree, before any item hangs on it; `path` holds the names from the root to it."""

    node_id: str
    name: str
    synset: str | None
    parent_id: str | None
    level: int
    path: tuple[str, ...]
    hypernyms: tuple[str, ...] = ()
    aliases: tuple[str, ...] = ()
    pose: Pose = "upright"
    dims: tuple[str, ...] = ("length", "width", "height")


@dataclass(frozen=True, slots=True)
class Match:
    """The category of an item: `node_id` of a leaf, or None; `score` 0 to 1; `reason` for a reviewer."""

    node_id: str | None
    score: float
    reason: str


class Taxonomy(Protocol):
    """What `metric_tree.pipeline.build` asks of a taxonomy."""

    def categories(self) -> Sequence[Category]:
        """All nodes, root first, parents before children; every leaf at level 5."""

    def match(self, item: RawItem) -> Match:
        """The leaf of an item; depends only on its source, category path, title and synset."""


class BadInsertion(InputError):
    """A line of the insertions file that is not one: the message names line, field, expected and found."""


class InsertedCategory(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A category under `parent`, a WordNet synset or an insertion further up in the file."""

    id: str
    name: str
    parent: str
    aliases: tuple[str, ...] = ()
    pose: Pose = "upright"
    definition: str = ""

    def __post_init__(self) -> None:
        expect(self.id.startswith(PREFIX), "id", f"{PREFIX}<name>", self.id)


def insertions(path: Path | None = None) -> Mapping[str, InsertedCategory]:
    """All insertions by id, parents before children.

    Raises
    ------
    BadInsertion
        A line is not an insertion, repeats an id, or comes before the insertion that it names as parent.
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
