"""A raw item: one object with a size, as its page or table states it (`metric-tree/raw/1`)."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from io import BufferedIOBase
from pathlib import Path
from typing import Any, Literal, get_args

from metric_base.errors import InputError, expect, in_file
from metric_base.records import json_record, record_of
from metric_base.regions import REGIONS

SCHEMA = "metric-tree/raw/1"
#: Bytes of a line; the longest that ships has 1,076.
MAX_LINE = 1 << 20

#: What a row is worth as evidence: a maker's figure, a measurement, a row of a table of norms, a size that a norm
#: fixes for its whole class, an artist's model, a catalogued object, a judged range (`curated` before release 3.0.0), a
#: category value.
Kind = Literal["product", "measured", "standard", "norm", "asset", "museum", "judged", "curated", "default"]
KINDS: frozenset[str] = frozenset(get_args(Kind))

#: Kinds of rows that state the sizes of a whole class: they name its node, and are no objects.
STATED_KINDS = ("norm", "judged", "curated")

#: What a row about many objects states of them; a row without it is an object.
Statistic = Literal["mean", "median", "min", "max"]
STATISTICS: frozenset[str] = frozenset(get_args(Statistic))

#: Fields that a line holds only where they are set.
_OPTIONAL = frozenset({"scene", "statistic", "relative_sd", "attribution"})


class BadRawItem(InputError):
    """A line that is not a raw item: the message names the field, what was expected and what was found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RawItem:
    """One item in the words of its source.

    `dimensions_mm` keeps the page's own axis names (length, width, height, diameter, depth); `extents_mm` is
    the outer size, longest first, or None where the source states none.
    """

    source: str
    source_id: str
    url: str = ""
    title: str = ""
    category_path: tuple[str, ...] = ()
    brand: str | None = None
    dimensions_text: str | None = None
    dimensions_mm: Mapping[str, float | None] = field(default_factory=dict)
    extents_mm: tuple[float, ...] | None = None
    images: tuple[str, ...] = ()
    retrieved_at: str | None = None
    licence: str | None = None
    flags: tuple[str, ...] = ()
    kind: Kind = "product"
    year: int | None = None
    region: str | None = None
    #: A synset that the source itself names (`chair.n.01`), where it does.
    synset: str | None = None
    #: How many physical rows of the source this item is (identical rows collapsed at import).
    count: int = 1
    #: Of a norm or a judged range, by axis word: the (low, high) that holds nine of ten such objects; the typical value
    #: is in `dimensions_mm`.
    ranges_mm: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    #: The room or drive in which the object was measured: objects of one scene are not independent.
    scene: str | None = None
    #: What a row about many objects states of them; None for a row about one object.
    statistic: Statistic | None = None
    #: Of a statistic: standard deviation over mean of the objects that it is about.
    relative_sd: float | None = None
    #: Whom to name for this item, where the source has many authors.
    attribution: str | None = None

    def __post_init__(self) -> None:
        expect(self.kind in KINDS, "kind", f"one of {', '.join(sorted(KINDS))}", self.kind)
        expect(
            self.statistic in {None, *STATISTICS},
            "statistic",
            f"one of {', '.join(sorted(STATISTICS))}",
            self.statistic,
        )
        expect(
            _is_region(self.region), "region", f"two letters of ISO 3166, or {', '.join(sorted(REGIONS))}", self.region
        )
        expect(self.year is None or abs(self.year) < 10_000, "year", "four digits at most", self.year)
        expect(bool(self.source), "source", "a name", self.source)
        expect(bool(self.source_id), "source_id", "an id", self.source_id)
        sizes = [v for v in (*self.dimensions_mm.values(), *(self.extents_mm or ())) if v is not None]
        expect(all(math.isfinite(v) and v > 0 for v in sizes), "dimensions_mm", "positive lengths", sizes)

    @property
    def identity(self) -> str:
        """What makes the item one: its source and the source's own id."""
        return f"{self.source}:{self.source_id}"

    def line(self) -> str:
        """The item as one JSON line, without the line break."""
        record: dict[str, Any] = {"schema": SCHEMA}
        for item_field in fields(self):
            value = getattr(self, item_field.name)
            if value is None and item_field.name in _OPTIONAL:
                continue
            record[item_field.name] = dict(value) if isinstance(value, Mapping) else value
        return json.dumps(record, ensure_ascii=False)

    @classmethod
    def from_line(cls, line: str | bytes) -> RawItem:
        """The item of one JSON line; fields it does not know are ignored.

        Raises
        ------
        FieldError
            The line is no JSON object, or of another schema, or a field is not what it must be.
        """
        values = json_record(line, dict[str, Any])
        schema = values.pop("schema", None)
        expect(schema == SCHEMA, "schema", SCHEMA, schema)
        return record_of(values, cls)


def _is_region(region: str | None) -> bool:
    return region is None or region in REGIONS or (len(region) == 2 and region.isascii() and region.isupper())


def raw_items(path: Path) -> Iterator[RawItem]:
    """The items of a JSON Lines file, in its order.

    Raises
    ------
    BadRawItem
        A line is no raw item; the message names the file and the line.
    """
    with path.open("rb") as file:
        yield from items_of_lines(path, bounded_lines(path, file))


def bounded_lines(path: Path, file: BufferedIOBase) -> Iterator[bytes]:
    """The lines of a file of raw items.

    Raises
    ------
    BadRawItem
        A line has more than `MAX_LINE` bytes: a file that unpacks to gigabytes need not hold a line end.
    """
    number = 1
    while line := file.readline(MAX_LINE):
        if len(line) == MAX_LINE and not line.endswith(b"\n"):
            raise BadRawItem(f"{path}:{number}: line: expected less than {MAX_LINE:,} bytes; found more")
        yield line
        number += 1


def items_of_lines(path: Path | str, lines: Iterable[bytes], first: int = 1) -> Iterator[RawItem]:
    """The items of lines of a file, of which the first is line `first`; blank ones are passed over."""
    for number, line in enumerate(lines, start=first):
        if line.strip():
            with in_file(f"{path}:{number}", BadRawItem):
                item = RawItem.from_line(line)
            yield item
