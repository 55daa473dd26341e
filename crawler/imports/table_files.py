"""Rows of CSV, JSON, JSON Lines, YAML, properties and old Excel files as flat records of text."""

from __future__ import annotations

import csv
import io
import json
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from crawler.imports.declaration import Table
from metric_base.errors import FieldError, InputError, Unquoted, in_file

#: A column in a template, with its filter: `{brand}`, `{title|head}`.
FIELD = re.compile(r"\{([^{}|]+)(?:\|(\w+))?\}")
#: Names that mean a column in every table.
_GIVEN = frozenset({"file", "row"})
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|[_|\s]+")
#: Column to text; the columns of nested records are joined with a full stop.
Row = dict[str, str]
#: Largest file of a table that is read, and most values of one record.
MAX_BYTES, MOST_LEAVES = 1 << 31, 100_000


class MissingColumn(InputError):
    """A file lacks a declared column: another table, or a later form of it, that would yield nothing or nonsense."""


def expect_columns(table: Table, header: Sequence[str]) -> None:
    """See that the header has every column that the declaration reads.

    Raises
    ------
    FieldError
        One is missing: it names those that are missing and those that there are.
    """
    known = _GIVEN.union(table.read, header)
    missing = sorted({column for column in _named_columns(table) if column not in known})
    if missing:
        present = ", ".join(map(repr, header))[:200]
        raise FieldError("columns", ", ".join(map(repr, missing)), Unquoted(present))


def _named_columns(table: Table) -> Iterator[str]:
    """Every column that the table's axes, templates and rules name."""
    for axis in table.columns_of_axes.values():
        yield axis.column
        if axis.minus:
            yield axis.minus
    texts = [table.text, table.id, table.title, table.brand, table.url, table.year, table.region, table.synset]
    texts += [table.scene, table.statistic, table.relative_sd, table.attribution]
    texts += [*table.category, table.kind, table.licence, *(cases.column for cases in table.read.values())]
    for rule in (*table.only, *table.reject, *table.flag):
        if "{" in rule.column:
            texts.append(rule.column)
        else:
            yield rule.column
    yield from table.names
    yield from (match[1] for text in texts for match in FIELD.finditer(text))


def _head(text: str) -> str:
    return re.split(r"[,;(]", text, maxsplit=1)[0].strip()


def _words(text: str) -> str:
    return " ".join(part for part in _CAMEL.split(text) if part).lower()


def _part(text: str) -> str:
    return _head(text.split(":", maxsplit=1)[-1].strip())


# Some museum texts are longer than the csv module's cautious default.
csv.field_size_limit(min(sys.maxsize, 2**31 - 1))


class BadTable(InputError):
    """A file that does not hold the table it should: the message names file, what was expected and found."""


def rows(table: Table, path: Path) -> Iterator[Row]:
    """The rows of one file of a table.

    Raises
    ------
    BadTable
        The file is not of the table's format or encoding, or is empty.
    MissingColumn
        It lacks a column that the declaration reads.
    """
    _see_file(path)
    read = {"csv": _csv, "json": _json, "jsonl": _jsonl, "properties": _properties, "xls": _xls, "yaml": _yaml}[
        table.format
    ]
    try:
        with in_file(path, MissingColumn):
            yield from read(table, path)
    except MissingColumn:
        raise
    except (csv.Error, ValueError, LookupError, TypeError, RecursionError) as error:
        raise BadTable(f"{path}: expected {table.format} in {table.encoding}; found {_one_line(error)}") from None


def record_rows(table: Table, folder: Path) -> Iterator[Row]:
    """The rows of a table whose records lie in a folder, a JSON file each, in the order of their paths.

    Raises
    ------
    BadTable
        There is none, or one of them is not JSON.
    """
    paths = sorted(folder.glob(table.records)) if table.records and folder.is_dir() else []
    if not paths:
        expected = " or ".join([*table.files, *([table.records] if table.records else [])])
        raise BadTable(f"{folder}: expected {expected}; found no such file")
    for path in paths:
        _see_file(path)
        try:
            yield flat(whole_json(path.read_text(encoding=table.encoding)))
        except (ValueError, LookupError, RecursionError) as error:
            raise BadTable(f"{path}: expected json in {table.encoding}; found {_one_line(error)}") from None


def whole_json(text: str | bytes) -> Any:
    r"""What a JSON text holds. Raises ValueError, also for half characters (`\ud800`), which no file can hold."""
    document = json.loads(text)
    if (b"\\ud" if isinstance(text, bytes) else "\\ud") in text.lower():  # type: ignore[operator]  # of one type
        json.dumps(document, ensure_ascii=False).encode()
    return document


