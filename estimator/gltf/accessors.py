"""The numbers of a glTF file: accessors into buffers, strided, normalised, sparse (glTF 2.0, 3.6)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import IntArray
from metric_base.errors import Unquoted, at_field
from metric_base.schema import expect

__all__ = ["Accessors"]

#: Component types by their number in the file.
_KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class Accessors:
    """The accessors of a document; buffers : their bytes, in the order of the file."""

    def __init__(self, header: dict[str, Any], buffers: Sequence[bytes]) -> None:
        self._rows: list[dict[str, Any]] = header.get("accessors", [])
        self._views: list[dict[str, Any]] = header.get("bufferViews", [])
        self._buffers = buffers

    def values(self, number: object, columns: Sequence[int]) -> NDArray[np.float64]:
        """(n, k) numbers of an accessor, k one of `columns`, normalised integers as shares.

        FieldError where it is out of the file, or of another shape.
        """
        raw, row = self._raw(number, columns)
        values = raw.astype(np.float64)
        if row.get("normalized") is True and np.issubdtype(raw.dtype, np.integer):
            values = np.maximum(values / np.iinfo(raw.dtype).max, -1.0)
        return values

    def indices(self, number: object) -> IntArray:
        """(n,) whole numbers of an accessor."""
        raw, _ = self._raw(number, (1,))
        expect(np.issubdtype(raw.dtype, np.integer), "indices", "whole numbers", Unquoted("others"))
        return np.asarray(raw[:, 0].astype(np.int64))

    def _raw(self, number: object, columns: Sequence[int]) -> tuple[NDArray[Any], dict[str, Any]]:
        """(n, k) as stored, and the accessor's record."""
        row = _row(self._rows, number, "accessor")
        with at_field(f"accessors[{number}]"):
            kind = _COLUMNS.get(str(row.get("type")), 0)
            expect(kind in columns, "type", f"{' or '.join(map(str, columns))} numbers each", row.get("type"))
            dtype = self._dtype(row)
            count = int(row.get("count", 0))
            if "bufferView" in row:
                values = self._view_values(row["bufferView"], row.get("byteOffset", 0), count, kind, dtype)
            else:
                values = np.zeros((count, kind), dtype)
            if "sparse" in row:
                values = self._with_sparse(values, row["sparse"])
        return values, row

    def _dtype(self, row: dict[str, Any]) -> np.dtype[Any]:
        number = row.get("componentType")
        expect(number in _KINDS, "componentType", f"one of {', '.join(map(str, _KINDS))}", number)
        return np.dtype(_KINDS[int(str(number))])

    def _view_values(self, view: object, offset: int, count: int, columns: int, dtype: np.dtype[Any]) -> NDArray[Any]:
        """(n, k) values of a buffer's view, in their order: n = count, k = columns."""
        record = _row(self._views, view, "bufferView")
        buffer = record.get("buffer")
        expect(isinstance(buffer, int) and 0 <= buffer < len(self._buffers), "buffer", "one of the file's", buffer)
        start = int(record.get("byteOffset", 0))
        data = self._buffers[int(str(buffer))][start : start + int(record.get("byteLength", 0))]
        size = columns * dtype.itemsize
        stride = int(record.get("byteStride", size))
        needed = offset + stride * (count - 1) + size if count else 0
        expect(stride >= size and needed <= len(data), "bufferView", f"{needed} bytes", Unquoted(f"{len(data)}"))
        rows = np.ndarray((count, size), np.uint8, data, offset, (stride, 1))
        return np.ascontiguousarray(rows).view(dtype).reshape(count, columns)

    def _with_sparse(self, values: NDArray[Any], sparse: dict[str, Any]) -> NDArray[Any]:
        """The values (n, k) with those that the record states in place of others."""
        count, places, new = int(sparse["count"]), sparse["indices"], sparse["values"]
        expect(0 < count <= len(values), "sparse.count", f"at most {len(values)}", count)
        at = self._view_values(places["bufferView"], places.get("byteOffset", 0), count, 1, self._dtype(places))[:, 0]
        expect(bool((at < len(values)).all()), "sparse.indices", f"numbers below {len(values)}", Unquoted("others"))
        values = values.copy()
        values[at] = self._view_values(
            new["bufferView"], new.get("byteOffset", 0), count, values.shape[1], values.dtype
        )
        return values


def _row(rows: list[dict[str, Any]], number: object, field: str) -> dict[str, Any]:
    inside = isinstance(number, int) and not isinstance(number, bool) and 0 <= number < len(rows)
    expect(inside, field, f"a number from 0 to {len(rows) - 1}", number)
    return rows[int(str(number))]
