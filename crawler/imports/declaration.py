"""Declarations of sources of open data, one TOML file each in `data/sources`, and of their tables.

The declaration of a table states the columns of the sizes and their units, the columns of other fields, and rules for
rows that are not sizes of objects.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath
from typing import Literal

import msgspec

from crawler.items import KINDS, Kind
from crawler.text.cell_lengths import AXES
from metric_base.errors import InputError, expect
from metric_base.folders import data_folder
from metric_base.input_files import read_text
from metric_base.length_units import MILLIMETRES
from metric_base.records import BadDeclaration, toml_record
from metric_base.text_tables import named_texts

Format = Literal["csv", "json", "jsonl", "properties", "xls", "yaml"]
#: Reasons of rejected rows, by code.
REASONS = named_texts(Path(__file__).with_name("reasons.txt"))
#: Minimum and maximum extent in mm of a table that declares no bounds: finer than any object, longer than any ship.
BOUNDS_MM = (0.1, 500_000.0)
#: Relation of a file to the one at its address: the same file, the member of a zip archive with the SHA-256, or the
#: JSON document on one line or with one value per line.
Form = Literal["same", "zip", "json-line", "json-lines"]
#: Part of addresses that follow the newest state of a repository, so that the file may change.
_MOVING = "/HEAD/"
#: Address of a file in a repository: owner and name, then commit and path.
_RAW_FILE = re.compile(r"https://raw\.githubusercontent\.com/([^/]+/[^/]+)/(.+)")
#: Licences that permit to redistribute rows in a wheel under Apache-2.0: no copyleft, attribution only.
OPEN_LICENCES = frozenset({
    "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "CC-BY-3.0", "CC-BY-3.0-US", "CC-BY-4.0", "CC0-1.0", "MIT", "MIT-0",
    "ODC-By-1.0", "public-domain-US-government",
})  # fmt: skip


class _Declared(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A part of a declaration; unknown fields are errors."""


class Axis(_Declared, frozen=True, kw_only=True):
    """The column of an axis."""

    column: str
    minus: str = ""  #: Column to subtract, for boxes with the coordinates of two sides.
    pattern: str = ""  #: Regular expression whose first group is the length.
    unit: str | None = None  #: None: that of the table.
    factor: float = 1.0  #: Factor for unusual units (200 for abalone, in multiples of 200 mm).

    def __post_init__(self) -> None:
        expect(self.unit in {None, *MILLIMETRES}, "unit", f"one of {', '.join(MILLIMETRES)}", self.unit)


class Amount(_Declared, frozen=True, kw_only=True):
    """The column of a mass or a volume."""

    column: str
    factor: float = 1.0  #: Kilograms or litres in a unit of the column.


class Rule(_Declared, frozen=True, kw_only=True):
    """A test of a column, and its consequence."""

    column: str  #: Column, or template of several: `{depth}|{description}`.
    #: Code of `REASONS` of a rule that rejects rows, flag of a rule that marks them; otherwise empty.
    outcome: str = ""
    matches: re.Pattern[str] | None = None
    listed: str = ""  #: File in the folder of the declaration with the texts to which the rule applies, one per line.
    texts: frozenset[str] = frozenset()  #: Texts of this file.
    below: float | None = None
    above: float | None = None

    def __post_init__(self) -> None:
        tests = (self.matches, self.listed or None, self.below, self.above)
        expect(any(test is not None for test in tests), "rule", "matches, listed, below or above", self.column)
        expect_inside(self.listed, "listed")


class Cases(_Declared, frozen=True, kw_only=True):
    r"""A column that is derived from others."""

    column: str  #: Template of the text to search.
    cases: tuple[tuple[re.Pattern[str], str], ...]  #: Patterns and values; `\1` is the first group of the pattern.
    default: str = ""  #: Template of the value if no pattern matches.


