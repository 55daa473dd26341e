"""The declaration of a plain table: which columns hold what, in which unit, and which rows are no object sizes."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Mapping
from pathlib import PurePosixPath
from typing import Literal

import msgspec

from crawler.items import KINDS
from crawler.text.cell_lengths import AXES
from crawler.text.units import MILLIMETRES
from metric_base.records import expect

__all__ = ["REASONS", "Axis", "Cases", "Format", "Rule", "Table", "expect_inside"]

Format = Literal["csv", "json", "jsonl", "properties", "xls", "yaml"]

#: Why a row is refused, by reason code.
REASONS: Mapping[str, str] = {
    "no_size": "states no outer size",
    "unreadable": "a length that cannot be read",
    "out_of_bounds": "a size outside the declared bounds of the set: a slip of unit or of typing",
    "not_an_object": "parcel, ground, spare cover, service or another row whose size is not that of an object",
    "part_not_whole": "the size of a part, where the whole is wanted",
    "flat_picture": "a picture, print, page or mat, sized by its sheet or frame",
    "grid_not_sample": "an even grid of values made up for a search, not a sample of objects",
    "several_states": "sizes of several states or of several pieces in one text",
    "marked_unusable": "marked as unusable by its source",
    "no_category": "says nowhere what it is",
    "set_of_objects": "one size for a set of several objects",
    "wrong_axis": "a size of another axis than the column says",
    "superseded": "the same object is in another file of the set, in another scan of its room, or in another set",
    "miniature": "a small likeness of the object it is named after",
    "cut_by_scan": "part of the object was not observed: the size of what was scanned",
    "juvenile": "not grown: a sapling of a nursery",
}


class _Declared(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A part of a declaration: its fields are those of the TOML table, and no others."""


class Axis(_Declared, frozen=True, kw_only=True):
    """The column of one axis, less another one (`minus`) where the two sides of a box are given.

    `unit` is the table's where None; `factor` serves odd units (abalone is given in 200 mm); `pattern` finds the
    length in a longer text, as its first group.
    """

    column: str
    minus: str = ""
    pattern: str = ""
    unit: str | None = None
    factor: float = 1.0

    def __post_init__(self) -> None:
        expect(self.unit in {None, *MILLIMETRES}, "unit", f"one of {', '.join(MILLIMETRES)}", self.unit)


class Rule(_Declared, frozen=True, kw_only=True):
    """A test on one column (a pattern in its text, or a number below or above a bound) and what follows from it.

    `column` may be a template over several, `{depth}|{description}`; `listed` names a file beside the declaration
    that lists the texts that are meant, one a line.
    `outcome` is a reason code where the rule refuses rows, a flag where it marks them, nothing where it selects them.
    """

    column: str
    outcome: str = ""
    matches: re.Pattern[str] | None = None
    listed: str = ""
    #: The texts of the file `listed`.
    texts: frozenset[str] = frozenset()
    below: float | None = None
    above: float | None = None

    def __post_init__(self) -> None:
        if self.outcome == "set_of_things":
            warnings.warn("the reason 'set_of_things' is called 'set_of_objects'", DeprecationWarning, stacklevel=2)
            msgspec.structs.force_setattr(self, "outcome", "set_of_objects")
        tests = (self.matches, self.listed or None, self.below, self.above)
        expect(any(test is not None for test in tests), "rule", "matches, listed, below or above", self.column)
        expect_inside(self.listed, "listed")


class Cases(_Declared, frozen=True, kw_only=True):
    r"""A column read out of others: the value of the first case whose pattern is in `column`, else `default`.

    `column` and `default` are templates; `\1` in a value is what the pattern's first group matched.
    """

    column: str
    cases: tuple[tuple[re.Pattern[str], str], ...]
    default: str = ""


