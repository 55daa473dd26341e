"""Read dense clouds: PLY files with any scalar properties, and the visibility lists of COLMAP."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.records.scene import MAX_COORDINATE, DenseCloud
from metric_base.arrays import FloatArray, IntArray
from metric_base.errors import FieldError, InputError, Unquoted, in_file
from metric_base.parsing import BinaryReader

#: Paths of the dense clouds of COLMAP and OpenSfM, the preferred one first.
DENSE_CLOUDS = (
    "dense.ply",
    "fused.ply",
    "dense/fused.ply",
    "dense/0/fused.ply",
    "merged.ply",
    "undistorted/depthmaps/merged.ply",
)
_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "="}
#: Maximum size of a header, in bytes; the rest of a file is not searched for its end.
MAX_HEADER_BYTES = 1 << 16

#: Maximum number of views whose indices are stored in two bytes, which saves three quarters of the memory.
MAX_INT16_VIEWS = 1 << 15


@dataclass(frozen=True, slots=True)
class PlyLayout:
    """Position and type of the vertices of a PLY file."""

    format: str
    #: Record of one vertex.
    vertex: np.dtype[np.void]
    #: Number of vertices.
    count: int
    #: Offset of the first byte after the header.
    body: int
    #: Lines (ASCII) or bytes (binary) of the elements before the vertices.
    skipped: int


def find_dense_cloud(*folders: Path) -> Path | None:
    """Return the first dense cloud at a usual path below these folders, or None."""
    paths = (folder / name for folder in folders for name in DENSE_CLOUDS)
    return next((path for path in paths if path.is_file()), None)


def read_dense_cloud(path: Path, n_views: int, bounds: FloatArray | None = None) -> tuple[DenseCloud, tuple[str, ...]]:
    """Read a dense cloud, with its visibility lists if `<path>.vis` exists.

    Parameters
    ----------
    path : Path
    n_views : int
        Number of views of the model.
    bounds : (2, 3) ndarray of float, optional
        Lowest and highest corner of accepted points. Points outside, and points without a position, are dropped.

    Returns
    -------
    cloud : DenseCloud
    warnings : tuple of str

    Raises
    ------
    InputError
        A file is damaged, or no point is accepted.
    """
    points = read_points(path)
    visibility = path.with_name(f"{path.name}.vis")
    offsets, views = read_visibility(visibility, len(points), n_views) if visibility.is_file() else (None, None)
    keep = (np.abs(points) < MAX_COORDINATE).all(axis=1)
    if bounds is not None:
        keep &= ((points > bounds[0]) & (points < bounds[1])).all(axis=1)
    if not keep.any():
        raise InputError.at(
            path, "vertices", "at least one point near the cameras", Unquoted(f"{len(points)} without a position")
        )
    if keep.all():
        return DenseCloud(points, offsets, views, path), ()
    if offsets is not None and views is not None:
        counts = np.diff(offsets)
        views = views[np.repeat(keep, counts)]
        offsets = np.concatenate([[0], np.cumsum(counts[keep])])
    warning = f"{path}: {np.count_nonzero(~keep)} points without a position, or far from the cameras, are omitted"
    return DenseCloud(points[keep], offsets, views, path), (warning,)


def read_visibility(path: Path, n_points: int, n_views: int) -> tuple[IntArray, IntArray]:
    """Read visibility lists (`fused.ply.vis`): uint64 n; for each point uint32 k, and k uint32.

    Returns
    -------
    offsets : (n + 1,) ndarray of int
        Range of each point in `views`.
    views : (m,) ndarray of int
        Positions of the images in the file of the model.

    Raises
    ------
    InputError
        The file is damaged, or does not match the cloud or the model.
    """
    with in_file(path):
        reader = BinaryReader(path)
        n = reader.count("number of points", 4)
        if n != n_points:
            raise FieldError("number of points", f"{n_points} as in the cloud", n)
        if reader.remaining % 4:
            raise FieldError("size", "whole numbers of 4 bytes", Unquoted(f"{reader.remaining} bytes after the count"))
        words = reader.rows("<u4", reader.remaining // 4, "visibility")
        starts = _list_starts(words, n)
        is_view = np.ones(len(words), dtype=bool)
        is_view[starts] = False
        views = words[is_view]
        if len(views) and views.max() >= n_views:
            raise FieldError("image", f"positions below {n_views}, the number of images", int(views.max()))
    offsets = np.concatenate([[0], np.cumsum(words[starts], dtype=np.int64)])
    return offsets, views.astype(np.int16 if n_views <= MAX_INT16_VIEWS else np.int32)


def visibility_bytes(offsets: IntArray, views: IntArray) -> bytes:
    """Return a visibility file with offsets (n + 1,) and views (m,); the inverse of `read_visibility`."""
    words = np.insert(views, offsets[:-1], np.diff(offsets))
    return np.uint64(len(offsets) - 1).tobytes() + words.astype("<u4").tobytes()


def _list_starts(words: np.ndarray[tuple[int], np.dtype[np.uint32]], n: int) -> IntArray:
    """Return the index (n,) of the length of each list in the words (k,) of a visibility file."""
    starts = np.empty(n, dtype=np.int64)
    lengths, end, start = memoryview(words.tobytes()).cast("I"), len(words), 0
    for row in range(n):
        if start >= end:
            raise FieldError(f"point {row}", "a list of images", Unquoted("the end of the file"))
        starts[row] = start
        start += 1 + lengths[start]
    if start != end:
        raise FieldError("size", f"{4 * start} bytes of lists", Unquoted(f"{4 * end}"))
    return starts


def ply_layout(data: bytes) -> PlyLayout:
    """Parse the header; FieldError if it is invalid, or describes more vertices than the file contains."""
    end = data.find(b"end_header", 0, MAX_HEADER_BYTES)
    line_end = data.find(b"\n", end)
    if not data.startswith(b"ply") or end < 0 or line_end < 0:
        raise FieldError("header", "ply ... end_header", data[:20])
    lines = [line.split() for line in data[:end].decode("ascii", "replace").splitlines()[1:]]
    form = next((line[1] for line in lines if line[:1] == ["format"] and len(line) > 1), "")
    if form not in _BYTE_ORDERS:
        raise FieldError("format", f"one of {', '.join(_BYTE_ORDERS)}", form)
    elements = _elements([line for line in lines if line[:1] in (["element"], ["property"])])
    names = [name for name, _, _ in elements]
    if "vertex" not in names:
        raise FieldError("elements", "a vertex element", names)
    before, (_, count, properties) = elements[: names.index("vertex")], elements[names.index("vertex")]
    if any(kind is None for _, _, kinds in [*before, elements[len(before)]] for kind, _ in kinds):
        raise FieldError("vertex", "scalar properties", Unquoted("a list property"))
    vertex = _record(form, properties)
    if not {"x", "y", "z"} <= set(vertex.names or ()):
        raise FieldError("vertex", "properties x, y and z", [name for _, name in properties])
    if form == "ascii":
        skipped, smallest = sum(n for _, n, _ in before), 2 * len(properties)
    else:
        skipped, smallest = sum(n * _record(form, kinds).itemsize for _, n, kinds in before), vertex.itemsize
    body = line_end + 1
    left = len(data) - body - (0 if form == "ascii" else skipped) + (form == "ascii")
    if count * smallest > left:
        raise FieldError("number of vertices", f"at most {max(left, 0) // smallest} (the file's rest)", count)
    return PlyLayout(form, vertex, count, body, skipped)


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
    if len(set(names)) != len(names):
        raise FieldError("properties", "each name once", names)
    return np.dtype([(name, _BYTE_ORDERS[form] + str(kind)) for kind, name in properties])


def read_points(path: Path) -> FloatArray:
    """Return the positions (n, 3) of the vertices of a PLY file.

    Raises
    ------
    InputError
        The file is damaged, or has no vertex.
    """
    with in_file(path):
        reader = BinaryReader(path)
        layout = ply_layout(reader.data)
        if not layout.count:
            raise FieldError("number of vertices", "at least one", 0)
        if layout.format == "ascii":
            return _ascii_points(reader.data, layout)
        reader.place = layout.body + layout.skipped
        rows = reader.rows(layout.vertex, layout.count, "vertices")
    with np.errstate(invalid="ignore"):
        return np.column_stack([rows[axis].astype(np.float64) for axis in "xyz"])


def _ascii_points(data: bytes, layout: PlyLayout) -> FloatArray:
    """Return the positions (n, 3) of the vertices of an ASCII file."""
    names = list(layout.vertex.names or ())
    lines = data[layout.body :].decode("ascii", "replace").split("\n")[layout.skipped : layout.skipped + layout.count]
    try:
        points = np.loadtxt(lines, dtype=np.float64, usecols=[names.index(axis) for axis in "xyz"], ndmin=2)
    except ValueError as error:
        raise FieldError("vertices", f"{len(names)} numbers per line", Unquoted(str(error))) from None
    if len(points) != layout.count:
        raise FieldError("vertices", f"{layout.count} lines", Unquoted(f"{len(points)}"))
    return points
