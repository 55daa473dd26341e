"""How each source's own words are read: which of them name the item, and of what domain the source speaks."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Literal

import msgspec

from metric_base.errors import InputError, at_field, expect, in_file
from metric_base.folders import taxonomy_directory
from metric_base.records import record_of, toml_table
from taxonomy.matching.sense_choice import DOMAINS

#: `last` the last element of the category path; `path` all of it as one name (`coin 25 cents`); `alternatives` the
#: words of its last element between commas, of which the first known counts; `title, last` the title, then the path.
#: Where the path is empty, the title speaks.
Words = Literal["last", "path", "alternatives", "title, last"]

_FILE = "readings.toml"
_DEFAULT = "default"


class BadReading(InputError):
    """The readings file is not what it must be: the message names source, field, expected and found."""


class Reading(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """`classes` gives a concept to a first path element as a whole (all of a museum's `paintings`).

    `whole` asks for names that are known as a whole: where a breed's or a species' head word says little.
    `refined` lets the title make the category narrower (a `lamp` whose title begins `floor lamp`).
    """

    domain: str = "shop"
    words: Words = "last"
    classes: Mapping[str, str] = {}
    whole: bool = False
    refined: bool = False

    def __post_init__(self) -> None:
        if self.domain == "things":
            warnings.warn("the domain 'things' is called 'objects'", DeprecationWarning, stacklevel=2)
            msgspec.structs.force_setattr(self, "domain", "objects")
        expect(self.domain in DOMAINS, "domain", f"one of {', '.join(sorted(DOMAINS))}", self.domain)


def readings(path: Path | None = None) -> Mapping[str, Reading]:
    """Readings by source; `default` serves the sources that the file does not name.

    Raises
    ------
    BadReading
        An unknown field, domain or word.
    """
    file = path or taxonomy_directory() / _FILE
    by_source = {_DEFAULT: Reading()}
    with in_file(file, BadReading):
        for source, record in toml_table(file, BadReading).items():
            with at_field(f"{source}:"):
                by_source[source] = record_of(record, Reading)
    return by_source


def reading_of(source: str, table: Mapping[str, Reading]) -> Reading:
    """The reading of a source, the default one where it has none."""
    return table.get(source) or table[_DEFAULT]


@cache
def default_readings() -> Mapping[str, Reading]:
    """The readings of this checkout, read once."""
    return readings()
