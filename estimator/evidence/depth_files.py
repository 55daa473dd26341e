"""Depth maps on disk as networks write them: NumPy arrays and archives, EXR, PFM, and 16-bit PNG.

MoGe writes `NAME/depth.exr`, Depth Pro `NAME.npz` with `depth`, Depth Anything 3 `results.npz` with the `depth` of all
pictures and their `intrinsics`, MapAnything's `depth_z` (one or many, with a last axis of one); UniDepth and Metric3D
return arrays of shape (1, 1, h, w) that users save as NPY.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.evidence.exr import read_exr
from metric_base.arrays import FloatArray
from metric_base.errors import InputError, Unquoted
from metric_base.images import read_picture

__all__ = ["SUFFIXES", "DepthMaps", "read_depth", "read_depths"]

SUFFIXES = (".npy", ".npz", ".exr", ".pfm", ".png")

#: Names of the depth in an archive, best first; a single array needs none of them. `depth_along_ray` is no depth.
DEPTH_KEYS = ("metric_depth", "depth_z", "depth", "depth_m", "pred_depth", "prediction")
#: Names of the intrinsics (..., 3, 3) in pixels of the map, and of a focal length in pixels.
INTRINSICS_KEYS, FOCAL_KEYS = ("intrinsics", "K"), ("focallength_px", "focal_length_px", "focal")

#: Most pixels of a map that is believed.
MOST_PIXELS = 2**27


@dataclass(frozen=True, slots=True, eq=False)
class DepthMaps:
    """Maps of one file: values (n, h, w), and each one's focal length in pixels of the map, (n,), None if not said."""

    values: FloatArray
    focal: FloatArray | None = None


def read_depth(file: Path, png_metres: float = 0.001) -> FloatArray:
    """(h, w) metres; NaN, infinite or not positive where the map has no depth.

    Raises
    ------
    InputError
        The file is not one map of one channel.
    """
    maps = read_depths(file, png_metres).values
    if len(maps) != 1:
        raise InputError.at(file, "shape", "(h, w), one channel", maps.shape)
    return np.asarray(maps[0])


def read_depths(file: Path, png_metres: float = 0.001) -> DepthMaps:
    """The maps of a file; NaN, infinite or not positive where there is no depth. png_metres : of one step of a PNG.

    Raises
    ------
    InputError
        The file does not hold maps of one channel.
    """
    kind, focal = file.suffix.lower(), None
    if kind == ".npz":
        depth, focal = _npz(file)
    else:
        reader = {".npy": _npy, ".pfm": _pfm, ".exr": read_exr}.get(kind)
        depth = _png(file) * png_metres if reader is None else reader(file)
    return DepthMaps(_stack(file, depth), focal)


def _stack(file: Path, depth: FloatArray) -> FloatArray:
    """(n, h, w) of what may have axes of one before or after, such as (1, 1, h, w) and (n, h, w, 1)."""
    shape = depth.shape
    if depth.ndim == 4 and 1 in (shape[1], shape[3]):
        depth = depth[:, 0] if shape[1] == 1 else depth[..., 0]
    elif depth.ndim == 3 and shape[2] == 1 and shape[1] > 1:
        depth = depth[..., 0]
    if depth.ndim == 2:
        depth = depth[None]
    if depth.ndim != 3 or not 0 < depth.size <= MOST_PIXELS:
        raise InputError.at(file, "shape", "(h, w) or (n, h, w), one channel", shape)
    return depth


def _npz(file: Path) -> tuple[FloatArray, FloatArray | None]:
    """The depth of an archive and the focal lengths (n,) that it states."""
    try:
        if _unpacked_bytes(file) > 8 * MOST_PIXELS:
            raise ValueError("more than any depth map")
        with np.load(file, allow_pickle=False) as archive:
            names = archive.files
            name = next((key for key in DEPTH_KEYS if key in names), names[0] if len(names) == 1 else None)
            if name is None:
                raise ValueError(f"arrays {', '.join(names) or 'none'}")
            depth = np.asarray(archive[name], dtype=float)
            matrix = next((archive[key] for key in INTRINSICS_KEYS if key in names), None)
            length = next((archive[key] for key in FOCAL_KEYS if key in names), None)
    except Exception as error:  # noqa: BLE001 - NumPy and zipfile raise a dozen kinds for damaged files
        words = Unquoted(str(error) or type(error).__name__)
        raise InputError.at(file, "archive", f"a NumPy archive with one of {', '.join(DEPTH_KEYS)}", words) from None
    if matrix is not None and matrix.shape[-2:] == (3, 3) and matrix.size:
        flat = matrix.reshape(-1, 3, 3).astype(float)
        return depth, 0.5 * (flat[:, 0, 0] + flat[:, 1, 1])
    return depth, None if length is None else np.asarray(length, dtype=float).reshape(-1)


def _unpacked_bytes(file: Path) -> int:
    with zipfile.ZipFile(file) as archive:
        return sum(entry.file_size for entry in archive.infolist())


def _npy(file: Path) -> FloatArray:
    """The values of a NumPy file, of any shape."""
    try:
        # np.load would open a .npz or a pickle under this name too.
        values = np.lib.format.open_memmap(file, mode="r")
        return np.asarray(values, dtype=float)
    except Exception as error:  # noqa: BLE001 - NumPy raises a dozen kinds for damaged headers
        words = Unquoted(str(error) or type(error).__name__)
        raise InputError.at(file, "array", "a NumPy array of numbers", words) from None


def _pfm(file: Path) -> FloatArray:
    """(h, w) of a portable float map: `Pf`, size, a scale whose sign is the byte order, rows from the bottom up."""
    parts = file.read_bytes().split(maxsplit=4) if file.stat().st_size <= 4 * MOST_PIXELS + 99 else []
    try:
        kind, width, height, scale = parts[0], int(parts[1]), int(parts[2]), float(parts[3])
        start = file.read_bytes().index(parts[3], len(kind)) + len(parts[3]) + 1
        order = "<f4" if scale < 0 else ">f4"
        values = np.frombuffer(file.read_bytes(), dtype=order, count=width * height, offset=start)
    except (IndexError, ValueError, OverflowError) as error:
        raise InputError.at(file, "map", "a PFM of one channel", Unquoted(str(error))) from None
    if kind != b"Pf" or min(width, height) < 1:
        raise InputError.at(file, "kind", "Pf, one channel", Unquoted(kind.decode("ascii", "replace")))
    return np.asarray(values.reshape(height, width)[::-1], dtype=float)


def _png(file: Path) -> FloatArray:
    """(h, w) values of a PNG of 16 bits."""
    import cv2

    values = read_picture(file, cv2.IMREAD_UNCHANGED)
    if values is None or values.dtype != np.uint16:
        actual = Unquoted("no picture" if values is None else str(values.dtype))
        raise InputError.at(file, "picture", "a PNG of 16 bits", actual)
    return np.where(values > 0, values.astype(float), np.nan)
