"""Sizes that a norm fixes, and ranges that a language model judged (data/curated/README.md).

A norm's row is one size that a standard allows, with its tolerance, document and clause; a class may have several. A
range holds nine of ten such items in the writer's judgement. The rows enter the build as raw items of the kinds `norm`
and `judged`. Three tables of ranges of one form: `ranges.csv` for the tree, and `blind.csv` and `blind_wide.csv`,
written for classes that have measured items before these were opened, to see how far such ranges can be trusted
(docs/explanation/taxonomy.md).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from crawler.items import RawItem
from metric_base.errors import Unquoted, expect, in_file
from metric_base.folders import taxonomy_directory
from metric_base.records import read_csv
from taxonomy.levels import DIMENSIONS, BadLevels

#: Source ids of the rows in a release; they are the project's own words, under its own licence.
SOURCE, NORMS = "judged", "norms"
LICENCE = "Apache-2.0"

_AXES = tuple(DIMENSIONS.values())
#: A date; a comma without quotes moves the cells of a row, so that its last cell is no date.
_Date = Annotated[str, msgspec.Meta(pattern=r"^\d{4}(-\d\d){0,2}$")]
_Text = Annotated[str, msgspec.Meta(min_length=1)]
_Millimetres = Annotated[float, msgspec.Meta(gt=0, le=1e9)]

#: Two writers' ranges; the second knew how narrow the first one's were.
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
    reviewer: str
    written: str

    @property
    def is_programs(self) -> bool:
        """Return True if a program wrote it: it yields to a person's."""
        return self.reviewer.startswith("program")


@dataclass(frozen=True, slots=True, kw_only=True)
class CuratedState(CuratedRange):
    """Sizes of a node in a state that is not its ordinary one, or one of several (folded, open, lying, mounted).

    `plain` is the state that the plain prior is of, or `mixed: ` and what it holds.
    """

    state: str
    plain: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CuratedHeight:
    """Between which two levels the height of a hollow item is measured: `mixed: ` where its rows hold several.

    underside_seen : False of what is built in or sunk, so that who looks at it does not see how far down it goes.
    """

    node_id: str
    height: str
    underside_seen: bool
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Norm:
    """One size in mm that a standard allows, in the ordinary pose: from low to high by its tolerance.

    `size` is what the standard calls it; an axis that the standard leaves open is None.
    """

    node_id: str
    size: str
    low: Triple
    typical: Triple
    high: Triple
    document: str
    clause: str
    region: str | None
    reviewer: str
    written: str


def norms(path: Path | None = None) -> tuple[Norm, ...]:
    """The norms that ship with the project, or those of another file.

    Raises
    ------
    BadRange
        A cell is no positive number, an axis is half filled or out of order, no document or clause is named, or the
        sizes of one class state different axes.
    """
    return _norms(path or _directory() / "norms.csv")


def curated_ranges(path: Path | None = None) -> tuple[CuratedRange, ...]:
    """The ranges that ship with the project, or those of another file.

    Of several rows of one node a person's outranks a program's, then the later one counts.

    Raises
    ------
    BadRange
        A cell is no positive number, an axis is half filled, or low, typical and high are out of order.
    """
    return _ranges(path or _directory() / "ranges.csv")


def curated_states(path: Path | None = None) -> tuple[CuratedState, ...]:
    """Sizes of things in their states, as the project's table has them; a taxonomy of one's own has none.

    Raises
    ------
    BadRange
        As of a range, or a state is not named, or named twice.
    """
    return _states(path or _directory() / "states.csv")


def curated_heights(path: Path | None = None) -> tuple[CuratedHeight, ...]:
    """What the heights of hollow things are, as the project's table has them; a taxonomy of one's own has none.

    Raises
    ------
    BadRange
        A node is named twice, a cell is empty, or `underside` is neither seen nor unseen.
    """
    return _heights(path or _directory() / "heights.csv")


def blind_ranges(table: str = "blind") -> tuple[CuratedRange, ...]:
    """Ranges of classes that have measured items, written before these were opened; `table` is one of BLIND_TABLES."""
    return _ranges(_directory() / f"{table}.csv")


def judged_items() -> Iterator[RawItem]:
    """One raw item for each range: the typical size, the range by axis, and the node in place of a category.

    Ranges of the first blind table are among them: they speak of classes that have items, too.
    """
    own = curated_ranges()
    known = {row.node_id for row in own}
    for row in (*own, *(row for row in blind_ranges() if row.node_id not in known)):
        yield _item(row, source=SOURCE, source_id=row.node_id, title=row.reason, kind="judged")


def norm_items() -> Iterator[RawItem]:
    """One raw item for each size that a norm allows; the title is its document and clause."""
    for row in norms():
        name = f"{row.node_id} {row.size}"
        title = f"{row.document}, {row.clause}"
        yield _item(row, source=NORMS, source_id=name, title=title, kind="norm", region=row.region)


def settled_findings() -> frozenset[tuple[str, str]]:
    """(code, node id) of the findings about leaves that were looked at and accepted, each with its reason.

    Raises
    ------
    BadRange
        A row has no reason or no reviewer.
    """
    return _accepted_rows(_directory() / "settled.csv")


def _item(row: CuratedRange | Norm, **fields: Any) -> RawItem:
    axes = [axis for axis, value in enumerate(row.typical) if value is not None]
    return RawItem(
        category_path=(row.node_id,),
        dimensions_mm={_AXES[axis]: row.typical[axis] for axis in axes},
        ranges_mm={_AXES[axis]: (_not_none(row.low[axis]), _not_none(row.high[axis])) for axis in axes},
        licence=LICENCE,
        synset=row.node_id,
        **fields,
    )


