"""The declaration of a plain table: which columns hold what, in which unit, and which rows are no object sizes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args

from crawler.items import KINDS
from crawler.text.catalogue_lengths import AXES
from crawler.text.units import MILLIMETRES
from metric_base.faults import InputFault

__all__ = ["REASONS", "Axis", "BadDeclaration", "Cases", "Format", "Rule", "Table", "expect"]

Format = Literal["csv", "json", "jsonl", "properties", "xls", "yaml"]

#: Why a row is refused, by reason code.
REASONS: Mapping[str, str] = {
    "no_size": "states no outer size",
    "unreadable": "a length that cannot be read",
    "out_of_bounds": "a size outside the declared bounds of the set: a slip of unit or of typing",
    "not_an_object": "parcel, ground, spare cover, service or other thing whose size is not an object's",
    "part_not_whole": "the size of a part, where the whole is wanted",
    "flat_picture": "a picture, print, page or mat, sized by its sheet or frame",
    "grid_not_sample": "an even grid of values made up for a search, not a sample of things",
    "several_states": "sizes of several states or of several pieces in one text",
    "marked_unusable": "marked as unusable by its source",
    "no_category": "says nowhere what it is",
    "set_of_things": "one size for a set of several things",
    "wrong_axis": "a size of another axis than the column says",
    "superseded": "the same thing is in another file of the set, in another scan of its room, or in another set",
    "miniature": "a small likeness of the thing it is named after",
    "cut_by_scan": "part of the thing was not seen: the size of what was scanned",
    "juvenile": "not grown: a sapling of a nursery",
}


class BadDeclaration(InputFault):
    """A declaration of a source that is at fault: the message names the file, the field, expected and found."""


def expect(holds: bool, name: str, expected: str, found: object) -> None:
    """Raise `BadDeclaration` with the usual words unless `holds`."""
    if not holds:
        raise BadDeclaration(f"{name}: expected {expected}; found {found!r}")


def _pattern(text: str) -> re.Pattern[str]:
    try:
        return re.compile(text, re.IGNORECASE)
    except re.error as error:
        raise BadDeclaration(f"pattern: expected a regular expression; found {text!r}: {error}") from None


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """Where one axis stands: a column, less another one (`minus`) where the two sides of a box are given.

    `unit` is the table's where None; `factor` serves odd units (abalone is given in 200 mm); `pattern` finds the
    length in a longer text, as its first group.
    """

    column: str
    minus: str = ""
    pattern: str = ""
    unit: str | None = None
    factor: float = 1.0

    @classmethod
    def declared(cls, value: object) -> Axis:
        """The axis of a column's name, or of a table with `column`, `unit`, `factor`."""
        if isinstance(value, str):
            return cls(column=value)
        expect(
            isinstance(value, dict) and "column" in value,
            "axes",
            "a column, or column, minus, pattern, unit and factor",
            value,
        )
        axis = cls(**value)  # type: ignore[arg-type]  # checked one line up and by the fields' names
        expect(
            axis.unit is None or axis.unit in MILLIMETRES, "axes.unit", f"one of {', '.join(MILLIMETRES)}", axis.unit
        )
        return axis


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """A test on one column (a pattern found in its text, or a number below or above a bound) and what follows from it.

    `column` may be a template over several, `{depth}|{description}`.
    `outcome` is a reason code where the rule refuses rows, a flag where it marks them, nothing where it selects them.
    """

    column: str
    outcome: str = ""
    matches: re.Pattern[str] | None = None
    below: float | None = None
    above: float | None = None

    @classmethod
    def declared(cls, value: Mapping[str, Any]) -> Rule:
        """The rule of a table with `column`, `outcome` and `matches`, `below` or `above`."""
        unknown = set(value) - {"column", "outcome", "matches", "below", "above"}
        expect(not unknown and "column" in value, "rule", "column, outcome, and matches, below or above", dict(value))
        tests = {key: value[key] for key in ("matches", "below", "above") if key in value}
        expect(bool(tests), "rule", "matches, below or above", dict(value))
        return cls(**{**value, "matches": _pattern(value["matches"]) if "matches" in value else None})