def yaml_document(path: Path, encoding: str = "utf-8") -> Any:
    """What a YAML file holds.

    Raises
    ------
    BadTable
        The file is no YAML.
    """
    import yaml

    try:
        return yaml.safe_load(path.read_text(encoding=encoding))
    except (yaml.YAMLError, ValueError, LookupError, RecursionError) as error:
        raise BadTable(f"{path}: expected yaml in {encoding}; found {_one_line(error)}") from None


def flat(record: Any) -> Row:
    """A nested record with one text per leaf, `{"a": {"b": 1}}` as `{"a.b": "1"}`; an absent value is empty.

    Raises
    ------
    ValueError
        It has more than `MOST_LEAVES`: an alias of YAML may stand for a list of itself a billion times.
    """
    row: Row = {}
    for name, value in _leaves(record, ""):
        row[name[:-1]] = "" if value is None else str(value)
        if len(row) > MOST_LEAVES:
            raise ValueError(f"a record of more than {MOST_LEAVES:,} values")
    return row


def _leaves(record: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    entries = record.items() if isinstance(record, Mapping) else enumerate(record) if isinstance(record, list) else None
    if entries is None:
        yield prefix, record
        return
    for key, value in entries:
        yield from _leaves(value, f"{prefix}{key}.")


def _see_file(path: Path) -> None:
    """BadTable for what is no regular file of bounded size."""
    if not path.is_file():
        raise BadTable(f"{path}: expected a file; found {'a folder' if path.is_dir() else 'none'}")
    if path.stat().st_size > MAX_BYTES:
        raise BadTable(f"{path}: expected at most {MAX_BYTES:,} bytes; found {path.stat().st_size:,}")


def _csv(table: Table, path: Path) -> Iterator[Row]:
    with path.open(encoding=table.encoding, newline="") as text:
        for _ in range(table.skip_lines):
            next(text, None)
        reader = csv.reader(text, delimiter=table.delimiter)
        header = list(table.columns) or [name.strip() for name in next(reader, [])]
        if not header:
            raise BadTable(f"{path}: expected a header line; found an empty file")
        expect_columns(table, header)
        for cells in reader:
            if any(cell.strip() for cell in cells):
                yield dict(zip(header, (cell.strip() for cell in cells), strict=False))


def _json(table: Table, path: Path) -> Iterator[Row]:
    yield from _records(whole_json(path.read_text(encoding=table.encoding)), table.each)


def _jsonl(table: Table, path: Path) -> Iterator[Row]:
    with path.open(encoding=table.encoding) as lines:
        for line in lines:
            if line.strip():
                yield flat(whole_json(line))


def _yaml(table: Table, path: Path) -> Iterator[Row]:
    yield from _records(yaml_document(path, table.encoding), table.each)


def _properties(table: Table, path: Path) -> Iterator[Row]:
    """The records of a Java properties file whose keys end in the record's number, `width#12=80`."""
    records: dict[str, Row] = {}
    for line in path.read_text(encoding=table.encoding).splitlines():
        name, numbered, rest = line.partition("#")
        number, equals, value = rest.partition("=")
        if name and numbered and equals and number.isdigit():
            records.setdefault(number, {"key": number})[name] = value.strip()
    yield from records.values()


def _xls(table: Table, path: Path) -> Iterator[Row]:
    import xlrd

    try:
        sheet = xlrd.open_workbook(str(path), logfile=io.StringIO()).sheet_by_index(0)
    except Exception as error:  # noqa: BLE001 - xlrd raises whatever it trips over in a damaged file
        raise BadTable(f"{path}: expected an Excel file (.xls); found {_one_line(error)}") from None
    lines = [[_excel_text(cell) for cell in sheet.row_values(i)] for i in range(sheet.nrows)]
    header = list(table.columns) or [" ".join(name.split()) for name in lines[table.skip_lines]]
    expect_columns(table, header)
    for cells in lines[table.skip_lines + (0 if table.columns else 1) :]:
        yield dict(zip(header, cells, strict=False))


def _excel_text(cell: object) -> str:
    """A cell as text; Excel keeps the model number 177 as 177.0."""
    return str(int(cell)) if isinstance(cell, float) and cell.is_integer() else str(cell).strip()


def _records(tree: Any, each: str) -> Iterator[Row]:
    """The records that the path `each` reaches (`records/*`); the keys on the way are in `key`, `key2`, ..."""
    reached: list[tuple[tuple[str, ...], Any]] = [((), tree)]
    for step in each.split("/") if each else []:
        if step == "*":
            reached = [((*keys, str(key)), value) for keys, node in reached for key, value in _entries(node)]
        else:
            reached = [(keys, node[step]) for keys, node in reached]
    for keys, record in reached:
        names = ("key", *(f"key{n}" for n in range(2, len(keys) + 1)))
        yield dict(zip(names, keys, strict=False)) | flat(record)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]


def _entries(node: Any) -> Iterator[tuple[Any, Any]]:
    return iter(node.items()) if isinstance(node, Mapping) else iter(enumerate(node))
