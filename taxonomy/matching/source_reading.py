"""How each source's own words are read: which of them name the thing, and of what domain the source speaks."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Literal, get_args

from metric_base.faults import InputFault
from metric_base.folders import taxonomy_directory
from taxonomy.matching.senses import DOMAINS

__all__ = ["BadReading", "Reading", "Words", "default_readings", "reading_of", "readings"]

#: `last` the last element of the category path; `path` all of it as one name (`coin 25 cents`); `alternatives` the
#: words of its last element between commas, of which the first known counts; `title, last` the title, then the path.
#: Where the path is empty, the title speaks.
Words = Literal["last", "path", "alternatives", "title, last"]

_FILE = "readings.toml"
_DEFAULT = "default"


class BadReading(InputFault):
    """The readings file is not what it must be: the message names source, field, expected and found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """`classes` gives a concept to a first path element as a whole (all of a museum's `paintings`).

    `whole` asks for names that are known as a whole: where a breed's or a species' head word says little.
    `refined` lets the title make the category narrower (a `lamp` whose title begins `floor lamp`).
    """

    domain: str = "shop"
    words: Words = "last"
    classes: Mapping[str, str] = field(default_factory=dict)
    whole: bool = False
    refined: bool = False


def readings(path: Path | None = None) -> Mapping[str, Reading]:
    """Readings by source; `default` serves the sources that the file does not name.

    Raises
    ------
    BadReading
        An unknown field, domain or word.
    """
    file = path or taxonomy_directory() / _FILE
    table = tomllib.loads(file.read_text(encoding="utf-8"))
    found = {}
    for source, record in table.items():
        try:
            found[source] = Reading(**record)
        except TypeError as error:
            raise BadReading(f"{file}: {source}: expected the fields of a reading; found {error}") from None
        _expect(found[source].domain in DOMAINS, f"{file}: {source}: domain", sorted(DOMAINS), found[source].domain)
        _expect(
            found[source].words in get_args(Words), f"{file}: {source}: words", get_args(Words), found[source].words
        )
    return {_DEFAULT: Reading()} | found


def reading_of(source: str, table: Mapping[str, Reading]) -> Reading:
    """The reading of a source, the default one where it has none."""
    return table.get(source) or table[_DEFAULT]


@cache
def default_readings() -> Mapping[str, Reading]:
    """The readings of this checkout, read once."""
    return readings()


def _expect(holds: bool, name: str, expected: object, found: object) -> None:
    if not holds:
        raise BadReading(f"{name}: expected one of {expected}; found {found!r}")
