"""Sizes that a norm fixes, and ranges that a language model judged (`data/curated/README.md`).

A row of `norms.csv` is one size that a standard allows, with its tolerance, document and clause; a class may have
several. A range contains 90 % of the objects in the judgement of its writer. The rows enter the build as raw items of
the kinds `norm` and `judged`. Three tables of ranges have the same form: `ranges.csv` for the tree, and `blind.csv` and
`blind_wide.csv` for classes with measured items, written before these were read, to test the accuracy of such ranges
(docs/explanation/taxonomy.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

import msgspec

from crawler.items import RawItem
from metric_base.errors import Unquoted, expect, in_file
from metric_base.folders import taxonomy_directory
from metric_base.records import read_csv
from metric_tree.variants import Millimetres, Text
from taxonomy.levels import DIMENSIONS, BadLevels

Row = TypeVar("Row")
#: Source ids of the rows in a release.
SOURCE, NORMS = "judged", "norms"
#: Licence of the rows, which are part of the project.
LICENCE = "Apache-2.0"

#: Tables of blind ranges, by two writers; the second knew how narrow the ranges of the first were.
BLIND_TABLES = ("blind", "blind_wide")

_AXES = tuple(DIMENSIONS.values())
_DIRECTORY = taxonomy_directory().parent / "curated"

#: A date. A comma without quotes moves the cells of a row, so that the last cell is not a date.
Date: TypeAlias = Annotated[str, msgspec.Meta(pattern=r"^\d{4}(-\d\d){0,2}$")]
Factor: TypeAlias = Annotated[float, msgspec.Meta(ge=0.5, le=2)]


class BadRange(BadLevels):
    """A row of a table of curated sizes is invalid: the message has file, line, expected and found value."""


class CuratedSize(msgspec.Struct, frozen=True, kw_only=True):
    """Sizes of a node in mm in its ordinary pose; an axis has all three values, in order, or none."""

    node_id: Text
    length_low: Millimetres | None = None
    length_typical: Millimetres | None = None
    length_high: Millimetres | None = None
    width_low: Millimetres | None = None
    width_typical: Millimetres | None = None
    width_high: Millimetres | None = None
    height_low: Millimetres | None = None
    height_typical: Millimetres | None = None
    height_high: Millimetres | None = None
    reviewer: str = ""

    def __post_init__(self) -> None:
        for axis, ends in zip(_AXES, self.spans, strict=True):
            known = [end for end in ends if end is not None]
            is_ordered = len(known) in {0, 3} and known == sorted(known)
            expect(is_ordered, axis, "low, typical and high in order, or none", list(ends))
        expect(any(self.typical), self.node_id, "at least one axis and a reason", Unquoted("none"))

    @property
    def spans(self) -> tuple[tuple[float | None, ...], ...]:
        """Low, typical and high size in mm of each axis, None if not stated."""
        return tuple(tuple(getattr(self, f"{axis}_{end}") for end in ("low", "typical", "high")) for axis in _AXES)

    @property
    def typical(self) -> tuple[float | None, ...]:
        """Typical sizes in mm along length, width and height, None if not stated."""
        return tuple(typical for _, typical, _ in self.spans)

    @property
    def ends(self) -> dict[str, tuple[float, float, float]]:
        """Low, typical and high size in mm of each stated axis."""
        spans = zip(_AXES, self.spans, strict=True)
        return {axis: (low, typical, high) for axis, (low, typical, high) in spans if low and typical and high}

    def item(self, **fields: Any) -> RawItem:
        """Return the row as a raw item with the typical size, the range of each axis, and the node as its category."""
        return RawItem(
            category_path=(self.node_id,),
            dimensions_mm={axis: typical for axis, (_, typical, _) in self.ends.items()},
            ranges_mm={axis: (low, high) for axis, (low, _, high) in self.ends.items()},
            licence=LICENCE,
            synset=self.node_id,
            **fields,
        )


class CuratedRange(CuratedSize, frozen=True, kw_only=True):
    """A row of `ranges.csv` or of a table of blind ranges: 90 % of the objects are between low and high."""

    reason: Text
    written: Date

    @property
    def is_programs(self) -> bool:
        """Return True if a program wrote the range; a range of a person replaces it."""
        return self.reviewer.startswith("program")


class CuratedState(CuratedRange, frozen=True, kw_only=True):
    """A row of `states.csv`: sizes of a node in a state (folded, open, lying, mounted)."""

    state: Text
    plain: Text  #: State of the objects of the default prior, or `mixed: ` and their states.


class Norm(CuratedSize, frozen=True, kw_only=True):
    """A row of `norms.csv`: one size that a standard allows, from low to high by its tolerance."""

    size: Text  #: Name of the size in the standard.
    document: Text
    clause: Annotated[str, msgspec.Meta(pattern=r"^[^;]+$")]  # a semicolon separates norms elsewhere
    region: str | None = None
    share: Annotated[float, msgspec.Meta(gt=0, le=1)] | None = None  #: Fraction of the world's objects of the class.
    written: Text

    @property
    def source_id(self) -> str:
        """Id of the raw item of the size."""
        return f"{self.node_id} {self.size}"


class CuratedHeight(msgspec.Struct, frozen=True, kw_only=True):
    """A row of `heights.csv`: the definition of the height of a node, or `mixed: ` and the definitions.

    The vertical extent of nine of ten animals is between `extent_low` and `extent_high` times the height at the
    withers. The row then holds for the nodes below it, too.
    """

    node_id: Text
    height: Text
    underside: Literal["seen", "unseen"]
    extent_low: Factor | None = None
    extent_typical: Factor | None = None
    extent_high: Factor | None = None
    reason: Text
    reviewer: Text
    written: Text

    def __post_init__(self) -> None:
        is_valid = len(self.extent) in {0, 3} and self.extent == sorted(self.extent)
        expect(is_valid, "extent", "low, typical and high in order, or none", self.extent)

    @property
    def extent(self) -> list[float]:
        """Low, typical and high ratio of the vertical extent to the height; empty if they are equal."""
        return [one for one in (self.extent_low, self.extent_typical, self.extent_high) if one is not None]


class SettledFinding(msgspec.Struct, frozen=True, kw_only=True):
    """A row of `settled.csv`: a finding about a leaf that a reviewer accepted."""

    code: Text
    node_id: Text
    reason: Text
    reviewer: Text
    written: Text


@cache
def norms(path: Path = _DIRECTORY / "norms.csv") -> tuple[Norm, ...]:
    """Read the norms of the project, or of another file.

    Raises
    ------
    BadRange
        A size is not positive, an axis is incomplete or out of order, document or clause is missing, or the sizes of
        a class state different axes, or only some of them a share.
    """
    rows: list[Norm] = []
    axes: dict[str, tuple[bool, ...]] = {}
    for place, row in read_csv(path, Norm, BadRange):
        stated = (*(value is not None for value in row.typical), row.share is not None)
        expected = "those of the class's other sizes, and a share for all of them or none"
        with in_file(place, BadRange):
            expect(axes.setdefault(row.node_id, stated) == stated, "axes", expected, stated)
        rows.append(row)
    return tuple(rows)


@cache
def curated_ranges(path: Path = _DIRECTORY / "ranges.csv") -> tuple[CuratedRange, ...]:
    """Read the ranges of the project, or of another file.

    Of several rows of a node, the last one of a person counts; without a person, the last one.

    Raises
    ------
    BadRange
        A size is not positive, or an axis is incomplete or out of order.
    """
    chosen: dict[str, CuratedRange] = {}
    for _, row in read_csv(path, CuratedRange, BadRange):
        before = chosen.get(row.node_id)
        if before is None or before.is_programs or not row.is_programs:
            chosen[row.node_id] = row
    return tuple(chosen.values())


def blind_ranges(table: str = "blind") -> tuple[CuratedRange, ...]:
    """Read the ranges of a blind table (`BLIND_TABLES`), of classes with measured items."""
    return curated_ranges(_DIRECTORY / f"{table}.csv")


def unique_rows(path: Path, kind: type[Row], field: str, key: Callable[[Row], object]) -> tuple[Row, ...]:
    """Read the rows of a table, which differ in `key`; none if the file does not exist."""
    rows: dict[object, Row] = {}
    for place, row in read_csv(path, kind, BadRange) if path.is_file() else ():
        with in_file(place, BadRange):
            expect(key(row) not in rows, field, "another value than in the rows above", getattr(row, field))
        rows[key(row)] = row
    return tuple(rows.values())


@cache
def curated_states(path: Path = _DIRECTORY / "states.csv") -> tuple[CuratedState, ...]:
    """Read the sizes of objects in their states; none if the file does not exist.

    Raises
    ------
    BadRange
        As for a range, or a state has no name, or the same name twice.
    """
    return unique_rows(path, CuratedState, "state", lambda row: (row.node_id, row.state))


@cache
def curated_heights(path: Path = _DIRECTORY / "heights.csv") -> tuple[CuratedHeight, ...]:
    """Read the definitions of the heights of hollow objects; none if the file does not exist.

    Raises
    ------
    BadRange
        A node occurs twice, a cell is empty, or `underside` is neither `seen` nor `unseen`.
    """
    return unique_rows(path, CuratedHeight, "node_id", lambda row: row.node_id)


@cache
def settled_findings(path: Path = _DIRECTORY / "settled.csv") -> frozenset[tuple[str, str]]:
    """Read code and node id of the findings about leaves that a reviewer accepted; none if the file does not exist.

    Raises
    ------
    BadRange
        A row has no reason or no reviewer.
    """
    rows = read_csv(path, SettledFinding, BadRange) if path.is_file() else ()
    return frozenset((row.code, row.node_id) for _, row in rows)


def judged_items() -> Iterator[RawItem]:
    """Yield a raw item for each range, also for those of the first blind table, whose classes have measured items."""
    ranges = curated_ranges()
    known = {row.node_id for row in ranges}
    for row in (*ranges, *(row for row in blind_ranges() if row.node_id not in known)):
        yield row.item(source=SOURCE, source_id=row.node_id, title=row.reason, kind="judged")


def norm_items() -> Iterator[RawItem]:
    """Yield a raw item for each size that a norm allows; its title is the document and the clause."""
    for row in norms():
        title = f"{row.document}, {row.clause}"
        yield row.item(source=NORMS, source_id=row.source_id, title=title, kind="norm", region=row.region)


@cache
def norm_shares() -> dict[str, float]:
    """Return the share of each size that a norm allows by the id of its raw item, 1 if it is not stated."""
    return {row.source_id: row.share or 1.0 for row in norms()}
