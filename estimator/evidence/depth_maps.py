"""Estimate the scale from metric depth maps of a network, compared with the depths of the reconstruction.

Formats of the files: NumPy arrays and archives, EXR, PFM, and 16-bit PNG. MoGe writes `NAME/depth.exr`, Depth Pro
`NAME.npz` with `depth`, Depth Anything 3 `results.npz` with the `depth` of all images and their `intrinsics`,
MapAnything `depth_z` (one or several, with a last axis of one); UniDepth and Metric3D return arrays of shape
(1, 1, h, w) that users save as NPY.

EXR files are read here, because the wheels of OpenCV have no EXR: one channel of an image in scan lines, uncompressed
or ZIP, as depth networks write it. Layout: openexr.com, "OpenEXR File Layout".
"""

from __future__ import annotations

import math
import struct
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from estimator.evidence.source import skipped_evidence
from estimator.projection.cameras import pixels_in_view
from estimator.records.objects import Measurements
from estimator.records.result import ScaleEvidence
from estimator.records.scene import Scene, View
from metric_base.arrays import FloatArray, evenly_spaced
from metric_base.errors import InputError, Unquoted
from metric_base.images import read_picture
from metric_base.statistics import robust_sigma

KIND = "metric_depth"
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
#: Maximum size of an EXR file in bytes.
MAX_EXR_BYTES = 2**30
#: Maximum number of pixels of the maps in a file.
MAX_PIXELS = 2**27
SUFFIXES = (".npy", ".npz", ".exr", ".pfm", ".png")
#: Names of the depth in an archive, best first; a single array may have any name. `depth_along_ray` is no depth.
DEPTH_KEYS = ("metric_depth", "depth_z", "depth", "depth_m", "pred_depth", "prediction")
#: Names of the intrinsics (..., 3, 3) in pixels of the map.
INTRINSICS_KEYS = ("intrinsics", "K")
#: Names of a focal length in pixels of the map.
FOCAL_KEYS = ("focallength_px", "focal_length_px", "focal")
#: Names of a file with the maps of all views, sorted by their names, as Depth Anything 3 writes it.
STACKS = ("results.npz", "exports/npz/results.npz", "exports/mini_npz/results.npz")
#: Standard deviation of the log scale of a network that all images share, in scenes unlike its training data: reports
#: of users range from a few per cent to a factor of two; VGGT with MoGe-2 is typically within 10 to 20 %.
NETWORK_SD = 0.15
#: Prior standard deviation of the log scale of one image: a random effect whose variance is estimated from the images.
FRAME_SD = 0.1
#: Weight of this prior, in images.
FRAME_PRIOR_COUNT = 3
#: Focal length in pixels for which a network's depths are metric: the depth is value * focal length of the map / this
#: number. It is 300 for the metric model of Depth Anything 3 and 1000 for Metric3D.
FOCAL_UNITS = {"da3": 300.0, "metric3d": 1000.0}
#: Minimum number of points with a depth in the map for the median of a view.
MIN_POINTS = 20
#: Maximum number of points for this median.
MAX_POINTS = 5000


@dataclass(frozen=True, slots=True)
class _Header:
    """Header of an EXR file."""

    channels: tuple[tuple[str, np.dtype[np.generic]], ...]  #: Name and type, in the order of the file.
    compression: int
    width: int
    height: int
    end: int  #: Position of the table of offsets.


def read_exr(file: Path) -> FloatArray:
    """Read the depth channel (h, w) of an EXR file, or its only channel.

    Raises
    ------
    InputError
        The file has another layout or is damaged.
    """
    data = file.read_bytes() if file.stat().st_size <= MAX_EXR_BYTES else b""
    try:
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
            channels.append((name, EXR_TYPES[kind]))
            position += 16
        return _exr_depth(data, _Header(tuple(channels), fields["compression"][0], width, height, end))
    except (struct.error, ValueError, KeyError, IndexError, OverflowError, zlib.error) as error:
        expected = "an OpenEXR picture in scan lines, uncompressed or ZIP, with one depth channel"
        raise InputError.at(file, "picture", expected, Unquoted(str(error) or type(error).__name__)) from None


