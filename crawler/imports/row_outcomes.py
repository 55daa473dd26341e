"""What comes of a row: a raw item, or a refusal with its reason."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from crawler.imports.declaration import REASONS
from crawler.imports.sources import Source
from crawler.items import BadRawItem, RawItem
from crawler.text.cell_lengths import AXES, extents_mm
from metric_base.errors import in_file

__all__ = ["Reading", "Refusal", "Refused", "item", "year"]

#: Digits after the point of a stored millimetre: a micrometre, finer than any source measures.
STORED_DECIMALS_MM = 3


@dataclass(frozen=True, slots=True)
class Refusal:
    """A row that is not imported: its place in the table, its reason code, the field in error and its text."""

    source: str
    row: str
    reason: str
    field: str
    found: str

    def line(self) -> str:
        """The refusal as one JSON line of a quarantine file."""
        return json.dumps({"schema": "metric-tree/quarantine/1", **asdict(self)}, ensure_ascii=False)


Reading = RawItem | Refusal


class Refused(Exception):
    """Raised inside a reader to refuse the current row: reason code, field, what was found."""

    def __init__(self, reason: str, field: str, found: object) -> None:
        super().__init__(reason, field, found)
        assert reason in REASONS, reason
        self.reason, self.field, self.found = reason, field, str(found)

    def refusal(self, source: Source, row: str) -> Refusal:
        """The refusal for the quarantine file."""
        return Refusal(source.id, row, self.reason, self.field, self.found[:200])


def item(
    source: Source,
    source_id: str,
    words: Mapping[str, float | None] | None = None,
    *,
    extents: Sequence[float] | None = None,
    bounds_mm: tuple[float, float] = (0.1, 500_000.0),
    category: Sequence[str] = (),
    **texts: Any,
) -> RawItem:
    """The raw item of a row: the source's terms filled in, extents from the axis words where none are given.

    Raises
    ------
    Refused
        No size, a size outside `bounds_mm`, or no category.
    BadRawItem
        A text is not what its field must be, such as a region.
    """
    stated = {axis: round(value, STORED_DECIMALS_MM) for axis, value in (words or {}).items() if value}
    sides = (
        tuple(sorted((round(e, STORED_DECIMALS_MM) for e in extents), reverse=True)) if extents else extents_mm(stated)
    )
    path = tuple(dict.fromkeys(text for part in category if (text := " ".join(part.split()))))
    if not sides:
        raise Refused("no_size", "dimensions", texts.get("dimensions_text") or "")
    if min(sides) < bounds_mm[0] or max(sides) > bounds_mm[1]:
        raise Refused("out_of_bounds", "extents_mm", list(sides))
    if not path:
        raise Refused("no_category", "category", texts.get("title", ""))
    given = {key: value for key, value in texts.items() if value}
    with in_file(f"{source.id}: row {source_id}", BadRawItem):
        return RawItem(
            source=source.id,
            source_id=source_id,
            category_path=path,
            dimensions_mm={axis: stated.get(axis) for axis in AXES} if stated else {},
            extents_mm=sides,
            **(_defaults(source) | given),
        )


def _defaults(source: Source) -> dict[str, Any]:
    """What the source states about all its rows."""
    return {
        "licence": source.licence,
        "kind": source.kind,
        "year": source.year,
        "region": source.region,
        "url": source.page,
    }


def year(text: str) -> int | None:
    """The first year from 1000 to 2099 in a text."""
    match = re.search(r"(?<!\d)(?:1\d|20)\d{2}(?!\d)", text)
    return int(match[0]) if match else None
