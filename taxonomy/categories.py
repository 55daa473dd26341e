"""What the taxonomy hands on: categories with a place in the tree, and the match of an item to one of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

if TYPE_CHECKING:  # its schema costs a query a tenth of its time
    from crawler.items import RawItem

__all__ = ["Category", "Match", "Pose", "Taxonomy"]

#: Ordinary pose: `upright` has its height vertical, `flat` rests on its largest face, `any` has no ordinary pose.
Pose = Literal["upright", "flat", "any"]


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
