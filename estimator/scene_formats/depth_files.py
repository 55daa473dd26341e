"""Read depth maps and point maps of networks: NumPy arrays and archives, EXR, PFM, and 16-bit PNG.

The keys of archives are those of `estimator.records.network_outputs`. UniDepth and Metric3D return arrays of shape
(1, 1, h, w) that users save as NPY.

EXR files are read here, because the wheels of OpenCV have no EXR: channels of an image in scan lines, uncompressed or
ZIP, as depth networks write it. Layout: openexr.com, "OpenEXR File Layout".
"""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.records.network_outputs import DEPTH_KEYS, FOCAL_KEYS, INTRINSICS_KEYS, UNIDEPTH_KEYS
from metric_base.arrays import FloatArray
from metric_base.errors import InputError, Unquoted, damage_as_field_error, in_file
from metric_base.images import read_image

#: First bytes of an EXR file, as a number.
EXR_MAGIC = 20000630
#: Bits of the version field of an EXR file for tiles, deep data or several parts, which depth maps do not have.
EXR_OTHER_LAYOUTS = 0x1A00
#: Types of a channel by their number: unsigned, half, float.
EXR_TYPES = (np.dtype("<u4"), np.dtype("<f2"), np.dtype("<f4"))
#: Scan lines per block by the number of the compression: none, ZIP of one line, ZIP of 16 lines.
EXR_BLOCK_LINES = {0: 1, 2: 1, 3: 16}
#: Names of the depth channel, best first; a grey image with colour channels has the same values in each.
EXR_DEPTH_CHANNELS = ("Z", "Y", "depth", "R")
#: Maximum size of the header of a PFM file in bytes: its kind, width, height and scale factor.
MAX_PFM_HEADER = 200
#: Maximum size of an EXR file in bytes.
MAX_EXR_BYTES = 2**30
#: Maximum number of pixels of the maps in a file.
MAX_PIXELS = 2**27
#: Channels of a point map that OpenCV wrote as a colour image: x, y, z.
EXR_POINT_CHANNELS = ("R", "G", "B")
#: Suffixes of files of depth maps.
SUFFIXES = (".npy", ".npz", ".exr", ".pfm", ".png")


def read_exr(file: Path, data: bytes | None = None, *, is_points: bool = False) -> FloatArray:
    """Read the depth channel (h, w) of an EXR file, or its only channel.

    Parameters
    ----------
    file : Path
    data : bytes, optional
        Its content, if it is part of the archive `file`.
    is_points : bool, default False
        Whether to read a point map (h, w, 3) instead.

    Raises
    ------
    InputError
        The file has another layout or is damaged.
    """
    if data is None:
        data = file.read_bytes() if file.stat().st_size <= MAX_EXR_BYTES else b""
    try:
        pixels = _exr_pixels(data)
        names = pixels.dtype.names or ()
        if is_points:
            return np.stack([pixels[name].astype(np.float64) for name in EXR_POINT_CHANNELS], axis=-1)
        wanted = next((name for name in EXR_DEPTH_CHANNELS if name in names), names[0] if len(names) == 1 else None)
        if wanted is None:
            raise ValueError(f"channels {', '.join(names)}")
        return pixels[wanted].astype(np.float64)
    except (struct.error, ValueError, KeyError, IndexError, OverflowError, zlib.error) as error:
        content = "the channels R, G, B" if is_points else "one depth channel"
        expected = f"an OpenEXR image in scan lines, uncompressed or ZIP, with {content}"
        raise InputError.at(file, "image", expected, Unquoted(str(error) or type(error).__name__)) from None


def _exr_pixels(data: bytes) -> NDArray[np.void]:
    """Return the scan lines (h,), records with the w values of each channel; errors as for `_exr_header`."""
    line, height, n_lines, table = _exr_header(data)
    pixels = np.empty(height, line)
    for number, offset in enumerate(struct.unpack_from(f"<{-(-height // n_lines)}Q", data, table)):
        rows = pixels[number * n_lines : (number + 1) * n_lines]
        (size,) = struct.unpack_from("<i", data, offset + 4)
        packed = data[offset + 8 : offset + 8 + size]
        block = np.frombuffer(packed, dtype=np.uint8)
        if size != rows.nbytes:
            # A ZIP block: its differences are summed, and its two halves are interleaved.
            raw = np.frombuffer(zlib.decompressobj().decompress(packed, rows.nbytes), dtype=np.uint8).astype(np.int64)
            if len(raw) != rows.nbytes:
                raise ValueError("a block that ends early")
            raw[1:] -= 128
            summed = np.cumsum(raw).astype(np.uint8)
            block, half = np.empty(rows.nbytes, dtype=np.uint8), (rows.nbytes + 1) // 2
            block[0::2], block[1::2] = summed[:half], summed[half:]
        rows[:] = block.view(line).reshape(rows.shape)
    return pixels


