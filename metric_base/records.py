"""Typed records from JSON, JSON Lines, TOML and CSV; an error states the field, the expected and the found value.

Records are dataclasses or `msgspec.Struct`s. Their `__post_init__` checks with `expect` what a type cannot express.
Field, expected and found value are parsed from the message of msgspec, because its exception has no other attributes.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from metric_base.errors import FieldError, InputError, Unquoted, expect, in_file
from metric_base.escaping import visible
from metric_base.input_files import read_text
from metric_base.parsing import table_rows

Record = TypeVar("Record")
_PLACE = re.compile(r" - at `(key in )?`?\$?\.?([^`]*)`$")
_MISSING = re.compile(r"Object missing required field `(\w+)`")
_UNKNOWN = re.compile(r"Object contains unknown field `(\w+)`")
_TYPES = re.compile(r"Expected (.*), got (.*)")
#: Largest TOML file; the largest that ships has 14,000 bytes.
MAX_TOML_BYTES = 1 << 22


class BadDeclaration(InputError):
    """A TOML file is invalid."""


def record_of(values: object, kind: type[Record], *, cells: bool = False) -> Record:
    """Convert parsed values to a record; values of CSV `cells` are texts.

    Raises
    ------
    FieldError
        A field is missing, unknown or invalid.
    """
    try:
        return msgspec.convert(values, kind, strict=not cells, dec_hook=_pattern)
    except msgspec.ValidationError as error:
        raise _field_error(error, kind) from None


def json_record(line: str | bytes, kind: type[Record]) -> Record:
    """Parse a JSON object to a record.

    Raises
    ------
    FieldError
        The text is not a JSON object, or a field is missing, unknown or invalid.
    """
    try:
        return msgspec.json.decode(line, type=kind)
    except msgspec.ValidationError as error:
        raise _field_error(error, kind) from None
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise FieldError("line", "a JSON object", Unquoted(str(error))) from None


def json_lines(
    path: Path, kind: type[Record], error_type: type[InputError] = InputError
) -> Iterator[tuple[str, Record]]:
    """The records of a JSON Lines file, each with its place `file:line`; blank lines are passed over.

    Raises
    ------
    InputError
        Of the type `error_type`: a line is not such a record; the message names file and line.
    """
    for number, line in enumerate(read_text(path, may_be_empty=True).split("\n"), start=1):  # U+2028 ends no line
        if line.strip():
            with in_file(f"{path}:{number}", error_type) as place:
                record = json_record(line, kind)
            yield place, record


def read_csv(path: Path, kind: type[Record], error_type: type[InputError] = InputError) -> Iterator[tuple[str, Record]]:
    """Read the rows of a comma-separated table of ours as records.

    The columns are the fields of `kind`; other columns are ignored. An empty cell is an omitted field.

    Yields
    ------
    tuple of str and Record
        The place `file:line`, and the record.

    Raises
    ------
    InputError
        Of type `error_type`: the file cannot be read, lacks a column, or a cell is invalid.
    """
    for place, row in table_rows(path, tuple(_fields(kind)), error_type):
        with in_file(place, error_type):
            try:
                record = record_of({name: cell for name, cell in row.items() if cell}, kind, cells=True)
            except FieldError as error:
                expected = re.sub(r"\bfloat\b", "a number", error.expected.replace(" | null", ""))
                raise FieldError(error.field, expected, row.get(error.field) or Unquoted("none")) from None
        yield place, record


def toml_table(path: Path, error_type: type[InputError] = BadDeclaration) -> dict[str, Any]:
    """Read the values of a TOML file.

    Raises
    ------
    InputError
        Of the type `error_type`: the file cannot be read or is not TOML.
    """
    import tomllib  # here, because queries read no TOML

    try:
        return tomllib.loads(read_text(path, MAX_TOML_BYTES, may_be_empty=True))
    except (ValueError, RecursionError) as error:  # no TOML, no UTF-8, a number of thousands of digits
        words = str(error).removeprefix(f"{path}: ").split()
        raise error_type(f"{path}: expected TOML, found: {' '.join(words)}") from None


def toml_record(path: Path, kind: type[Record], error_type: type[InputError] = BadDeclaration) -> Record:
    """Read the record of a TOML file.

    Raises
    ------
    InputError
        Of the type `error_type`: the file cannot be read or is not TOML; fields are missing (all are named), unknown,
        or invalid.
    """
    values = toml_table(path, error_type)
    with in_file(path, error_type):
        required = [name for name, is_required in _fields(kind).items() if is_required]
        missing = [name for name in required if name not in values]
        expect(not missing, "fields", ", ".join(required), Unquoted(f"no {', '.join(missing)}"))
        return record_of(values, kind)


def _fields(kind: type) -> dict[str, bool]:
    """Return True if each field is required, by name."""
    return {one.name: one.required for one in msgspec.structs.fields(kind)}


def _field_error(error: msgspec.ValidationError, kind: type) -> FieldError:
    """Convert an error of msgspec to place, expected and found value."""
    match = _PLACE.search(str(error))
    place, message = match[2] if match else "", _PLACE.sub("", str(error))
    if isinstance(error.__cause__, FieldError):
        inner = error.__cause__
        return FieldError(".".join(filter(None, (place, inner.field))), inner.expected, inner.found)
    for pattern, expected, found in ((_MISSING, "a value", "none"), (_UNKNOWN, "a known field", "an unknown one")):
        if named := pattern.search(message):
            return FieldError(".".join(filter(None, (place, named[1]))), expected, Unquoted(found))
    if value := re.fullmatch(r"Invalid enum value (.*)", message):
        words = ", ".join(sorted(_words(kind, re.split(r"[.\]]", place)[-1])))
        return FieldError(place, f"one of {words}", Unquoted(value[1]))
    if types := _TYPES.fullmatch(message):
        expected = types[1].replace("`", "") if place else "a JSON object"
        return FieldError(place, expected, Unquoted(types[2].replace("`", "")))
    return FieldError(place, message.removeprefix("Expected ").replace("`", ""), Unquoted("another value"))


@cache
def _words(kind: type, name: str) -> frozenset[str]:
    """The words that a field of this name may hold, in a record or in the records inside it."""
    words: set[str] = set()
    for field, hint in get_type_hints(kind).items():
        parts = (hint, *get_args(hint))
        if field == name:
            words.update(str(word) for part in parts if get_origin(part) is Literal for word in get_args(part))
        for part in parts:
            if isinstance(part, type) and (issubclass(part, msgspec.Struct) or is_dataclass(part)):
                words |= _words(part, name)
    return frozenset(words)


def _pattern(kind: type, value: Any) -> Any:
    """A regular expression of a text."""
    if "Pattern" not in str(kind) or not isinstance(value, str):
        raise FieldError("", "a regular expression", value)
    try:
        return re.compile(value, re.IGNORECASE)
    except re.error as error:
        raise FieldError("", f"a regular expression ({error})", value) from None


def csv_text(head: Sequence[str], rows: Iterable[Iterable[Any]]) -> bytes:
    """A table as CSV in UTF-8, with the cells of `csv_cell`."""
    sink = io.StringIO()
    writer = csv.writer(sink, lineterminator="\n")
    writer.writerow(head)
    writer.writerows([csv_cell(value) for value in row] for row in rows)
    return sink.getvalue().encode()


def csv_cell(value: Any) -> Any:
    """A value for CSV: lists joined, invisible characters written out, an apostrophe before a spreadsheet's formula."""
    if isinstance(value, list):
        return " ".join(map(str, value))
    if not isinstance(value, str):
        return value
    return visible(f"'{value}" if value.lstrip().startswith(("=", "+", "-", "@")) else value)
