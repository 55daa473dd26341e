"""Curated ranges: what an annotator says of a category that nobody measured, each row with its reason or standard.

A range holds nine of ten such things in the writer's judgement. The rows enter the build as raw items of kind
`curated`, which a class's real items replace. Three tables of one form: `ranges.csv` for the tree, and `blind.csv` and
`blind_wide.csv`, written for classes that have measured items before these were opened, to see how far such ranges can
be trusted (docs/explanation/levels.md).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from crawler.items import RawItem
from metric_base.errors import Unquoted, in_file
from metric_base.folders import taxonomy_directory
from metric_base.schema import expect
from taxonomy.levels import DIMENSIONS, BadLevels, table_rows

__all__ = [
    "BLIND_TABLES",
    "LICENCE",
    "SOURCE",
    "BadRange",
    "CuratedRange",
    "Triple",
    "blind_ranges",
    "curated_items",
    "curated_ranges",
]

#: Source id of the rows in a release; they are the project's own words, under its own licence.
SOURCE = "curated"
LICENCE = "Apache-2.0"

_AXES = tuple(DIMENSIONS.values())
_ENDS = ("low", "typical", "high")
_COLUMNS = ("node_id", *(f"{axis}_{end}" for axis in _AXES for end in _ENDS), "reason", "standard", "reviewer")

#: Two writers' ranges; the second had been told how narrow the first one's were.
BLIND_TABLES = ("blind", "blind_wide")

#: Length, width, height in mm; None where the row does not say.
Triple = tuple[float | None, float | None, float | None]


class BadRange(BadLevels):
    """A row of a table of ranges that is not a range: the message names file, line, expected and found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CuratedRange:
    """Sizes of a node in mm in its ordinary pose: nine of ten lie between low and high."""

    node_id: str
    low: Triple
    typical: Triple
    high: Triple
    reason: str
    standard: str
    reviewer: str


def curated_ranges(path: Path | None = None) -> tuple[CuratedRange, ...]:
    """The ranges that ship with the project, or those of another file.

    Raises
    ------
    BadRange
        A cell is no positive number, an axis is half filled, or low, typical and high are out of order.
    """
    return _ranges(path or _directory() / "ranges.csv")


def blind_ranges(table: str = "blind") -> tuple[CuratedRange, ...]:
    """Ranges of classes that have measured items, written before these were opened; `table` is one of BLIND_TABLES."""
    return _ranges(_directory() / f"{table}.csv")


def curated_items() -> Iterator[RawItem]:
    """One raw item for each range: the typical size, the range by axis, and the node in place of a category.

    Ranges of the first blind table are among them: they speak of classes that have items, too. A range that cites a
    standard has the flag `norm`.
    """
    own = curated_ranges()
    known = {row.node_id for row in own}
    for row in (*own, *(row for row in blind_ranges() if row.node_id not in known)):
        axes = [axis for axis, value in enumerate(row.typical) if value is not None]
        yield RawItem(
            source=SOURCE,
            source_id=row.node_id,
            title=row.reason,
            category_path=(row.node_id,),
            dimensions_mm={_AXES[axis]: row.typical[axis] for axis in axes},
            ranges_mm={_AXES[axis]: (_not_none(row.low[axis]), _not_none(row.high[axis])) for axis in axes},
            licence=LICENCE,
            kind="curated",
            flags=("norm",) if row.standard else (),
            synset=row.node_id,
        )


@cache
def _ranges(file: Path) -> tuple[CuratedRange, ...]:
    ranges = []
    for place, row in table_rows(file, _COLUMNS):
        with in_file(place, BadRange):
            ranges.append(_range(row))
    return tuple(ranges)


def _range(row: dict[str, str]) -> CuratedRange:
    values = [[_number(row, f"{axis}_{end}") for end in _ENDS] for axis in _AXES]
    for axis, ends in zip(_AXES, values, strict=True):
        known = [end for end in ends if end is not None]
        expect(len(known) in {0, 3} and known == sorted(known), axis, "low, typical and high in order, or none", ends)
    low, typical, high = zip(*values, strict=True)
    expect(bool(any(typical) and row["reason"]), row["node_id"], "at least one axis and a reason", Unquoted("none"))
    return CuratedRange(
        node_id=row["node_id"],
        low=low,
        typical=typical,
        high=high,
        reason=row["reason"],
        standard=row["standard"],
        reviewer=row["reviewer"],
    )


def _number(row: dict[str, str], column: str) -> float | None:
    """Millimetres of a cell, None of an empty one."""
    cell = row[column]
    if not cell:
        return None
    try:
        value = float(cell)
    except ValueError:
        value = 0.0
    expect(0 < value < float("inf"), column, "millimetres", cell)
    return value


def _not_none(value: float | None) -> float:
    if value is None:  # _range checks that an axis has all three numbers or none
        raise AssertionError
    return value


def _directory() -> Path:
    return taxonomy_directory().parent / "curated"