class Table(_Declared, frozen=True, kw_only=True):
    """One plain table of a source.

    Texts are templates over the row's columns, `{brand} {model}`; `{file}` is the file's stem, `{row}` the row's
    number; a filter follows a bar: `{type|words}` parts CamelCase and underscores, `{title|head}` ends at the first
    comma or bracket, `{title|part}` does so after the first colon, `{x|lower}` is in small letters.
    """

    #: Files of the table, relative to the source's folder, as glob patterns.
    files: tuple[str, ...]
    #: The public form of a table that was joined into one file: a pattern of JSON files, a record each, read in the
    #: order of their paths where `files` is missing.
    records: str = ""
    #: Whether the patterns mean only files that no other table of the source reads; there may be none.
    rest: bool = False
    format: Format = "csv"
    delimiter: str = ","
    encoding: str = "utf-8-sig"
    #: Names of the columns where the file has no header.
    columns: tuple[str, ...] = ()
    #: Lines above the header.
    skip_lines: int = 0
    #: Path to the records of a JSON or YAML file, `*` for every key or element: `records/*`.
    each: str = "*"
    unit: str | None = None
    decimal: Literal[".", ","] | None = None
    id: str = "{file}-{row}"
    title: str = ""
    category: tuple[str, ...] = ()
    #: What separates the parts of a breadcrumb in one column, ` | `.
    category_separator: str = ""
    brand: str = ""
    url: str = ""
    year: str = ""
    region: str = ""
    #: The room or drive in which the row's object was measured, `{scan}`.
    scene: str = ""
    #: What a row about many objects states of them; `instance` or nothing for a row about one object.
    statistic: str = ""
    #: Standard deviation over mean of the objects that a statistic is about.
    relative_sd: str = ""
    attribution: str = ""
    synset: str = ""
    kind: str = ""
    licence: str = ""
    axes: dict[str, str | Axis] = {}
    #: Template of a text that states the whole size, and the axis words of its numbers where it brings none.
    text: str = ""
    #: Finds the size in a longer text, as its first group.
    text_pattern: str = ""
    order: tuple[str, ...] = ()
    #: False where the source does not say which axis is which: only `extents_mm` is kept.
    labelled: bool = True
    only: tuple[Rule, ...] = ()
    reject: tuple[Rule, ...] = ()
    flag: tuple[Rule, ...] = ()
    flags: tuple[str, ...] = ()
    #: Values of a column that read otherwise: `{"sdn" = "saloon"}`.
    names: dict[str, dict[str, str]] = {}
    #: Columns read out of others by patterns, before any rule or template looks at the row.
    read: dict[str, Cases] = {}
    #: Shortest and longest extent, mm, that an object of this table can have.
    bounds_mm: tuple[float, float] = (0.1, 500_000.0)
    #: A reason code where every row of the table is refused, with `note` to say why.
    refused: str = ""
    note: str = ""

    def __post_init__(self) -> None:
        given = self.axes or {name: name for name in self.columns if name in AXES}
        axes = {name: Axis(column=axis) if isinstance(axis, str) else axis for name, axis in given.items()}
        msgspec.structs.force_setattr(self, "axes", axes)
        expect(bool(self.files), "files", "file names", self.files)
        for pattern in (*self.files, self.records):
            expect_inside(pattern, "files")
        expect(self.unit in {None, *MILLIMETRES}, "unit", f"one of {', '.join(MILLIMETRES)}", self.unit)
        without = [axis.column for axis in axes.values() if not axis.unit]
        expect(bool(self.unit) or not without, "unit", "a unit for every axis", without)
        _expect_some(axes, "axes", AXES)
        _expect_some(self.order, "order", AXES)
        expect(not self.kind or "{" in self.kind or self.kind in KINDS, "kind", _one_of(KINDS), self.kind)
        shortest, longest = self.bounds_mm
        expect(shortest < longest, "bounds_mm", "the shortest, then the longest", self.bounds_mm)
        _expect_some({rule.outcome for rule in self.reject} | ({self.refused} - {""}), "reject", REASONS)

    @property
    def columns_of_axes(self) -> Mapping[str, Axis]:
        """The axes, each with its column."""
        return {name: axis for name, axis in self.axes.items() if isinstance(axis, Axis)}


def expect_inside(path: str, field: str) -> None:
    """FieldError for a path, or a pattern of paths, that leads out of the folder that it is relative to."""
    parts = PurePosixPath(path.replace("\\", "/"))
    outside = parts.is_absolute() or ".." in parts.parts or ":" in path or "\0" in path
    expect(not outside, field, "a path inside the source's folder", path)


def _one_of(known: Iterable[str]) -> str:
    return f"one of {', '.join(sorted(known))}"


def _expect_some(given: Iterable[str], field: str, known: Iterable[str]) -> None:
    unknown = sorted(set(given) - set(known))
    expect(not unknown, field, f"some of {', '.join(known)}", unknown)