@dataclass(frozen=True, slots=True, kw_only=True)
class Cases:
    r"""A column read out of others: the value of the first case whose pattern is found in `column`, else `default`.

    `column` and `default` are templates; `\1` in a value is what the pattern's first group matched.
    """

    column: str
    cases: tuple[tuple[re.Pattern[str], str], ...]
    default: str = ""

    @classmethod
    def declared(cls, value: Mapping[str, Any]) -> Cases:
        """The cases of a table with `column`, `cases` (pattern, value) and `default`."""
        fits = set(value) <= {"column", "cases", "default"} and {"column", "cases"} <= set(value)
        expect(fits, "read", "column, cases and default", sorted(value))
        cases = tuple((_pattern(pattern), str(result)) for pattern, result in value["cases"])
        return cls(column=value["column"], cases=cases, default=value.get("default", ""))


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
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
    #: The room or drive in which the row's thing was measured, `{scan}`.
    scene: str = ""
    #: What a row about many things states of them; `instance` or nothing for a row about one thing.
    statistic: str = ""
    #: Standard deviation over mean of the things that a statistic is about.
    relative_sd: str = ""
    attribution: str = ""
    synset: str = ""
    kind: str = ""
    licence: str = ""
    axes: Mapping[str, Axis] = field(default_factory=dict)
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
    names: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    #: Columns read out of others by patterns, before any rule or template looks at the row.
    read: Mapping[str, Cases] = field(default_factory=dict)
    #: Shortest and longest extent, mm, that a thing of this table can have.
    bounds_mm: tuple[float, float] = (0.1, 500_000.0)
    #: A reason code where every row of the table is refused, with `note` to say why.
    refused: str = ""
    note: str = ""

    def __post_init__(self) -> None:
        expect(bool(self.files), "tables.files", "at least one file", self.files)
        expect(self.format in get_args(Format), "tables.format", f"one of {', '.join(get_args(Format))}", self.format)
        expect(
            self.unit is None or self.unit in MILLIMETRES, "tables.unit", f"one of {', '.join(MILLIMETRES)}", self.unit
        )
        measured = self.unit or all(axis.unit for axis in self.axes.values())
        expect(
            bool(measured), "tables.unit", "a unit for every axis", [a.column for a in self.axes.values() if not a.unit]
        )
        expect(set(self.axes) <= set(AXES), "tables.axes", f"some of {', '.join(AXES)}", list(self.axes))
        expect(set(self.order) <= set(AXES), "tables.order", f"some of {', '.join(AXES)}", self.order)
        expect(
            not self.kind or "{" in self.kind or self.kind in KINDS,
            "tables.kind",
            f"one of {', '.join(sorted(KINDS))}",
            self.kind,
        )
        expect(
            self.bounds_mm[0] < self.bounds_mm[1], "tables.bounds_mm", "the shortest, then the longest", self.bounds_mm
        )
        reasons = {rule.outcome for rule in self.reject} | ({self.refused} if self.refused else set())
        expect(
            reasons <= set(REASONS), "tables.reject", f"reasons of {', '.join(REASONS)}", sorted(reasons - set(REASONS))
        )

    @classmethod
    def declared(cls, values: Mapping[str, Any]) -> Table:
        """The table of one `[[tables]]` entry; columns that bear an axis word are axes unless `axes` says otherwise."""
        known = {f.name for f in fields(cls)}
        expect(set(values) <= known, "tables", f"fields of {', '.join(sorted(known))}", sorted(set(values) - known))
        record: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
        axes = record.get("axes") or {name: name for name in record.get("columns", ()) if name in AXES}
        record["axes"] = {axis: Axis.declared(value) for axis, value in axes.items()}
        record["read"] = {name: Cases.declared(value) for name, value in record.get("read", {}).items()}
        for rules in ("only", "reject", "flag"):
            record[rules] = tuple(Rule.declared(rule) for rule in record.get(rules, ()))
        return cls(**record)