class _SizeRow(msgspec.Struct, kw_only=True):
    """Columns of sizes in mm by axis; an axis has all three values in order, or none."""

    node_id: _Text
    length_low: _Millimetres | None = None
    length_typical: _Millimetres | None = None
    length_high: _Millimetres | None = None
    width_low: _Millimetres | None = None
    width_typical: _Millimetres | None = None
    width_high: _Millimetres | None = None
    height_low: _Millimetres | None = None
    height_typical: _Millimetres | None = None
    height_high: _Millimetres | None = None
    reviewer: str = ""

    def __post_init__(self) -> None:
        for axis in _AXES:
            ends = [getattr(self, f"{axis}_{end}") for end in ("low", "typical", "high")]
            known = [end for end in ends if end is not None]
            expect(
                len(known) in {0, 3} and known == sorted(known), axis, "low, typical and high in order, or none", ends
            )
        expect(any(self.sizes()["typical"]), self.node_id, "at least one axis and a reason", Unquoted("none"))

    def sizes(self) -> dict[str, Triple]:
        """Return low, typical and high of length, width and height."""
        return {end: tuple(getattr(self, f"{axis}_{end}") for axis in _AXES) for end in ("low", "typical", "high")}


class _NormRow(_SizeRow, kw_only=True):
    """A row of `norms.csv`."""

    size: _Text
    document: _Text
    clause: Annotated[str, msgspec.Meta(pattern=r"^[^;]+$")]  # a semicolon separates norms elsewhere
    region: str | None = None
    written: _Text


class _RangeRow(_SizeRow, kw_only=True):
    """A row of `ranges.csv` and of the tables of blind ranges."""

    reason: _Text
    written: _Date

    def fields(self) -> dict[str, Any]:
        """Return the fields of a `CuratedRange`."""
        texts = {name: getattr(self, name) for name in ("node_id", "reason", "reviewer", "written")}
        return texts | self.sizes()


class _StateRow(_RangeRow, kw_only=True):
    """A row of `states.csv`."""

    state: str = ""
    plain: _Text


class _HeightRow(msgspec.Struct, kw_only=True):
    """A row of `heights.csv`."""

    node_id: _Text
    height: _Text
    underside: Literal["seen", "unseen"]
    reason: _Text
    reviewer: _Text
    written: _Text


class _AcceptedRow(msgspec.Struct, kw_only=True):
    """A row of `settled.csv`."""

    code: _Text
    node_id: _Text
    reason: _Text
    reviewer: _Text
    written: _Text


@cache
def _norms(file: Path) -> tuple[Norm, ...]:
    rows: list[Norm] = []
    axes: dict[str, tuple[bool, ...]] = {}
    for place, row in read_csv(file, _NormRow, BadRange):
        sizes = row.sizes()
        stated = tuple(value is not None for value in sizes["typical"])
        with in_file(place, BadRange):
            expect(axes.setdefault(row.node_id, stated) == stated, "axes", "those of the class's other sizes", stated)
        rows.append(
            Norm(
                node_id=row.node_id,
                size=row.size,
                low=sizes["low"],
                typical=sizes["typical"],
                high=sizes["high"],
                document=row.document,
                clause=row.clause,
                region=row.region,
                reviewer=row.reviewer,
                written=row.written,
            )
        )
    return tuple(rows)


@cache
def _accepted_rows(file: Path) -> frozenset[tuple[str, str]]:
    if not file.is_file():  # another taxonomy than the shipped one
        return frozenset()
    return frozenset((row.code, row.node_id) for _, row in read_csv(file, _AcceptedRow, BadRange))


@cache
def _ranges(file: Path) -> tuple[CuratedRange, ...]:
    chosen: dict[str, CuratedRange] = {}
    for _, row in read_csv(file, _RangeRow, BadRange):
        one = CuratedRange(**row.fields())
        before = chosen.get(one.node_id)
        if before is None or before.is_programs or not one.is_programs:
            chosen[one.node_id] = one
    return tuple(chosen.values())


@cache
def _states(file: Path) -> tuple[CuratedState, ...]:
    if not file.is_file():
        return ()
    states: dict[tuple[str, str], CuratedState] = {}
    for place, row in read_csv(file, _StateRow, BadRange):
        key = row.node_id, row.state
        with in_file(place, BadRange):
            expect(bool(row.state) and key not in states, "state", "a name, once for each node", row.state)
        states[key] = CuratedState(state=row.state, plain=row.plain, **row.fields())
    return tuple(states.values())


@cache
def _heights(file: Path) -> tuple[CuratedHeight, ...]:
    if not file.is_file():
        return ()
    heights: dict[str, CuratedHeight] = {}
    for place, row in read_csv(file, _HeightRow, BadRange):
        with in_file(place, BadRange):
            expect(row.node_id not in heights, "node_id", "a node, once", row.node_id)
        heights[row.node_id] = CuratedHeight(
            node_id=row.node_id, height=row.height, underside_seen=row.underside == "seen", reason=row.reason
        )
    return tuple(heights.values())


def _not_none(value: float | None) -> float:
    if value is None:  # `_SizeRow` checks that an axis has all three values or none
        raise AssertionError
    return value


def _directory() -> Path:
    return taxonomy_directory().parent / "curated"
