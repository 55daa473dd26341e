"""Readers of untrusted binary files, JSON values and comma-separated values; every count is checked before use."""

from __future__ import annotations

import csv
import math
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import DTypeLike, NDArray

from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, InputError, Unquoted, expect, in_file
from metric_base.input_files import read_bytes, read_text

_JSON_KINDS = {
    type(None): "null", bool: "a truth value", int: "a number", float: "a number", str: "a string",
    list: "an array", dict: "an object",
}  # fmt: skip
_COUNT = struct.Struct("<Q")


def finite_numbers(cells: Iterable[Any], expected: str = "numbers", limit: float = math.inf) -> list[float]:
    """Parse numbers with absolute values below `limit`; FieldError if a cell is another one, or is no number."""
    cells = list(cells)
    try:
        numbers = [float(cell) for cell in cells]
    except (TypeError, ValueError):
        raise FieldError("", expected, cells) from None
    if not all(abs(number) < limit for number in numbers):
        raise FieldError("", "finite numbers" if limit == math.inf else f"finite numbers below {limit:g}", numbers)
    return numbers


def stated_numbers(text: str) -> tuple[float, ...]:
    """Return the finite numbers of a text that a user states, such as `1,2.5`; an empty tuple for other texts."""
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        return ()
    return numbers if all(map(math.isfinite, numbers)) else ()


def json_object(value: object, field: str = "document") -> dict[str, Any]:
    """Return `value` if it is a JSON object, or raise FieldError."""
    if not isinstance(value, dict):
        raise FieldError(field, "an object", Unquoted(_JSON_KINDS.get(type(value), "something else")))
    return value


def json_array(value: object, field: str = "document") -> list[Any]:
    """Return `value` if it is a JSON array, or raise FieldError."""
    if not isinstance(value, list):
        raise FieldError(field, "an array", Unquoted(_JSON_KINDS.get(type(value), "something else")))
    return value