def _exr_depth(data: bytes, header: _Header) -> FloatArray:
    """Return the depth channel (h, w) from blocks of lines, each with all channels one after the other."""
    names = [name for name, _ in header.channels]
    wanted = next((name for name in EXR_DEPTH_CHANNELS if name in names), names[0] if len(names) == 1 else None)
    if wanted is None:
        raise ValueError(f"channels {', '.join(names)}")
    line = sum(kind.itemsize for _, kind in header.channels) * header.width
    before = sum(kind.itemsize for _, kind in header.channels[: names.index(wanted)]) * header.width
    kind = header.channels[names.index(wanted)][1]
    depth, lines = np.empty((header.height, header.width)), EXR_BLOCK_LINES[header.compression]
    blocks = -(-header.height // lines)
    for number, offset in enumerate(struct.unpack_from(f"<{blocks}Q", data, header.end)):
        first = number * lines
        count = min(lines, header.height - first)
        (size,) = struct.unpack_from("<i", data, offset + 4)
        packed = data[offset + 8 : offset + 8 + size]
        block = np.frombuffer(packed, dtype=np.uint8)
        if size != line * count:
            # A ZIP block: its differences are summed, and its two halves are interleaved.
            raw = np.frombuffer(zlib.decompressobj().decompress(packed, line * count), dtype=np.uint8).astype(np.int64)
            if len(raw) != line * count:
                raise ValueError("a block that ends early")
            raw[1:] -= 128
            summed = np.cumsum(raw).astype(np.uint8)
            block, half = np.empty(line * count, dtype=np.uint8), (line * count + 1) // 2
            block[0::2], block[1::2] = summed[:half], summed[half:]
        rows = block.reshape(count, line)
        rows = rows[:, before : before + kind.itemsize * header.width]
        depth[first : first + count] = np.ascontiguousarray(rows).view(kind)
    return depth


def _text(data: bytes, position: int) -> tuple[str, int]:
    """Return the text before a zero byte, and the position after this byte."""
    end = data.index(b"\0", position)
    return data[position:end].decode("ascii"), end + 1


@dataclass(frozen=True, slots=True, eq=False)
class DepthMaps:
    """Depth maps of one file."""

    values: FloatArray  #: (n, h, w)
    focal: FloatArray | None = None  #: (n,) or (1,) focal length in pixels of the map; None if it is not stated.


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

    kind, focal = file.suffix.lower(), None
    if kind == ".npz":
        depth, focal = _npz(file)
    elif reader := {".npy": _npy, ".pfm": _pfm, ".exr": read_exr}.get(kind):
        depth = reader(file)
    else:
        values = read_picture(file, cv2.IMREAD_UNCHANGED)
        if values is None or values.dtype != np.uint16:
            actual = Unquoted("no picture" if values is None else str(values.dtype))
            raise InputError.at(file, "picture", "a PNG of 16 bits", actual)
        depth = np.where(values > 0, values.astype(float), np.nan) * png_metres
    shape = depth.shape
    if depth.ndim == 4 and 1 in (shape[1], shape[3]):
        depth = depth[:, 0] if shape[1] == 1 else depth[..., 0]
    elif depth.ndim == 3 and shape[2] == 1 and shape[1] > 1:
        depth = depth[..., 0]
    if depth.ndim == 2:
        depth = depth[None]
    if depth.ndim != 3 or not 0 < depth.size <= MAX_PIXELS:
        raise InputError.at(file, "shape", "(h, w) or (n, h, w), one channel", shape)
    return DepthMaps(depth, focal)


def _npz(file: Path) -> tuple[FloatArray, FloatArray | None]:
    """Read the depth of an archive, and its focal lengths (n,), if any."""
    try:
        with zipfile.ZipFile(file) as entries:
            n_bytes = sum(entry.file_size for entry in entries.infolist())
        if n_bytes > 8 * MAX_PIXELS:
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


def _npy(file: Path) -> FloatArray:
    """Read the values of a NumPy file, of any shape."""
    try:
        # np.load would open a .npz or a pickle under this name too.
        values = np.lib.format.open_memmap(file, mode="r")
        return np.asarray(values, dtype=float)
    except Exception as error:  # noqa: BLE001 - NumPy raises a dozen kinds for damaged headers
        words = Unquoted(str(error) or type(error).__name__)
        raise InputError.at(file, "array", "a NumPy array of numbers", words) from None


def _pfm(file: Path) -> FloatArray:
    """Read a portable float map (h, w): `Pf`, size, a scale whose sign is the byte order, rows from the bottom up."""
    parts = file.read_bytes().split(maxsplit=4) if file.stat().st_size <= 4 * MAX_PIXELS + 99 else []
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


@dataclass(frozen=True, slots=True)
class MetricDepth:
    """A folder of depth maps with the names of the images."""

    folder: Path
    png_metres: float = 0.001  #: Metres per unit of a PNG.
    unit: str = "metres"  #: Or one of `FOCAL_UNITS`.
    network_sd: float = NETWORK_SD  #: Standard deviation of the log scale of the network, which all images share.

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:  # noqa: ARG002
        """Return the median over the views of their median ratio; skipped without maps of the views."""
        if not self.folder.is_dir():
            raise InputError.at(self.folder, "--metric-depth", "a folder of depth maps", "no such folder")
        by_view = [view_log_ratio(view, scene, depth) for view, depth in self._maps(scene)]
        ratios = np.array([ratio for ratio in by_view if ratio is not None])
        if not len(ratios):
            return skipped_evidence(KIND, self.folder.name, "no depth map has the name of a view and points in it")
        sd_log = math.hypot(frame_sd(ratios) / math.sqrt(len(ratios)), self.network_sd)
        return (ScaleEvidence(KIND, self.folder.name, math.exp(float(np.median(ratios))), sd_log),)

    def _maps(self, scene: Scene) -> Iterator[tuple[View, FloatArray]]:
        """Yield the views that have a map, with their depths (h, w) in metres."""
        files = [_file(self.folder, view.name) for view in scene.views]
        stack = next((self.folder / name for name in STACKS if (self.folder / name).is_file()), None)
        if stack is not None and not any(files):
            views, maps = sorted(scene.views, key=lambda view: view.name), read_depths(stack, self.png_metres)
            if len(maps.values) != len(views):
                raise InputError.at(stack, "maps", f"one for each of the {len(views)} views", len(maps.values))
            for row, view in enumerate(views):
                yield view, self._metres(view, maps, row)
            return
        for view, file in zip(scene.views, files, strict=True):
            if file is not None:
                maps = read_depths(file, self.png_metres)
                if len(maps.values) != 1:
                    raise InputError.at(file, "shape", "(h, w), one channel", maps.values.shape)
                yield view, self._metres(view, maps, 0)

    def _metres(self, view: View, maps: DepthMaps, row: int) -> FloatArray:
        """Return a map (h, w) in metres, by the focal length in the file or, by default, of the camera of the view."""
        values = np.asarray(maps.values[row])
        if self.unit == "metres":
            return values
        # The first parameter of every camera model is a focal length in pixels.
        focal = view.camera.focal_px * values.shape[1] / view.camera.width
        if maps.focal is not None and len(maps.focal) in {1, len(maps.values)}:
            focal = float(maps.focal[row % len(maps.focal)])
        return np.asarray(values * (focal / FOCAL_UNITS[self.unit]))


def frame_sd(ratios: FloatArray) -> float:
    """Return the standard deviation of the log ratios (n,) of the images, shrunk towards `FRAME_SD`."""
    sigma = robust_sigma(ratios) if len(ratios) > 1 else 0.0
    freedom = len(ratios) - 1
    return math.sqrt((freedom * sigma**2 + FRAME_PRIOR_COUNT * FRAME_SD**2) / (freedom + FRAME_PRIOR_COUNT))


def _file(folder: Path, name: str) -> Path | None:
    """Find the map of a view: for `a/b.jpg`, `a/b.npy` or `b.npy`, `b_depth.npy`, or `b/depth.exr`."""
    relative = PurePosixPath(name.replace("\\", "/"))
    if relative.is_absolute() or ".." in relative.parts:
        relative = PurePosixPath(relative.name)
    stems = [folder / relative.with_suffix(""), folder / relative.stem]
    paths = [path for stem in stems for path in (stem, stem.with_name(f"{stem.name}_depth"), stem / "depth")]
    files = (path.with_name(path.name + suffix) for path in paths for suffix in SUFFIXES)
    return next((file for file in files if file.is_file()), None)


def view_log_ratio(view: View, scene: Scene, depth: FloatArray) -> float | None:
    """Return the median of ln(metres / units) over the points of a view, by its depth map (h, w).

    None if fewer than `MIN_POINTS` have a depth.
    """
    rows = view.point_index if len(view.point_index) else np.arange(len(scene.points))
    rows = evenly_spaced(rows, MAX_POINTS)
    pixels, depths = pixels_in_view(view, scene.points[rows])
    height, width = depth.shape
    with np.errstate(invalid="ignore"):
        column = np.floor(pixels[:, 0] * width / view.camera.width)
        row = np.floor(pixels[:, 1] * height / view.camera.height)
        inside = (depths > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    metres = depth[row[inside].astype(int), column[inside].astype(int)]
    is_valid = np.isfinite(metres) & (metres > 0)
    if np.count_nonzero(is_valid) < MIN_POINTS:
        return None
    return float(np.median(np.log(metres[is_valid] / depths[inside][is_valid])))