class Table(_Declared, frozen=True, kw_only=True):
    """A table of a source.

    Texts are templates of columns, `{brand} {model}`. `{file}` is the name of the file without its ending, and `{row}`
    the number of the row. Filters follow a bar: `{type|words}` separates the words of CamelCase and underscores,
    `{title|head}` ends at the first comma or bracket, `{title|part}` is the head after the first colon, and `{x|lower}`
    is in lower case.
    """

    files: tuple[str, ...]  #: Glob patterns, relative to the folder of the source.
    #: Glob pattern of JSON files with one record each, read in the order of their paths if `files` are missing: the
    #: published form of a table that was merged into one file.
    records: str = ""
    rest: bool = False  #: Read only files that no other table of the source reads, possibly none.
    format: Format = "csv"
    delimiter: str = ","
    encoding: str = "utf-8-sig"
    columns: tuple[str, ...] = ()  #: Names of the columns, if the file has no header.
    skip_lines: int = 0  #: Number of lines before the header.
    each: str = "*"  #: Path to the records of a JSON or YAML file, with `*` for all keys or elements: `records/*`.
    unit: str | None = None
    decimal: Literal[".", ","] | None = None
    id: str = "{file}-{row}"
    title: str = ""
    category: tuple[str, ...] = ()
    category_separator: str = ""  #: Separator of a breadcrumb in one column, ` | `.
    brand: str = ""
    url: str = ""
    year: str = ""
    region: str = ""
    scene: str = ""  #: Room or drive of the measurement, `{scan}`.
    statistic: str = ""  #: Statistic of a row about several objects; `instance` or empty for a row about one object.
    relative_sd: str = ""  #: Standard deviation divided by the mean, for a statistic.
    attribution: str = ""
    synset: str = ""
    kind: str = ""
    licence: str = ""
    axes: dict[str, str | Axis] = {}
    text: str = ""  #: Template of a text with the complete size.
    text_pattern: str = ""  #: Regular expression whose first group is the size in this text.
    order: tuple[str, ...] = ()  #: Axes of the numbers in this text, if it does not name them.
    mass_kg: Amount | None = None
    volume_l: Amount | None = None  #: Volume or capacity, as the source defines it.
    labelled: bool = True  #: False if the axes are unknown; then only `extents_mm` is stored.
    only: tuple[Rule, ...] = ()
    reject: tuple[Rule, ...] = ()
    flag: tuple[Rule, ...] = ()
    flags: tuple[str, ...] = ()
    names: dict[str, dict[str, str]] = {}  #: Replacements of the values of a column: `{"sdn" = "saloon"}`.
    read: dict[str, Cases] = {}  #: Derived columns, for use in rules and templates.
    bounds_mm: tuple[float, float] = BOUNDS_MM  #: Minimum and maximum extent.
    refused: str = ""  #: Code of `REASONS` if all rows are rejected.
    note: str = ""  #: Explanation of `refused`.

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
        kinds = f"one of {', '.join(sorted(KINDS))}"
        expect(not self.kind or "{" in self.kind or self.kind in KINDS, "kind", kinds, self.kind)
        shortest, longest = self.bounds_mm
        expect(shortest < longest, "bounds_mm", "the shortest, then the longest", self.bounds_mm)
        _expect_some({rule.outcome for rule in self.reject} | ({self.refused} - {""}), "reject", REASONS)

    @property
    def columns_of_axes(self) -> Mapping[str, Axis]:
        """Columns by axis."""
        return {name: axis for name, axis in self.axes.items() if isinstance(axis, Axis)}


def expect_inside(path: str, field: str) -> None:
    """Raise FieldError if a path or glob pattern leads out of its folder."""
    parts = PurePosixPath(path.replace("\\", "/"))
    outside = parts.is_absolute() or ".." in parts.parts or ":" in path or "\0" in path
    expect(not outside, field, "a path inside the source's folder", path)


def _expect_some(given: Iterable[str], field: str, known: Iterable[str]) -> None:
    unknown = sorted(set(given) - set(known))
    expect(not unknown, field, f"some of {', '.join(known)}", unknown)


class UnknownSource(BadDeclaration):
    """No source has this id."""


class SourceFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A file of a source."""

    path: str  #: Path in the folder of the source.
    sha256: str
    url: str = ""  #: Public address; empty if the file cannot be made from a public file (see `note`).
    form: Form = "same"
    note: str = ""  #: Origin of a file without an address.

    def __post_init__(self) -> None:
        expect_inside(self.path, "path")
        expect(len(self.sha256) == 64, "sha256", "64 hexadecimal digits", self.sha256)
        expect(bool(self.url or self.note), "url", "an address, or a note why there is none", self.path)


class Source(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A set of open data: origin, terms, kind of evidence, and tables."""

    id: str
    title: str
    url: str
    licence: str
    licence_basis: str  #: Origin of the licence.
    kind: Kind
    attribution: str = ""  #: Attribution that redistribution requires.
    ship: bool  #: Rows may be redistributed in the package.
    noncommercial: bool = False
    year: int | None = None
    region: str | None = None
    files: tuple[SourceFile, ...] = ()
    address: str = ""  #: Comparison of the files at the addresses with the declared files.
    fetch: str = ""  #: Files to fetch and to pass by `--input`, if a file has no address.
    tables: tuple[Table, ...] = ()
    reader: str = ""  #: Module of `crawler.imports` that reads a set that is not a plain table.
    traps: tuple[str, ...] = ()  #: Traps of the set, and their treatment.
    repairs: tuple[str, ...] = ()  #: Errors of the set that are corrected, and their correction.
    excluded: str = ""  #: Reason why no row of the set is the size of an object; otherwise empty.
    #: Maximum number of items of a category (lowest hashes of the ids), so that no set dominates a category.
    per_category: int | None = None
    collapse: bool = True  #: Merge identical items (category, title, brand, sizes) into one with a count.
    one_per_title: bool = False  #: A title is one object: of several sizes, the one of median volume is used.

    def __post_init__(self) -> None:
        for name in ("title", "url", "licence", "licence_basis"):
            expect(bool(getattr(self, name)), name, "a text", "")
        if self.ship:
            expect(set(self.licence.split(" AND ")) <= OPEN_LICENCES, "ship", "an open licence to ship", self.licence)
            expect(bool(self.attribution), "attribution", "an attribution, because rows ship", "")
            expect(not self.noncommercial, "ship", "no non-commercial rows", self.noncommercial)
        is_available = not self.files or self.downloads != "no" or bool(self.fetch)
        expect(is_available, "fetch", "the files to fetch, because one has no address", "")
        count = bool(self.tables) + bool(self.reader) + bool(self.excluded)
        expect(count == 1, "tables", "one of tables, reader, excluded", count)

    @property
    def page(self) -> str:
        """Address of rows without a separate page: the file, if there is a single one, else the page of the set."""
        addresses = {file.url for file in self.files if file.url}
        address = addresses.pop() if len(addresses) == 1 else self.url
        raw = _RAW_FILE.fullmatch(address)
        return f"https://github.com/{raw[1]}/blob/{raw[2]}" if raw else address

    @property
    def downloads(self) -> str:
        """Return whether the files can be downloaded: yes, no, or only while their repository is unchanged."""
        if not self.files or not all(file.url for file in self.files):
            return "no"
        return "while unchanged" if any(_MOVING in file.url for file in self.files) else "yes"


def read_source(path: Path) -> Source:
    """Read the declaration of a source, with the files of texts that its rules name.

    Raises
    ------
    BadDeclaration
        The file is not TOML, or fields are missing (all are named), unknown or invalid.
    """
    source = toml_record(path, Source)
    if source.id != path.stem:
        raise BadDeclaration(f"{path}: id: expected the name of the file, {path.stem!r}; found {source.id!r}")
    for rule in (rule for table in source.tables for rule in (*table.only, *table.reject, *table.flag)):
        if rule.listed:
            try:
                texts = read_text(path.parent / rule.listed, may_be_empty=True).split("\n")
            except InputError as error:
                raise BadDeclaration(str(error)) from None
            msgspec.structs.force_setattr(rule, "texts", frozenset(filter(None, texts)))
    return source


def sources(folder: Path | None = None) -> tuple[Source, ...]:
    """Return all declared sources of a folder by id, by default of `data/sources`.

    Raises
    ------
    BadDeclaration
        The folder contains no declaration, or an invalid one.
    """
    declared = tuple(read_source(path) for path in sorted((folder or data_folder() / "sources").glob("*.toml")))
    if not declared:
        raise BadDeclaration(f"--sources: expected a folder of declarations, SOURCE.toml; found none in {folder}")
    return declared


def declared_sources(folder: Path | None = None) -> dict[str, Source]:
    """Return the sources of the package and of another folder by id; the latter replace the former.

    Raises
    ------
    BadDeclaration
        The folder contains no declaration, or an invalid one.
    """
    return {source.id: source for source in (*sources(), *(sources(folder) if folder is not None else ()))}


def source(name: str, folder: Path | None = None) -> Source:
    """Return the source of an id.

    Raises
    ------
    UnknownSource
        No source has this id; the message names all ids.
    """
    paths = {path.stem: path for path in sorted((folder or data_folder() / "sources").glob("*.toml"))}
    if name not in paths:
        raise UnknownSource(f"source: expected one of {', '.join(paths)}; found {name!r}")
    return read_source(paths[name])
