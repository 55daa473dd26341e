"""Categories that WordNet lacks, each put under a parent by two reviewers (`mt:` ids)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from metric_base.faults import InputFault
from metric_base.folders import taxonomy_directory
from taxonomy.categories import Pose

__all__ = ["PREFIX", "BadInsertion", "Insertion", "insertions"]

#: What sets a reviewed insertion apart from a WordNet synset.
PREFIX = "mt:"

_FILE = "insertions.jsonl"
_FIELDS = {"id", "name", "parent", "aliases", "pose", "definition"}


class BadInsertion(InputFault):
    """A line of the insertions file that is not one: the message names line, field, expected and found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Insertion:
    """A category under `parent`, a WordNet synset or an insertion further up in the file."""

    id: str
    name: str
    parent: str
    aliases: tuple[str, ...] = ()
    pose: Pose = "upright"
    definition: str = ""


def insertions(path: Path | None = None) -> Mapping[str, Insertion]:
    """All insertions by id, parents before children.

    Raises
    ------
    BadInsertion
        A line is not an insertion, repeats an id, or comes before the insertion that it names as parent.
    """
    file = path or taxonomy_directory() / _FILE
    by_id: dict[str, Insertion] = {}
    for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), start=1):
        if line.strip():
            insertion = _insertion(line, where=f"{file}:{number}")
            _expect(insertion.id not in by_id, f"{file}:{number}: id", "a new id", insertion.id)
            above = insertion.parent
            known = not above.startswith(PREFIX) or above in by_id
            _expect(known, f"{file}:{number}: parent", "a synset or an insertion above this line", above)
            by_id[insertion.id] = insertion
    return by_id


def _insertion(line: str, where: str) -> Insertion:
    try:
        record: dict[str, Any] = json.loads(line)
        _expect(set(record) <= _FIELDS, f"{where}: fields", f"some of {sorted(_FIELDS)}", sorted(record))
        insertion = Insertion(**{**record, "aliases": tuple(record.get("aliases", ()))})
    except (ValueError, TypeError) as error:
        if isinstance(error, BadInsertion):
            raise
        raise BadInsertion(f"{where}: expected a JSON object with id, name and parent; found {error}") from None
    _expect(insertion.id.startswith(PREFIX), f"{where}: id", f"{PREFIX}<name>", insertion.id)
    _expect(insertion.pose in get_args(Pose), f"{where}: pose", f"one of {get_args(Pose)}", insertion.pose)
    return insertion


def _expect(holds: bool, name: str, expected: str, found: object) -> None:
    if not holds:
        raise BadInsertion(f"{name}: expected {expected}; found {found!r}")
