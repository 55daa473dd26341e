"""The declared sources of open data: one TOML file each under `data/sources`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

import msgspec

from crawler.imports.declaration import Table, expect_inside
from crawler.items import Kind
from metric_base.errors import InputError
from metric_base.folders import data_folder
from metric_base.input_files import read_text
from metric_base.records import BadDeclaration, expect, toml_record

__all__ = [
    "OPEN_LICENCES",
    "BadDeclaration",
    "Form",
    "Source",
    "SourceFile",
    "UnknownSource",
    "declared_sources",
    "read_source",
    "source",
    "sources",
]

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
        """Whether the files can be downloaded: yes, no, or only while their repository keeps them as they were."""
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
