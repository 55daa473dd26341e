"""Categories that WordNet lacks, each put under a parent by two reviewers (`mt:` ids)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import msgspec

from metric_base.errors import InputError, in_file
from metric_base.folders import taxonomy_directory
from metric_base.records import expect, json_lines
from taxonomy.categories import Pose

__all__ = ["PREFIX", "BadInsertion", "InsertedCategory", "insertions"]

#: What sets a reviewed insertion apart from a WordNet synset.
PREFIX = "mt:"

_FILE = "insertions.jsonl"


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