def _exr_header(data: bytes) -> tuple[np.dtype[np.void], int, int, int]:
    """Return the record of a scan line, their number, the number of them in a block, and the position of the offsets.

    ValueError, or an error of `struct`, if the file has another layout or is damaged.
    """
    magic, version = struct.unpack_from("<II", data)
    if magic != EXR_MAGIC or version & EXR_OTHER_LAYOUTS:
        raise ValueError("another format" if magic != EXR_MAGIC else "tiles, deep data or several parts")
    position, fields = 8, dict[str, bytes]()
    while data[position]:
        name, position = _text(data, position)
        _, position = _text(data, position)
        (size,) = struct.unpack_from("<i", data, position)
        if size < 0:
            raise ValueError("a field of negative size")
        fields[name] = data[position + 4 : position + 4 + size]
        position += 4 + size
    left, top, right, bottom = struct.unpack("<4i", fields["dataWindow"])
    width, height = right - left + 1, bottom - top + 1
    if min(width, height) < 1 or width * height > MAX_PIXELS:
        raise ValueError(f"a size of {width} x {height}")
    if fields["compression"][0] not in EXR_BLOCK_LINES:
        raise ValueError(f"compression number {fields['compression'][0]}")
    channels, table, end = [], fields["channels"], position + 1
    position = 0
    while table[position]:
        name, position = _text(table, position)
        kind, _, step_x, step_y = struct.unpack_from("<IIii", table, position)
        if (step_x, step_y) != (1, 1):
            raise ValueError(f"channel {name} has a coarser grid")
        channels.append((name, EXR_TYPES[kind], (width,)))
        position += 16
    line = np.dtype(channels)  # the values of each channel, one channel after the other
    if not 0 < line.itemsize * height <= MAX_EXR_BYTES:
        raise ValueError(f"{len(channels)} channels of {width} x {height}")
    return line, height, EXR_BLOCK_LINES[fields["compression"][0]], end


def _text(data: bytes, position: int) -> tuple[str, int]:
    """Return the text before a zero byte, and the position after this byte."""
    end = data.index(b"\0", position)
    return data[position:end].decode("ascii"), end + 1


@dataclass(frozen=True, slots=True, eq=False)
class DepthMaps:
    """Depth maps of one file."""

    values: FloatArray  #: (n, h, w)
    focal: FloatArray | None = None  #: (n,) or (1,) focal length in pixels of the map; None if it is not stated.
    network: str = ""  #: Network that names its arrays so, a key of `NETWORK_SD`; empty if it is unknown.
    #: Median relative error of the depth that the network states (UniDepth v2), scale excepted; None if it states none.
    relative_error: float | None = None


