"""The declaration of a plain table: which columns hold what, in which unit, and which rows are no object sizes.

The declared sources of open data: one TOML file each under `data/sources`.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath
from typing import Literal

import msgspec

from crawler.items import KINDS, Kind
from crawler.text.cell_lengths import AXES
from crawler.text.units import MILLIMETRES
from metric_base.errors import InputError, expect
from metric_base.folders import data_folder
from metric_base.input_files import read_text
from metric_base.records import BadDeclaration, toml_record

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
#: How the file read here is made of the file at its address: it is that file; the member of a zip archive that
#: has the sha256; the JSON document written anew, on one line or a value a line.
Form = Literal["same", "zip", "json-line", "json-lines"]
#: What an address that follows the newest state of a repository holds: a file that may change.
_MOVING = "/HEAD/"
#: The address of a file in a repository: owner and name, then commit and path.
_RAW_FILE = re.compile(r"https://raw\.githubusercontent\.com/([^/]+/[^/]+)/(.+)")
#: Licences under which rows may be given on inside a wheel of Apache-2.0: no copyleft, no other duty than to name.
OPEN_LICENCES = frozenset(
    {
        "Apache-2.0",
        "BSD-2-Clause",
        "BSD-3-Clause",
        "CC-BY-3.0",
        "CC-BY-3.0-US",
        "CC-BY-4.0",
        "CC0-1.0",
        "MIT",
        "MIT-0",
        "ODC-By-1.0",
        "public-domain-US-government",
    }
)


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


class UnknownSource(BadDeclaration):
    """A source id without a declaration."""


class SourceFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One file of a source: path in the source's folder, sha256 of the file read here, where it is available.

    `form` says how the file is made of the one at `url`; the sha256 is of what is made. `url` is empty where no
    public file yields it (`note` says how it was made): such a file cannot be downloaded and verified.
    """

    path: str
    sha256: str
    url: str = ""
    form: Form = "same"
    note: str = ""

    def __post_init__(self) -> None:
        expect_inside(self.path, "path")
        expect(len(self.sha256) == 64, "sha256", "64 hexadecimal digits", self.sha256)
        expect(bool(self.url or self.note), "url", "an address, or a note why there is none", self.path)


class Source(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One set of open data: where it is from, whose terms hold, what its rows are worth, how it is read."""

    id: str
    title: str
    url: str
    licence: str
    #: Whose terms decide, and how they are known.
    licence_basis: str
    kind: Kind
    #: Who is to be named, and how, where rows are given on.
    attribution: str = ""
    #: Whether rows may be given on with the package.
    ship: bool
    noncommercial: bool = False
    year: int | None = None
    region: str | None = None
    files: tuple[SourceFile, ...] = ()
    #: What is known of the addresses: how far the files there were compared with those read here.
    address: str = ""
    #: What to fetch and to pass by `--input` where a file has no address.
    fetch: str = ""
    tables: tuple[Table, ...] = ()
    #: Module of `crawler.imports` that reads the set where it is no plain table.
    reader: str = ""
    #: Traps of the set and what is done about each.
    traps: tuple[str, ...] = ()
    #: Errors of the set that are mended on the way, each with its mending.
    repairs: tuple[str, ...] = ()
    #: Why no row of the set is an object's size, where that is so.
    excluded: str = ""
    #: At most so many items of one category are kept (lowest hash of the id), so that one set does not own it.
    per_category: int | None = None
    #: Whether identical items (category, title, brand, sizes) become one with a count.
    collapse: bool = True
    #: Whether a title is one object: of several sizes under one title the middle one by volume is taken for all.
    one_per_title: bool = False

    def __post_init__(self) -> None:
        for name in ("title", "url", "licence", "licence_basis"):
            expect(bool(getattr(self, name)), name, "a text", "")
        if self.ship:
            expect(set(self.licence.split(" AND ")) <= OPEN_LICENCES, "ship", "an open licence to ship", self.licence)
            expect(bool(self.attribution), "attribution", "whom to name where rows ship", "")
            expect(not self.noncommercial, "ship", "no non-commercial rows", self.noncommercial)
        known = not self.files or self.downloads != "no" or bool(self.fetch)
        expect(known, "fetch", "what to fetch where a file has no address", "")
        ways = bool(self.tables) + bool(self.reader) + bool(self.excluded)
        expect(ways == 1, "tables", "one of tables, reader, excluded", ways)

    @property
    def page(self) -> str:
        """Where a reader finds the rows that have no page of their own: the one public file, else the set's page."""
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
    """The source that a TOML file declares.

    Raises
    ------
    BadDeclaration
        The file is no TOML, or fields are missing (all are named), unknown or not what they must be.
    """
    read = toml_record(path, Source)
    if read.id != path.stem:
        raise BadDeclaration(f"{path}: id: expected the file's own name {path.stem!r}, found {read.id!r}")
    _read_lists(read, path.parent)
    return read


def _read_lists(source: Source, folder: Path) -> None:
    """Give the rules that name a file of texts those texts."""
    rules = (rule for table in source.tables for rule in (*table.only, *table.reject, *table.flag))
    for rule in rules:
        if rule.listed:
            try:
                texts = read_text(folder / rule.listed, may_be_empty=True).split("\n")
            except InputError as error:
                raise BadDeclaration(str(error)) from None
            msgspec.structs.force_setattr(rule, "texts", frozenset(filter(None, texts)))


def sources(folder: Path | None = None) -> tuple[Source, ...]:
    """All declared sources by id; `folder` is the package's own `data/sources` by default."""
    return tuple(read_source(path) for path in sorted((folder or _own_folder()).glob("*.toml")))


def declared_sources(folder: Path | None = None) -> dict[str, Source]:
    """The package's sources by id, and those of another folder; one of the folder takes the place of the package's.

    Raises
    ------
    BadDeclaration
        The folder has no declaration, or one is invalid.
    """
    own = sources(folder) if folder is not None else ()
    if folder is not None and not own:
        raise BadDeclaration(f"--sources: expected a folder of declarations, SOURCE.toml; found none in {folder}")
    return {one.id: one for one in (*sources(), *own)}


def source(name: str, folder: Path | None = None) -> Source:
    """The source of this id.

    Raises
    ------
    UnknownSource
        No source has the id; the message names those that there are.
    """
    paths = {path.stem: path for path in sorted((folder or _own_folder()).glob("*.toml"))}
    if name not in paths:
        raise UnknownSource(f"source: expected one of {', '.join(paths)}; found {name!r}")
    return read_source(paths[name])


def _own_folder() -> Path:
    return data_folder() / "sources"
