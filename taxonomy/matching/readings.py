"""Readings of sources: their domain, and which of their words name the item."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import msgspec

from metric_base.errors import InputError, at_field, expect, in_file
from metric_base.folders import taxonomy_directory
from metric_base.records import record_of, toml_table
from taxonomy.matching.sense_choice import DOMAINS

#: Words that name the item: the last element of the category path (`last`), the path as one name (`path`: `coin 25
#: cents`), the first known word of the last element, separated by commas (`alternatives`), or the title, then the last
#: element (`title, last`). The title if the path is empty.
Words = Literal["last", "path", "alternatives", "title, last"]

_FILE = "readings.toml"
#: Key of the reading of all other sources.
DEFAULT = "default"


class BadReading(InputError):
    """The readings file is invalid."""


class Reading(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Reading of a source."""

    domain: str = "shop"
    words: Words = "last"
    classes: Mapping[str, str] = {}  #: Concepts by first path element (all `paintings` of a museum).
    whole: bool = False  #: Only complete names, because the last word of breeds and species has little information.
    refined: bool = False  #: The title may narrow the category (a `lamp` whose title begins with `floor lamp`).

    def __post_init__(self) -> None:
        expect(self.domain in DOMAINS, "domain", f"one of {', '.join(sorted(DOMAINS))}", self.domain)


def readings(path: Path | None = None) -> Mapping[str, Reading]:
    """Return readings by source, and that of all other sources as `DEFAULT`, of the project or of another file.

    Raises
    ------
    BadReading
        A field, domain or value is unknown.
    """
    file = path or taxonomy_directory() / _FILE
    by_source = {DEFAULT: Reading()}
    with in_file(file, BadReading):
        for source, record in toml_table(file, BadReading).items():
            with at_field(f"{source}:"):
                by_source[source] = record_of(record, Reading)
    return by_source
