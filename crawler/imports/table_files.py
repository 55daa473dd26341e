"""Read the rows of CSV, JSON, JSON Lines, YAML, properties and old Excel files as flat records of text."""

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
#: Names of columns that every table has.
_GENERATED_COLUMNS = frozenset({"file", "row"})
#: Text by column; the names of nested records are joined by full stops.
Row = dict[str, str]
#: Maximum size of a file in bytes.
MAX_BYTES = 1 << 31
#: Maximum number of values of a record.
MAX_LEAVES = 100_000


class MissingColumn(InputError):
    """A file lacks a declared column: it is another table, or a later version of it."""


def check_columns(table: Table, header: Sequence[str]) -> None:
    """Check that the header has every column of the axes, templates and rules of a declaration.

    Raises
    ------
    FieldError
        Columns are missing; the message names them and the columns of the header.
    """
    columns = {column for axis in table.columns_of_axes.values() for column in (axis.column, axis.minus) if column}
    texts = [table.text, table.id, table.title, table.brand, table.url, table.year, table.region, table.synset]
    texts += [table.scene, table.statistic, table.relative_sd, table.attribution]
    texts += [*table.category, table.kind, table.licence, *(cases.column for cases in table.read.values())]
    for rule in (*table.only, *table.reject, *table.flag):
        if "{" in rule.column:
            texts.append(rule.column)
        else:
            columns.add(rule.column)
    columns |= {*table.names, *(match[1] for text in texts for match in FIELD.finditer(text))}
    missing = sorted(columns - _GENERATED_COLUMNS.union(table.read, header))
    if missing:
        raise FieldError("columns", ", ".join(map(repr, missing)), Unquoted(", ".join(map(repr, header))[:200]))


# some texts of museums are longer than the default of the csv module
csv.field_size_limit(min(sys.maxsize, 2**31 - 1))


class BadTable(InputError):
    """A file does not contain the declared table."""


def rows(table: Table, path: Path) -> Iterator[Row]:
    """Return the rows of a file of a table.

    Raises
    ------
    BadTable
        The file has another format or encoding, or is empty.
    MissingColumn
        The file lacks a column of the declaration.
    """
    _check_file(path)
    try:
        with in_file(path, MissingColumn):
            if table.format in {"csv", "xls"}:
                yield from _csv_rows(table, path) if table.format == "csv" else _xls_rows(table, path)
            elif table.format == "jsonl":
                with path.open(encoding=table.encoding) as lines:
                    yield from (flat(whole_json(line)) for line in lines if line.strip())
            elif table.format == "properties":
                yield from _property_rows(table, path)
            elif table.format == "json":
                yield from _records(whole_json(path.read_text(encoding=table.encoding)), table.each)
            else:
                yield from _records(yaml_document(path, table.encoding), table.each)
    except MissingColumn:
        raise
    except (csv.Error, ValueError, LookupError, TypeError, RecursionError) as error:
        raise BadTable(f"{path}: expected {table.format} in {table.encoding}; found {_one_line(error)}") from None


def record_rows(table: Table, folder: Path) -> Iterator[Row]:
    """Return the rows of a table whose records are separate JSON files, in the order of their paths.

    Raises
    ------
    BadTable
        There is no such file, or one of them is not JSON.
    """
    paths = sorted(folder.glob(table.records)) if table.records and folder.is_dir() else []
    if not paths:
        expected = " or ".join([*table.files, *([table.records] if table.records else [])])
        raise BadTable(f"{folder}: expected {expected}; found no such file")
    for path in paths:
        _check_file(path)
        try:
            yield flat(whole_json(path.read_text(encoding=table.encoding)))
        except (ValueError, LookupError, RecursionError) as error:
            raise BadTable(f"{path}: expected json in {table.encoding}; found {_one_line(error)}") from None


def whole_json(text: str | bytes) -> Any:
    r"""Parse a JSON text. Raises ValueError, also for lone surrogates (`\ud800`), which cannot be written to a file."""
    document = json.loads(text)
    if (b"\\ud" if isinstance(text, bytes) else "\\ud") in text.lower():  # type: ignore[operator]  # of one type
        json.dumps(document, ensure_ascii=False).encode()
    return document


