"""Dense clouds: PLY files with any scalar properties, and COLMAP's visibility lists beside them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.records.scene import MAX_COORDINATE, DenseCloud
from metric_base.arrays import FloatArray, IntArray
from metric_base.errors import FieldError, InputError, Unquoted, in_file
from metric_base.parsing import BinaryReader

#: Where reconstructions keep their dense cloud, in the order of preference: COLMAP's and OpenSfM's places.
DENSE_PLACES = (
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
#: No header is longer; a file without its end is not searched to its last byte.
MAX_HEADER_BYTES = 1 << 16

#: Views that two bytes can number: the lists of a large cloud take a quarter of the memory.
FEW_VIEWS = 1 << 15


@dataclass(frozen=True, slots=True)
class PlyLayout:
    """Where the vertices of a PLY file lie: format, record of one vertex, their number, and the offset of the first.

    skipped : lines (ascii) or bytes (binary) of the elements before the vertices.
    """

    format: str
    vertex: np.dtype[np.void]
    count: int
    body: int
    skipped: int


def find_dense_cloud(*folders: Path) -> Path | None:
    """The first dense cloud in its usual places under the folders, or None."""
    places = (folder / place for folder in folders for place in DENSE_PLACES)
    return next((place for place in places if place.is_file()), None)


def read_dense_cloud(path: Path, n_views: int, bounds: FloatArray | None = None) -> tuple[DenseCloud, tuple[str, ...]]:
    """The cloud with its visibility where `<path>.vis` exists, and warnings.

    bounds : (2, 3) low and high corner; points outside, and points without a position, are left out.
    """
    points = read_points(path)
    beside = path.with_name(f"{path.name}.vis")
    offsets, views = read_visibility(beside, len(points), n_views) if beside.is_file() else (None, None)
    good = (np.abs(points) < MAX_COORDINATE).all(axis=1)
    if bounds is not None:
        good &= ((points > bounds[0]) & (points < bounds[1])).all(axis=1)
    if not good.any():
        raise InputError.at(
            path, "vertices", "at least one point near the cameras", Unquoted(f"{len(points)} without a position")
        )
    if good.all():
        return DenseCloud(points, offsets, views, path), ()
    if offsets is not None and views is not None:
        counts = np.diff(offsets)
        views = views[np.repeat(good, counts)]
        offsets = np.concatenate([[0], np.cumsum(counts[good])])
    warning = f"{path}: {np.count_nonzero(~good)} points without a position, or far from everything, are left out"
    return DenseCloud(points[good], offsets, views, path), (warning,)


def read_visibility(path: Path, n_points: int, n_views: int) -> tuple[IntArray, IntArray]:
    """Offsets (n + 1,) and views (m,) of COLMAP's `fused.ply.vis`: uint64 n; for each point uint32 k, k uint32.

    The numbers are positions of the images in the model's file. InputError where it does not fit the cloud or the
    model.
    """
    with in_file(path):
        return _visibility(BinaryReader(path), n_points, n_views)


def _visibility(reader: BinaryReader, n_points: int, n_views: int) -> tuple[IntArray, IntArray]:
    """Offsets (n + 1,) and views (m,) of the bytes of a visibility file."""
    n = reader.count("number of points", 4)
    if n != n_points:
        raise FieldError("number of points", f"{n_points} as in the cloud", n)
    if reader.remaining % 4:
        raise FieldError("size", "whole numbers of 4 bytes", Unquoted(f"{reader.remaining} bytes after the count"))
    words = reader.rows("<u4", reader.remaining // 4, "visibility")
    places = _list_places(words, n)
    listed = np.ones(len(words), dtype=bool)
    listed[places] = False
    views = words[listed]
    if len(views) and views.max() >= n_views:
        raise FieldError("image", f"positions below {n_views}, the number of images", int(views.max()))
    return np.concatenate([[0], np.cumsum(words[places], dtype=np.int64)]), views.astype(
        np.int16 if n_views <= FEW_VIEWS else np.int32
    )


def visibility_bytes(offsets: IntArray, views: IntArray) -> bytes:
    """The visibility file of offsets (n + 1,) and views (m,), the inverse of `read_visibility`."""
    words = np.insert(views, offsets[:-1], np.diff(offsets))
    return np.uint64(len(offsets) - 1).tobytes() + words.astype("<u4").tobytes()


def _list_places(words: np.ndarray[tuple[int], np.dtype[np.uint32]], n: int) -> IntArray:
    """(n,) where each point's length stands: the one walk that the layout forces."""
    places = np.empty(n, dtype=np.int64)
    lengths, end, place = memoryview(words.tobytes()).cast("I"), len(words), 0
    for row in range(n):
        if place >= end:
            raise FieldError(f"point {row}", "a list of images", Unquoted("the end of the file"))
        places[row] = place
        place += 1 + lengths[place]
    if place != end:
        raise FieldError("size", f"{4 * place} bytes of lists", Unquoted(f"{4 * end}"))
    return places


def ply_layout(data: bytes) -> PlyLayout:
    """What the header promises; FieldError where it is no header, or promises more bytes than there are."""
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
    """Name, count and properties (type, None for a list, and name) of each element."""
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
    names = [name for _, name in properties]
    if len(set(names)) != len(names):
        raise FieldError("properties", "each name once", names)
    return np.dtype([(name, _BYTE_ORDERS[form] + str(kind)) for kind, name in properties])


def read_points(path: Path) -> FloatArray:
    """(n, 3) positions of the vertices."""
    with in_file(path):
        return _points(BinaryReader(path))


def _points(reader: BinaryReader) -> FloatArray:
    """(n, 3) positions of the vertices in a file's bytes."""
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
    """(n, 3) positions of the vertices of an ASCII file."""
    names = list(layout.vertex.names or ())
    lines = data[layout.body :].decode("ascii", "replace").split("\n")[layout.skipped : layout.skipped + layout.count]
    try:
        points = np.loadtxt(lines, dtype=np.float64, usecols=[names.index(axis) for axis in "xyz"], ndmin=2)
    except ValueError as error:
        raise FieldError("vertices", f"{len(names)} numbers a line", Unquoted(str(error))) from None
    if len(points) != layout.count:
        raise FieldError("vertices", f"{layout.count} lines", Unquoted(f"{len(points)}"))
    return points
