"""Read dense clouds: PLY files with any scalar properties, and the visibility lists of COLMAP."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimator.reconstructions.splats import splat_centres
from estimator.records.scene import MAX_COORDINATE, DenseCloud
from metric_base.arrays import FloatArray, IntArray
from metric_base.errors import FieldError, InputError, Unquoted, damage_as_field_error, expect, in_file
from metric_base.parsing import BinaryReader
from metric_base.ply import ply_layout

#: Paths of the dense clouds of COLMAP and OpenSfM, the preferred one first.
DENSE_CLOUDS = (
    "dense.ply",
    "fused.ply",
    "dense/fused.ply",
    "dense/0/fused.ply",
    "merged.ply",
    "undistorted/depthmaps/merged.ply",
)

#: Maximum number of views whose indices are stored in two bytes, which saves three quarters of the memory.
MAX_INT16_VIEWS = 1 << 15


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
        expect(n == n_points, "number of points", f"{n_points} as in the cloud", n)
        if reader.remaining % 4:
            raise FieldError("size", "whole numbers of 4 bytes", Unquoted(f"{reader.remaining} bytes after the count"))
        words = reader.rows("<u4", reader.remaining // 4, "visibility")
        starts = np.empty(n, dtype=np.int64)
        lengths, end, start = memoryview(words.tobytes()).cast("I"), len(words), 0
        for row in range(n):
            if start >= end:
                raise FieldError(f"point {row}", "a list of images", Unquoted("the end of the file"))
            starts[row] = start
            start += 1 + lengths[start]
        expect(start == end, "size", f"{4 * start} bytes of lists", Unquoted(f"{4 * end}"))
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


def read_points(path: Path) -> FloatArray:
    """Return the positions (n, 3) of the vertices of a PLY file, or of the opaque Gaussians of a splat.

    Raises
    ------
    InputError
        The file is damaged, or has no vertex.
    """
    with in_file(path):
        reader = BinaryReader(path)
        centres = splat_centres(reader.data)
        if centres is not None:
            return centres
        layout = ply_layout(reader.data)
        expect(layout.count, "number of vertices", "at least one", 0)
        if layout.format == "ascii":
            names = list(layout.vertex.names or ())
            lines = (
                reader.data[layout.body :]
                .decode("ascii", "replace")
                .split("\n")[layout.skipped : layout.skipped + layout.count]
            )
            with damage_as_field_error(f"{len(names)} numbers per line", ValueError, str, field="vertices"):
                points = np.loadtxt(lines, dtype=np.float64, usecols=[names.index(axis) for axis in "xyz"], ndmin=2)
            expect(len(points) == layout.count, "vertices", f"{layout.count} lines", Unquoted(f"{len(points)}"))
            return points
        reader.place = layout.body + layout.skipped
        rows = reader.rows(layout.vertex, layout.count, "vertices")
    with np.errstate(invalid="ignore"):
        return np.column_stack([rows[axis].astype(np.float64) for axis in "xyz"])
