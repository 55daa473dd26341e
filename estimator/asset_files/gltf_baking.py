"""A glTF file with its vertices, translations, bindings and movements times a factor, without a node above them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from metric_base.errors import Unquoted, at_field
from metric_base.schema import expect

__all__ = ["bake"]

_FLOAT = 5126
#: Bytes of a chunk's head: its length and its kind.
_HEAD = 8


def bake(header: dict[str, Any], binary: bytearray, factor: float) -> bytes:
    """Multiply all lengths of a GLB's record and of its binary chunk (with its head); the chunk's bytes are returned.

    FieldError for a file whose buffers are other files, or whose vertices are no plain 32-bit numbers.
    """
    buffers = header.get("buffers", [])
    whole = len(buffers) <= 1 and all("uri" not in buffer for buffer in buffers)
    expect(
        whole, "buffers", "one buffer in the file itself (without --bake any file goes)", Unquoted(f"{len(buffers)}")
    )
    for number, columns in sorted(_length_accessors(header)):
        with at_field(f"accessors[{number}]"):
            _scale(header, header["accessors"][number], binary, columns, factor)
    for node in header.get("nodes", []):
        if "translation" in node:
            node["translation"] = [value * factor for value in node["translation"]]
        if "matrix" in node:
            node["matrix"][12:15] = [value * factor for value in node["matrix"][12:15]]
    return bytes(binary)


def _length_accessors(header: dict[str, Any]) -> Iterator[tuple[int, tuple[int, ...]]]:
    """The accessors that hold lengths, each once, with the columns that do."""
    columns: dict[int, tuple[int, ...]] = {}
    for mesh in header.get("meshes", []):
        for part in mesh.get("primitives", []):
            for attributes in (part.get("attributes", {}), *part.get("targets", [])):
                if "POSITION" in attributes:
                    columns[attributes["POSITION"]] = (0, 1, 2)
    for skin in header.get("skins", []):
        if "inverseBindMatrices" in skin:
            columns[skin["inverseBindMatrices"]] = (12, 13, 14)
    for animation in header.get("animations", []):
        for channel in animation.get("channels", []):
            if channel.get("target", {}).get("path") == "translation":
                columns[animation["samplers"][channel["sampler"]]["output"]] = (0, 1, 2)
    yield from columns.items()


def _scale(
    header: dict[str, Any], row: dict[str, Any], binary: bytearray, columns: tuple[int, ...], factor: float
) -> None:
    width = 16 if row.get("type") == "MAT4" else 3
    plain = row.get("componentType") == _FLOAT and "sparse" not in row and "bufferView" in row
    expect(plain, "values", "32-bit numbers in a buffer (without --bake any file goes)", Unquoted("others"))
    view = header["bufferViews"][row["bufferView"]]
    start = _HEAD + view.get("byteOffset", 0) + row.get("byteOffset", 0)
    stride = view.get("byteStride", 4 * width)
    values = np.ndarray((row["count"], width), "<f4", binary, start, (stride, 4))  # (n, k)
    values[:, list(columns)] *= np.float32(factor)
    for bound in ("min", "max"):
        if bound in row and width == 3:
            row[bound] = [float(np.float32(value) * np.float32(factor)) for value in row[bound]]
