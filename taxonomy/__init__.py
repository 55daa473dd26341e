"""Categories and names: WordNet, the five levels, matching of items, and names in queries."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from taxonomy.categories import Taxonomy

__all__ = ["default_taxonomy"]


def default_taxonomy() -> Taxonomy:
    """Return the taxonomy of the tables that ship with the project; only this function loads the matcher."""
    from taxonomy.matching.matcher import default_taxonomy as shipped

    return shipped()
