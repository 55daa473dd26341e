"""Depth maps on disk: NumPy arrays, PFM, and 16-bit PNG."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import InputError, Unquoted
from metric_base.pictures import read_picture

__all__ = ["SUFFIXES", "read_depth"]

SUFFIXES = (".npy", ".pfm", ".png")

#: Most pixels of a map that is believed.
MOST_PIXELS = 2**27


def read_depth(file: Path, png_metres: float = 0.001) -> FloatArray:
    """(h, w) metres; NaN, infinite or not positive where the map has no depth.

    Raises
    ------
    InputError
        The file is not a map of one channel.
    """
    reader = {".npy": _npy, ".pfm": _pfm}.get(file.suffix.lower())
    depth = _png(file) * png_metres if reader is None else reader(file)
    if depth.ndim != 2 or not 0 < depth.size <= MOST_PIXELS:
        raise InputError.at(file, "shape", "(h, w), one channel", depth.shape)
    return depth


def _npy(file: Path) -> FloatArray:
    """(h, w) values of a NumPy file."""
    try:
        # np.load would open a .npz or a pickle under this name too.
        values = np.lib.format.open_memmap(file, mode="r")
        return np.asarray(np.squeeze(values), dtype=float)
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
