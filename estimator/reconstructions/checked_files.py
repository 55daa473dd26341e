"""Files read with suspicion: bytes, text and JSON, with every fault as one line that names the file."""

from __future__ import annotations

import gc
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from metric_base.faults import FieldFault, InputFault, Words

__all__ = ["ByteReader", "json_array", "json_object", "read_bytes", "read_json", "read_text"]

_JSON_KINDS = {
    type(None): "null", bool: "a truth value", int: "a number", float: "a number", str: "a string",
    list: "an array", dict: "an object",
}  # fmt: skip
_COUNT = struct.Struct("<Q")


def read_bytes(path: Path, most: int = -1) -> bytes:
    """The whole file, or its first bytes; InputFault where it is missing, a folder, unreadable, or empty."""
    try:
        with path.open("rb") as file:
            data = file.read(most)
    except OSError as fault:
        raise InputFault.at(path, "file", "a readable file", Words(fault.strerror or "an error")) from None
    if not data:
        raise InputFault.at(path, "file", "some content", Words("zero bytes"))
    return data


def read_text(path: Path) -> str:
    """The whole file as UTF-8."""
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        found = Words(f"byte {fault.object[fault.start]:#04x} at {fault.start}")
        raise InputFault.at(path, "encoding", "UTF-8", found) from None


def read_json(path: Path) -> Any:
    """The JSON document of a file."""
    text = read_text(path)
    collecting = gc.isenabled()
    gc.disable()  # a document holds no cycles, and looking for them in a million points takes longer than to read it
    try:
        return json.loads(text)
    except RecursionError:
        raise InputFault.at(path, "JSON", "a document of ordinary depth", Words("endless nesting")) from None
    except json.JSONDecodeError as fault:
        found = Words(f"{fault.msg} at line {fault.lineno}, column {fault.colno}")
        raise InputFault.at(path, "JSON", "a valid document", found) from None
    except ValueError as fault:  # an integer of thousands of digits
        raise InputFault.at(path, "JSON", "a valid document", Words(str(fault))) from None
    finally:
        if collecting:
            gc.enable()


def json_object(value: object, field: str = "document") -> dict[str, Any]:
    """`value` if it is a JSON object."""
    if not isinstance(value, dict):
        raise FieldFault(field, "an object", Words(_JSON_KINDS.get(type(value), "something else")))
    return value


def json_array(value: object, field: str = "document") -> list[Any]:
    """`value` if it is a JSON array."""
    if not isinstance(value, list):
        raise FieldFault(field, "an array", Words(_JSON_KINDS.get(type(value), "something else")))
    return value


class ByteReader:
    """A little-endian binary file and a place in it; every count is checked against the bytes that remain."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.data = read_bytes(path)
        self.place = 0

    @property
    def remaining(self) -> int:
        """Bytes from the place to the end."""
        return len(self.data) - self.place

    def take(self, layout: struct.Struct, field: str) -> tuple[Any, ...]:
        """The next values in the layout."""
        self._need(layout.size, field)
        values = layout.unpack_from(self.data, self.place)
        self.place += layout.size
        return values

    def count(self, field: str, smallest: int, layout: struct.Struct = _COUNT) -> int:
        """The next count of records of at least `smallest` bytes each, believed only if they could fit."""
        (found,) = self.take(layout, field)
        if found * smallest > self.remaining:
            expected = f"at most {self.remaining // smallest} (the rest of the file holds no more)"
            raise InputFault.at(self.path, field, expected, found)
        return int(found)

    def rows(self, dtype: DTypeLike, n: int, field: str) -> NDArray[Any]:
        """The next n records as a view of the bytes, without a copy."""
        record = np.dtype(dtype)
        self._need(n * record.itemsize, field)
        rows = np.frombuffer(self.data, dtype=record, count=n, offset=self.place)
        self.place += n * record.itemsize
        return rows

    def name(self, field: str) -> str:
        """The next zero-terminated UTF-8 string."""
        end = self.data.find(b"\0", self.place)
        if end < 0:
            raise InputFault.at(self.path, field, "a name that ends in a zero byte", Words("the end of the file"))
        raw = self.data[self.place : end]
        self.place = end + 1
        try:
            return raw.decode("utf-8")
        except UnicodeDecodeError:
            raise InputFault.at(self.path, field, "UTF-8", raw) from None

    def end(self) -> None:
        """InputFault if bytes are left over: the counts before them cannot be trusted."""
        if self.remaining:
            raise InputFault.at(self.path, "end", "the end of the file", Words(f"{self.remaining} more bytes"))

    def _need(self, size: int, field: str) -> None:
        if size > self.remaining:
            raise InputFault.at(self.path, field, f"{size} bytes", Words(f"{self.remaining} left in the file"))
