"""Parse the headers of PLY files, and rescale files."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from metric_base.errors import FieldError, Unquoted, expect

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "="}
#: Maximum size of a header, in bytes; the rest of a file is not searched for its end.
MAX_HEADER_BYTES = 1 << 16
#: Properties of the chunks of a compressed PLY (SuperSplat): the corners of the box of their Gaussians.
CHUNK_CORNERS = ("min_x", "min_y", "min_z", "max_x", "max_y", "max_z")


@dataclass(frozen=True, slots=True)
class PlyLayout:
    """Position and type of the rows of an element of a PLY file, such as its vertices."""

    format: str
    #: Record of one row.
    vertex: np.dtype[np.void]
    #: Number of rows.
    count: int
    #: Offset of the first byte after the header.
    body: int
    #: Lines (ASCII) or bytes (binary) of the elements before it.
    skipped: int


def ply_layout(
    data: bytes, element: str = "vertex", required: Collection[str] = frozenset({"x", "y", "z"})
) -> PlyLayout:
    """Return the layout of an element with the properties `required`.

    Raises
    ------
    FieldError
        The header is invalid, or describes more rows than the file contains.
    """
    end = data.find(b"end_header", 0, MAX_HEADER_BYTES)
    line_end = data.find(b"\n", end)
    if not data.startswith(b"ply") or end < 0 or line_end < 0:
        raise FieldError("header", "ply ... end_header", data[:20])
    lines = [line.split() for line in data[:end].decode("ascii", "replace").splitlines()[1:]]
    form = next((line[1] for line in lines if line[:1] == ["format"] and len(line) > 1), "")
    expect(form in _BYTE_ORDERS, "format", f"one of {', '.join(_BYTE_ORDERS)}", form)
    elements = _elements([line for line in lines if line[:1] in (["element"], ["property"])])
    names = [name for name, _, _ in elements]
    expect(element in names, "elements", f"a {element} element", names)
    before, (_, count, properties) = elements[: names.index(element)], elements[names.index(element)]
    if any(kind is None for _, _, kinds in [*before, elements[len(before)]] for kind, _ in kinds):
        raise FieldError(element, "scalar properties", Unquoted("a list property"))
    vertex = _record(form, properties)
    if not set(required) <= set(vertex.names or ()):
        raise FieldError(element, f"properties {', '.join(sorted(required))}", [name for _, name in properties])
    if form == "ascii":
        skipped, smallest = sum(n for _, n, _ in before), 2 * len(properties)
    else:
        skipped, smallest = sum(n * _record(form, kinds).itemsize for _, n, kinds in before), vertex.itemsize
    body = line_end + 1
    left = len(data) - body - (0 if form == "ascii" else skipped) + (form == "ascii")
    if count * smallest > left:
        raise FieldError("number of vertices", f"at most {max(left, 0) // smallest} (the file's rest)", count)
    return PlyLayout(form, vertex, count, body, skipped)


def scaled_ply(data: bytes, scale: float, number: Callable[[float], str] = repr) -> bytes:
    """Return a PLY file whose lengths are multiplied by `scale`: positions, and the sizes of Gaussians.

    ln `scale` is added to the log scales of Gaussians; in a compressed PLY, to those of the chunks. The other
    properties do not depend on the scale.

    Parameters
    ----------
    data : bytes
    scale : float
    number : callable
        Returns the text of a coordinate in an ASCII file.

    Raises
    ------
    FieldError
        The file is damaged.
    """
    header = data[:MAX_HEADER_BYTES].partition(b"end_header")[0]
    is_compressed = b" packed_position" in header and b"format ascii" not in header
    layout = ply_layout(data, "chunk", CHUNK_CORNERS) if is_compressed else ply_layout(data)
    if layout.format == "ascii":
        lines = data[layout.body :].split(b"\n")
        columns = [(layout.vertex.names or ()).index(axis) for axis in "xyz"]
        for row in range(layout.skipped, layout.skipped + layout.count):
            words = lines[row].split()
            for column in columns:
                words[column] = number(float(words[column]) * scale).encode("ascii")
            lines[row] = b" ".join(words)
        return data[: layout.body] + b"\n".join(lines)
    scaled = bytearray(data)
    rows = np.frombuffer(scaled, layout.vertex, layout.count, layout.body + layout.skipped)
    for name in layout.vertex.names or ():
        values = rows[name].astype(np.float64)
        if name in {*"xyz", *CHUNK_CORNERS}:
            rows[name] = (values * scale).astype(rows[name].dtype)
        elif re.fullmatch(r"scale_[0-2]|(min|max)_scale_[xyz]", name):
            rows[name] = (values + np.log(scale)).astype(rows[name].dtype)
    return bytes(scaled)


def _elements(lines: list[list[str]]) -> list[tuple[str, int, list[tuple[str | None, str]]]]:
    """Return name, count and properties of each element; a property has a type, None for a list, and a name."""
    elements: list[tuple[str, int, list[tuple[str | None, str]]]] = []
    for words in lines:
        if words[0] == "element":
            if len(words) != 3 or not words[2].isdecimal() or len(words[2]) > 18:
                raise FieldError("element", "a name and a count", " ".join(words))
            elements.append((words[1], int(words[2]), []))
        elif not elements or len(words) < 3:
            raise FieldError("property", "a type and a name within an element", " ".join(words))
        elif words[1] == "list":
            elements[-1][2].append((None, words[-1]))
        elif words[1] not in _TYPES:
            raise FieldError(f"property {words[2]!r}", "a PLY type", words[1])
        else:
            elements[-1][2].append((_TYPES[words[1]], words[2]))
    return elements


def _record(form: str, properties: list[tuple[str | None, str]]) -> np.dtype[np.void]:
    """Return the NumPy type of the scalar properties of an element."""
    names = [name for _, name in properties]
    expect(len(set(names)) == len(names), "properties", "each name once", names)
    return np.dtype([(name, _BYTE_ORDERS[form] + str(kind)) for kind, name in properties])