def json_records(value: object, field: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the place `field[index]` and the object of each element of a JSON array of objects."""
    for index, entry in enumerate(json_array(value, field)):
        yield f"{field}[{index}]", json_object(entry, f"{field}[{index}]")


def json_name(value: object, field: str) -> str:
    """Return `value` if it is a JSON text with a visible character, or raise FieldError."""
    if not isinstance(value, str) or not value.strip():
        raise FieldError(field, "a name", value)
    return value


def number_of(entry: Mapping[str, object], name: str, default: float | None = None) -> float:
    """Return a finite number of a JSON object, which several programs write as text."""
    value = entry.get(name, default)
    try:
        number = float(value) if isinstance(value, int | float | str) and not isinstance(value, bool) else math.nan
    except (ValueError, OverflowError):
        number = math.nan
    expect(math.isfinite(number), name, "a number", value)
    return number


def matrix_of(values: object, shape: tuple[int, ...], field: str, limit: float = math.inf) -> FloatArray:
    """Convert values to an array of `shape`, such as (3, 4); FieldError unless they are numbers below `limit`."""
    try:
        matrix = np.array(cast(Any, values), dtype=np.float64).reshape(shape)
    except (TypeError, ValueError, OverflowError):
        matrix = np.full(shape, np.nan)
    numbers = "finite numbers" if limit == math.inf else f"finite numbers below {limit:g}"
    is_valid = (np.abs(matrix) < limit).all()
    expect(is_valid, field, f"{' x '.join(map(str, shape))} {numbers}", Unquoted("others"))
    return matrix


class BinaryReader:
    """Read a little-endian binary file from its start; every count is checked against the remaining bytes."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.data = read_bytes(path)
        self.place = 0

    @property
    def remaining(self) -> int:
        """Return the number of bytes from the current place to the end."""
        return len(self.data) - self.place

    def take(self, layout: struct.Struct, field: str) -> tuple[Any, ...]:
        """Return the next values in the layout."""
        self._need(layout.size, field)
        values = layout.unpack_from(self.data, self.place)
        self.place += layout.size
        return values

    def count(self, field: str, smallest: int, layout: struct.Struct = _COUNT) -> int:
        """Read a count of records of at least `smallest` bytes each; an error if they cannot fit in the file."""
        (count,) = self.take(layout, field)
        if count * smallest > self.remaining:
            expected = f"at most {self.remaining // smallest} (the rest of the file holds no more)"
            raise InputError.at(self.path, field, expected, count)
        return int(count)

    def rows(self, dtype: DTypeLike, n: int, field: str) -> NDArray[Any]:
        """Return the next n records, (n,), as a view of the bytes; InputError if the file has fewer."""
        record = np.dtype(dtype)
        self._need(n * record.itemsize, field)
        rows = np.frombuffer(self.data, dtype=record, count=n, offset=self.place)
        self.place += n * record.itemsize
        return rows

    def name(self, field: str) -> str:
        """Return the next zero-terminated UTF-8 string."""
        end = self.data.find(b"\0", self.place)
        if end < 0:
            raise InputError.at(self.path, field, "a name that ends in a zero byte", Unquoted("the end of the file"))
        raw = self.data[self.place : end]
        self.place = end + 1
        try:
            return raw.decode("utf-8")
        except UnicodeDecodeError:
            raise InputError.at(self.path, field, "UTF-8", raw) from None

    def end(self) -> None:
        """Raise an InputError if bytes remain, because the counts before them are then unreliable."""
        if self.remaining:
            raise InputError.at(self.path, "end", "the end of the file", Unquoted(f"{self.remaining} more bytes"))

    def _need(self, size: int, field: str) -> None:
        if size > self.remaining:
            raise InputError.at(self.path, field, f"{size} bytes", Unquoted(f"{self.remaining} left in the file"))


def csv_rows(file: Path, text: str | None = None) -> tuple[list[str], list[tuple[int, dict[Any, Any]]]]:
    """Return the names of the columns, and each record with its line number; `text` replaces the content of the file.

    Missing cells at the end of a record are None; surplus cells are a list under the key None.

    Raises
    ------
    InputError
        The file cannot be read, or a line is no record.
    """
    reader = csv.DictReader((read_text(file) if text is None else text).splitlines(), skipinitialspace=True)
    try:
        return list(reader.fieldnames or ()), [(reader.line_num, record) for record in reader]
    except csv.Error as error:
        line = reader.line_num + 1
        raise InputError.at(file, f"line {line}", "comma-separated values", Unquoted(str(error))) from None


def table_rows(
    file: Path, columns: Sequence[str], error_type: type[InputError] = InputError
) -> Iterator[tuple[str, dict[str, str]]]:
    """Read the rows of a comma-separated table with a header, as text (`records.read_csv` reads typed records).

    Parameters
    ----------
    file : Path
    columns : sequence of str
        Columns that the table must have; others are ignored.
    error_type : type of InputError

    Yields
    ------
    tuple of str and dict
        The place `file:line`, and the cell of each of `columns`; missing cells at the end of a row are empty.

    Raises
    ------
    InputError
        Of type `error_type`: the file cannot be read or lacks a column.
    """
    try:
        with file.open(encoding="utf-8", newline="") as lines:
            reader = csv.reader(lines)
            header = next(reader, [])
            missing = sorted(set(columns) - set(header))
            with in_file(file, error_type):
                expect(not missing, "header", f"columns {', '.join(columns)}", Unquoted(f"no {', '.join(missing)}"))
            cells = [(name, header.index(name)) for name in columns]
            name_of_file = str(file)
            for row in filter(None, reader):
                filled = [*row, *[""] * (len(header) - len(row))] if len(row) < len(header) else row
                yield f"{name_of_file}:{reader.line_num}", {name: filled[place] for name, place in cells}
    except OSError as error:
        raise error_type(f"{file}: expected a table; found {error.strerror}") from None