def yaml_document(path: Path, encoding: str = "utf-8") -> Any:
    """Parse a YAML file.

    Raises
    ------
    BadTable
        The file is not YAML.
    """
    import yaml

    try:
        return yaml.safe_load(path.read_text(encoding=encoding))
    except (yaml.YAMLError, ValueError, LookupError, RecursionError) as error:
        raise BadTable(f"{path}: expected yaml in {encoding}; found {_one_line(error)}") from None


def flat(record: Any) -> Row:
    """Flatten a nested record, `{"a": {"b": 1}}` to `{"a.b": "1"}`; missing values are empty.

    Raises
    ------
    ValueError
        The record has more than `MAX_LEAVES` values; aliases in YAML can multiply a list a billion times.
    """
    row: Row = {}
    for name, value in _leaves(record, ""):
        row[name[:-1]] = "" if value is None else str(value)
        if len(row) > MAX_LEAVES:
            raise ValueError(f"a record of more than {MAX_LEAVES:,} values")
    return row


def _leaves(record: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    entries = record.items() if isinstance(record, Mapping) else enumerate(record) if isinstance(record, list) else None
    if entries is None:
        yield prefix, record
        return
    for key, value in entries:
        yield from _leaves(value, f"{prefix}{key}.")


def _check_file(path: Path) -> None:
    """Raise `BadTable` if a path is not a regular file of at most `MAX_BYTES`."""
    if not path.is_file():
        raise BadTable(f"{path}: expected a file; found {'a folder' if path.is_dir() else 'none'}")
    if path.stat().st_size > MAX_BYTES:
        raise BadTable(f"{path}: expected at most {MAX_BYTES:,} bytes; found {path.stat().st_size:,}")


def _csv_rows(table: Table, path: Path) -> Iterator[Row]:
    with path.open(encoding=table.encoding, newline="") as text:
        for _ in range(table.skip_lines):
            next(text, None)
        reader = csv.reader(text, delimiter=table.delimiter)
        header = list(table.columns) or [name.strip() for name in next(reader, [])]
        if not header:
            raise BadTable(f"{path}: expected a header line; found an empty file")
        check_columns(table, header)
        for cells in reader:
            if any(cell.strip() for cell in cells):
                yield dict(zip(header, (cell.strip() for cell in cells), strict=False))


def _property_rows(table: Table, path: Path) -> Iterator[Row]:
    """Return the records of a Java properties file whose keys end in the number of the record: `width#12=80`."""
    records: dict[str, Row] = {}
    for line in path.read_text(encoding=table.encoding).splitlines():
        name, numbered, rest = line.partition("#")
        number, equals, value = rest.partition("=")
        if name and numbered and equals and number.isdigit():
            records.setdefault(number, {"key": number})[name] = value.strip()
    yield from records.values()


def _xls_rows(table: Table, path: Path) -> Iterator[Row]:
    import xlrd

    try:
        sheet = xlrd.open_workbook(str(path), logfile=io.StringIO()).sheet_by_index(0)
    except Exception as error:  # noqa: BLE001 - xlrd raises any error for a damaged file
        raise BadTable(f"{path}: expected an Excel file (.xls); found {_one_line(error)}") from None

    def text(cell: Any) -> str:  # Excel stores the model number 177 as 177.0
        return str(int(cell)) if isinstance(cell, float) and cell.is_integer() else str(cell).strip()

    lines = [list(map(text, sheet.row_values(row))) for row in range(sheet.nrows)]
    header = list(table.columns) or [" ".join(name.split()) for name in lines[table.skip_lines]]
    check_columns(table, header)
    for cells in lines[table.skip_lines + (0 if table.columns else 1) :]:
        yield dict(zip(header, cells, strict=False))


def _records(tree: Any, each: str) -> Iterator[Row]:
    """Return the records at the path `each` (`records/*`), with the keys of its `*` in `key`, `key2`, ..."""
    reached: list[tuple[tuple[str, ...], Any]] = [((), tree)]
    for step in each.split("/") if each else []:
        if step == "*":
            reached = [
                ((*keys, str(key)), value)
                for keys, node in reached
                for key, value in (node.items() if isinstance(node, Mapping) else enumerate(node))
            ]
        else:
            reached = [(keys, node[step]) for keys, node in reached]
    for keys, record in reached:
        names = ("key", *(f"key{n}" for n in range(2, len(keys) + 1)))
        yield dict(zip(names, keys, strict=False)) | flat(record)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
