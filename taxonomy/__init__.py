"""Naming: WordNet, matching, proofreading and the five levels."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from taxonomy.categories import Taxonomy

__all__ = ["default_taxonomy"]


def default_taxonomy() -> Taxonomy:
    """The taxonomy of the tables that ship with the project; the matcher is loaded here, not before."""
    from taxonomy.matching.matcher import default_taxonomy as shipped

    return shipped()
