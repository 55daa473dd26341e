"""Raw items: objects with sizes, as stated in a page or a table (`metric-tree/raw/1`)."""

from __future__ import annotations

import gzip
import json
import math
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field, fields
from io import BufferedIOBase
from pathlib import Path
from typing import Any, Literal, get_args

import msgspec

from metric_base.errors import InputError, expect, in_file
from metric_base.records import json_record
from metric_base.regions import REGIONS
from metric_base.remote import opened, url_of

SCHEMA = "metric-tree/raw/1"
#: Maximum length of a line in bytes; the longest that ships has 1,076.
MAX_LINE = 1 << 20

#: Kind of evidence: a figure of the maker, a measurement, a row of a table of standards, a size that a standard fixes
#: for its class, a model by an artist, an object in a catalogue, a range by judgement (`curated` before release 3.0.0),
#: a default of a category.
Kind = Literal["product", "measured", "standard", "norm", "asset", "museum", "judged", "curated", "default"]
KINDS: frozenset[str] = frozenset(get_args(Kind))

#: Kinds of rows about a class: they name its node, and are not objects.
STATED_KINDS = ("norm", "judged", "curated")

#: Statistic of a row about several objects.
Statistic = Literal["mean", "median", "min", "max"]
STATISTICS: frozenset[str] = frozenset(get_args(Statistic))

#: Expectations of messages; a record checks its fields, and these are joined once.
_KINDS, _STATISTICS = (f"one of {', '.join(sorted(known))}" for known in (KINDS, STATISTICS))
_REGIONS = f"two letters of ISO 3166, or {', '.join(sorted(REGIONS))}"
#: Fields that are omitted from lines if they are None.
_OPTIONAL = frozenset({"scene", "statistic", "relative_sd", "attribution", "mass_kg", "volume_l"})


class _Head(msgspec.Struct):
    """The field of a line that is not a field of `RawItem`."""

    schema: Any = None


class BadRawItem(InputError):
    """A line is not a raw item."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RawItem:
    """An item in the words of its source."""

    source: str
    source_id: str
    url: str = ""
    title: str = ""
    category_path: tuple[str, ...] = ()
    brand: str | None = None
    dimensions_text: str | None = None
    #: Sizes by the axes of the source: length, width, height, diameter, depth.
    dimensions_mm: Mapping[str, float | None] = field(default_factory=dict)
    extents_mm: tuple[float, ...] | None = None  #: Outer size, longest first; None if the source states none.
    images: tuple[str, ...] = ()
    retrieved_at: str | None = None
    licence: str | None = None
    flags: tuple[str, ...] = ()
    kind: Kind = "product"
    year: int | None = None
    region: str | None = None
    synset: str | None = None  #: Synset that the source states (`chair.n.01`).
    count: int = 1  #: Number of identical rows of the source.
    #: Range (low, high) by axis of 90 % of the objects, for standards and judged ranges; the typical value is in
    #: `dimensions_mm`.
    ranges_mm: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    #: Room or drive of the measurement; objects of one scene are not independent.
    scene: str | None = None
    #: None for a row about one object.
    statistic: Statistic | None = None
    #: Standard deviation divided by the mean, for a statistic.
    relative_sd: float | None = None
    #: Author to name, if the source has several authors.
    attribution: str | None = None
    mass_kg: float | None = None  #: None if the source states no mass.
    volume_l: float | None = None  #: Volume or capacity, as the source defines it; None if it states none.

    def __post_init__(self) -> None:
        expect(self.kind in KINDS, "kind", _KINDS, self.kind)
        expect(self.statistic is None or self.statistic in STATISTICS, "statistic", _STATISTICS, self.statistic)
        region = self.region
        is_country = region is not None and len(region) == 2 and region.isascii() and region.isupper()
        expect(region is None or region in REGIONS or is_country, "region", _REGIONS, region)
        expect(self.year is None or abs(self.year) < 10_000, "year", "four digits at most", self.year)
        expect(bool(self.source), "source", "a name", self.source)
        expect(bool(self.source_id), "source_id", "an id", self.source_id)
        sizes = [v for v in (*self.dimensions_mm.values(), *(self.extents_mm or ())) if v is not None]
        expect(all(0 < v < math.inf for v in sizes), "dimensions_mm", "positive lengths", sizes)
        amounts = [v for v in (self.mass_kg, self.volume_l) if v is not None]
        expect(all(0 < v < math.inf for v in amounts), "mass_kg, volume_l", "positive numbers", amounts)

    @property
    def identity(self) -> str:
        """Identity of the item: its source and its id there."""
        return f"{self.source}:{self.source_id}"

    def line(self) -> str:
        """Return the JSON line of the item, without the line break."""
        record: dict[str, Any] = {"schema": SCHEMA}
        for item_field in fields(self):
            value = getattr(self, item_field.name)
            if value is None and item_field.name in _OPTIONAL:
                continue
            record[item_field.name] = dict(value) if isinstance(value, Mapping) else value
        return json.dumps(record, ensure_ascii=False)

    @classmethod
    def from_line(cls, line: str | bytes) -> RawItem:
        """Return the item of a JSON line; unknown fields are ignored.

        Raises
        ------
        FieldError
            The line is not a JSON object of this schema, or a field is invalid.
        """
        schema = json_record(line, _Head).schema
        expect(schema == SCHEMA, "schema", SCHEMA, schema)
        return json_record(line, cls)


def raw_items(path: Path) -> Iterator[RawItem]:
    """Return the items of a JSON Lines file, which may be compressed (`.gz`), in order.

    Raises
    ------
    InputError
        A line is not a raw item, or the compressed file is damaged.
    """
    yield from items_of_lines(path, raw_lines(path))


def raw_lines(path: Path) -> Iterator[bytes]:
    """Return the lines of a file of raw items, which may be compressed (`.gz`).

    Raises
    ------
    InputError
        A line is too long (`bounded_lines`), or the compressed file is damaged.
    """
    with opened(path) as packed, gzip.open(packed) if path.suffix == ".gz" else nullcontext(packed) as file:
        try:
            yield from bounded_lines(url_of(path), file)
        except (gzip.BadGzipFile, EOFError, zlib.error) as error:
            raise InputError(f"{url_of(path)}: expected gzip data; found {error}") from None


def bounded_lines(path: Path | str, file: BufferedIOBase, first: int = 1) -> Iterator[bytes]:
    """Return the lines of a file of raw items; the next one has the number `first`.

    Raises
    ------
    BadRawItem
        A line has more than `MAX_LINE` bytes; a compressed file may contain gigabytes without a line end.
    """
    number = first
    while line := file.readline(MAX_LINE):
        if len(line) == MAX_LINE and not line.endswith(b"\n"):
            raise BadRawItem(f"{path}:{number}: line: expected less than {MAX_LINE:,} bytes; found more")
        yield line
        number += 1


def items_of_lines(path: Path | str, lines: Iterable[bytes], first: int = 1) -> Iterator[RawItem]:
    """Return the items of lines of a file that begin with line number `first`; blank lines are ignored."""
    for number, line in enumerate(lines, start=first):
        if line.strip():
            with in_file(f"{path}:{number}", BadRawItem):
                item = RawItem.from_line(line)
            yield item
