"""The taxonomy that a release is built with: the catalogue's categories and the matcher's concepts."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

from crawler.items import STATED_KINDS, RawItem
from taxonomy.catalogue import Catalogue, default_catalogue
from taxonomy.categories import Category, Match
from taxonomy.matching.matcher import Matcher, default_matcher

__all__ = ["MatchedTaxonomy", "default_taxonomy"]


class MatchedTaxonomy:
    """A `Taxonomy`: the concept that the matcher finds, on the leaf that the catalogue gives it."""

    def __init__(self, catalogue: Catalogue, matcher: Matcher) -> None:
        self._catalogue = catalogue
        self._matcher = matcher

    def categories(self) -> Sequence[Category]:
        """All nodes, root first, parents before children; every leaf at level 5."""
        return self._catalogue.categories

    def match(self, item: RawItem) -> Match:
        """The leaf of an item; without one, the reason says whether the words or the place are missing."""
        if item.kind in STATED_KINDS and item.synset:
            return self._match(item.synset, 1.0, "the curated table names it")
        finding = self._matcher.finding(item.source, item.category_path, item.title, item.synset)
        if finding.concept is None or not finding.settled:
            return Match(None, finding.score, finding.reason)
        return self._match(finding.concept, finding.score, finding.reason)

    def _match(self, concept: str, score: float, reason: str) -> Match:
        leaf = self._catalogue.leaf_of(concept)
        return Match(leaf, score, reason if leaf else f"{reason}; {concept} has no leaf in the frozen tree")


@cache
def default_taxonomy() -> MatchedTaxonomy:
    """The taxonomy of the tables that ship with the project."""
    return MatchedTaxonomy(default_catalogue(), default_matcher())