def read_depth(file: Path, png_metres: float = 0.001) -> FloatArray:
    """Read a depth map (h, w) in metres; pixels without depth are NaN, infinite or not positive.

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
    """Read the depth maps of a file; pixels without depth are NaN, infinite or not positive.

    Parameters
    ----------
    file : Path
    png_metres : float, default 0.001
        Metres per unit of a PNG.

    Raises
    ------
    InputError
        The file does not contain maps with one channel.
    """
    import cv2

    kind, focal, network, relative_error = file.suffix.lower(), None, "", None
    if kind == ".npz":
        depth, focal = _npz(file)
        names = archive_names(file)
        network = "mapanything" if "depth_z" in names else ""
        if names.issuperset(UNIDEPTH_KEYS):
            log_errors = np.log(archive_arrays(file, UNIDEPTH_KEYS[:1])[UNIDEPTH_KEYS[0]])
            relative_error = float(np.nanmedian(np.abs(log_errors.ravel() / depth.ravel())))
    elif reader := {".npy": read_npy, ".exr": read_exr}.get(kind):
        depth = reader(file)
    else:
        values, is_pfm = read_image(file, cv2.IMREAD_UNCHANGED), kind == ".pfm"
        if values is None or values.ndim != 2 or values.dtype != (np.float32 if is_pfm else np.uint16):
            expected = "a PFM of one channel" if is_pfm else "a PNG of 16 bits"
            actual = "no image" if values is None else f"{values.dtype} of shape {values.shape}"
            raise InputError.at(file, "image", expected, Unquoted(actual))
        if is_pfm:  # OpenCV divides by the scale factor of the header (Middlebury: 1/255), which is no unit
            with file.open("rb") as stream:
                factor = abs(float(stream.read(MAX_PFM_HEADER).split(maxsplit=4)[3]))
            depth = values.astype(float) * factor
        else:
            depth = np.where(values > 0, values.astype(float), np.nan) * png_metres
    return DepthMaps(map_stack(file, depth), focal, network, relative_error)


def map_stack(file: Path, values: FloatArray) -> FloatArray:
    """Return maps of one channel as (n, h, w); InputError for `file` if they have another shape."""
    shape = values.shape
    if values.ndim == 4 and 1 in (shape[1], shape[3]):
        values = values[:, 0] if shape[1] == 1 else values[..., 0]
    elif values.ndim == 3 and shape[2] == 1 and shape[1] > 1:
        values = values[..., 0]
    if values.ndim == 2:
        values = values[None]
    if values.ndim != 3 or not 0 < values.size <= MAX_PIXELS:
        raise InputError.at(file, "shape", "(h, w) or (n, h, w), one channel", shape)
    return values


def _npz(file: Path) -> tuple[FloatArray, FloatArray | None]:
    """Read the depth of an archive, and its focal lengths (n,), if any."""
    arrays = archive_arrays(file, (*DEPTH_KEYS, *INTRINSICS_KEYS, *FOCAL_KEYS))
    depth, matrix, length = (
        next((arrays[key] for key in keys if key in arrays), None)
        for keys in (("", *DEPTH_KEYS), INTRINSICS_KEYS, FOCAL_KEYS)
    )
    if depth is None:
        expected, names = f"a NumPy archive with one of {', '.join(DEPTH_KEYS)}", sorted(archive_names(file))
        raise InputError.at(file, "archive", expected, Unquoted(f"arrays {', '.join(names) or 'none'}"))
    if matrix is not None and matrix.shape[-2:] == (3, 3) and matrix.size:
        flat = matrix.reshape(-1, 3, 3)
        return depth, 0.5 * (flat[:, 0, 0] + flat[:, 1, 1])
    return depth, None if length is None else length.reshape(-1)


def archive_names(file: Path) -> frozenset[str]:
    """Return the names of the arrays in a NumPy archive, without reading them; none if it is no archive."""
    try:
        with zipfile.ZipFile(file) as entries:
            return frozenset(name.removesuffix(".npy") for name in entries.namelist())
    except Exception:  # noqa: BLE001 - zipfile raises a dozen kinds for damaged files
        return frozenset()


def archive_arrays(file: Path, keys: Sequence[str]) -> dict[str, FloatArray]:
    """Return the arrays (..., h, w) of a NumPy archive with these names, or its only array under the name "".

    Raises
    ------
    InputError
        The archive is damaged, or an array is larger than any depth map.
    """
    with in_file(file), damage_as_field_error("a NumPy archive", field="archive"):
        with zipfile.ZipFile(file) as entries:
            n_bytes = {entry.filename.removesuffix(".npy"): entry.file_size for entry in entries.infolist()}
        names = [name for name in keys if name in n_bytes]
        if not names and len(n_bytes) == 1:
            names = list(n_bytes)
        if any(n_bytes[name] > 8 * MAX_PIXELS for name in names):
            raise ValueError("more than any depth map")
        with np.load(file, allow_pickle=False) as archive:
            is_named = bool(set(names) & set(keys))
            return {name if is_named else "": np.asarray(archive[name], dtype=np.float64) for name in names}


def read_npy(file: Path) -> FloatArray:
    """Read the values (..., h, w) of a NumPy file, of any shape."""
    with in_file(file), damage_as_field_error("a NumPy array of numbers", field="array"):
        # np.load would open a .npz or a pickle under this name too.
        return np.asarray(np.lib.format.open_memmap(file, mode="r"), dtype=float)
