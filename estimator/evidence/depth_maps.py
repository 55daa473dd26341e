"""Depth maps on disk as networks write them: NumPy arrays and archives, EXR, PFM, and 16-bit PNG.

MoGe writes `NAME/depth.exr`, Depth Pro `NAME.npz` with `depth`, Depth Anything 3 `results.npz` with the `depth` of all
pictures and their `intrinsics`, MapAnything's `depth_z` (one or many, with a last axis of one); UniDepth and Metric3D
return arrays of shape (1, 1, h, w) that users save as NPY.

One channel of an OpenEXR picture in scan lines, as depth networks write it: floats, uncompressed or ZIP.

OpenCV's wheels read EXR no longer, and a depth map needs no more than this. Layout: openexr.com, "OpenEXR File Layout".

Depth maps in metres that a network made, against the reconstruction's own depths.
"""

from __future__ import annotations

import math
import struct
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from estimator.evidence.source import silent
from estimator.projection.cameras import pixels_in_view
from estimator.records.result import ScaleEvidence
from estimator.records.scene import Scene, View
from metric_base.arrays import FloatArray
from metric_base.errors import InputError, Unquoted
from metric_base.images import read_picture
from metric_base.statistics import robust_sigma

if TYPE_CHECKING:
    from estimator.records.objects import Measurements

MAGIC = 20000630
#: Bits of the version field that say tiles, deep data or several parts: none is a depth map of a network.
OTHER_LAYOUTS = 0x1A00
#: Types of a channel by their number: unsigned, half, float.
TYPES = (np.dtype("<u4"), np.dtype("<f2"), np.dtype("<f4"))
#: Scan lines of a block by the number of the compression: none, ZIP by the line, ZIP by sixteen.
BLOCK_LINES = {0: 1, 2: 1, 3: 16}
#: Names of the channel that holds the depth, best first; a grey picture of colours has the same in each.
DEPTH_CHANNELS = ("Z", "Y", "depth", "R")
EXR_PIXELS, EXR_BYTES = 2**27, 2**30
SUFFIXES = (".npy", ".npz", ".exr", ".pfm", ".png")
#: Names of the depth in an archive, best first; a single array needs none of them. `depth_along_ray` is no depth.
DEPTH_KEYS = ("metric_depth", "depth_z", "depth", "depth_m", "pred_depth", "prediction")
#: Names of the intrinsics (..., 3, 3) in pixels of the map, and of a focal length in pixels.
INTRINSICS_KEYS, FOCAL_KEYS = ("intrinsics", "K"), ("focallength_px", "focal_length_px", "focal")
#: Most pixels of a map that is believed.
MOST_PIXELS = 2**27
KIND = "metric_depth"
#: What a network's metres are worth in a scene unlike those it learned from, natural log, all maps alike: reports of
#: users range from a few per cent to a factor of two, VGGT with MoGe-2 is said to be typically within 10 to 20 %.
NETWORK_SD = 0.15
#: A network's scale differs from picture to picture besides: a random effect, whose spread is learned from the
#: pictures, with so many pictures' worth of belief in this standard deviation of ln scale before any is seen.
FRAME_SD, FRAME_WORTH = 0.1, 3
#: What a value is: metres, or a focal length in pixels of the map times the value over this number. Depth Anything 3's
#: metric model is made for a focal length of 300 pixels, Metric3D's for one of 1000.
FOCAL_UNITS = {"da3": 300.0, "metric3d": 1000.0}
#: Names of a file with the maps of all views, in the order of their names, as Depth Anything 3 exports it.
STACKS = ("results.npz", "exports/npz/results.npz", "exports/mini_npz/results.npz")
#: Points with a depth in the map that give the median of a view, at least and at most.
LEAST_POINTS, MOST_POINTS = 20, 5000


@dataclass(frozen=True, slots=True)
class _Header:
    """Channels in the file's order, each with its type; compression; width and height; where the offsets begin."""

    channels: tuple[tuple[str, np.dtype[np.generic]], ...]
    compression: int
    width: int
    height: int
    end: int


def read_exr(file: Path) -> FloatArray:
    """(h, w) values of the depth channel, or of the only channel.

    Raises
    ------
    InputError
        It is no such picture, or it is damaged.
    """
    data = file.read_bytes() if file.stat().st_size <= EXR_BYTES else b""
    try:
        return _depth(data, _header(data))
    except (struct.error, ValueError, KeyError, IndexError, OverflowError, zlib.error) as error:
        expected = "an OpenEXR picture in scan lines, uncompressed or ZIP, with one depth channel"
        raise InputError.at(file, "picture", expected, Unquoted(str(error) or type(error).__name__)) from None


def _header(data: bytes) -> _Header:
    magic, version = struct.unpack_from("<II", data)
    if magic != MAGIC or version & OTHER_LAYOUTS:
        raise ValueError("another format" if magic != MAGIC else "tiles, deep data or several parts")
    place, fields = 8, dict[str, bytes]()
    while data[place]:
        name, place = _text(data, place)
        _, place = _text(data, place)
        (size,) = struct.unpack_from("<i", data, place)
        if size < 0:
            raise ValueError("a field of negative size")
        fields[name] = data[place + 4 : place + 4 + size]
        place += 4 + size
    left, top, right, bottom = struct.unpack("<4i", fields["dataWindow"])
    width, height = right - left + 1, bottom - top + 1
    if min(width, height) < 1 or width * height > EXR_PIXELS:
        raise ValueError(f"a size of {width} x {height}")
    if fields["compression"][0] not in BLOCK_LINES:
        raise ValueError(f"compression number {fields['compression'][0]}")
    return _Header(_channels(fields["channels"]), fields["compression"][0], width, height, place + 1)


def _channels(data: bytes) -> tuple[tuple[str, np.dtype[np.generic]], ...]:
    channels, place = [], 0
    while data[place]:
        name, place = _text(data, place)
        kind, _, step_x, step_y = struct.unpack_from("<IIii", data, place)
        if (step_x, step_y) != (1, 1):
            raise ValueError(f"channel {name} has a coarser grid")
        channels.append((name, TYPES[kind]))
        place += 16
    return tuple(channels)


def _depth(data: bytes, header: _Header) -> FloatArray:
    """(h, w) of the depth channel: blocks of lines, each with all channels one after the other."""
    names = [name for name, _ in header.channels]
    wanted = next((name for name in DEPTH_CHANNELS if name in names), names[0] if len(names) == 1 else None)
    if wanted is None:
        raise ValueError(f"channels {', '.join(names)}")
    line = sum(kind.itemsize for _, kind in header.channels) * header.width
    before = sum(kind.itemsize for _, kind in header.channels[: names.index(wanted)]) * header.width
    kind = header.channels[names.index(wanted)][1]
    depth, lines = np.empty((header.height, header.width)), BLOCK_LINES[header.compression]
    blocks = -(-header.height // lines)
    for number, offset in enumerate(struct.unpack_from(f"<{blocks}Q", data, header.end)):
        first = number * lines
        here = min(lines, header.height - first)
        (size,) = struct.unpack_from("<i", data, offset + 4)
        packed = data[offset + 8 : offset + 8 + size]
        block = packed if size == line * here else _plain_bytes(packed, line * here)
        rows = np.frombuffer(block, dtype=np.uint8).reshape(here, line)[
            :, before : before + kind.itemsize * header.width
        ]
        depth[first : first + here] = np.ascontiguousarray(rows).view(kind)
    return depth


def _plain_bytes(packed: bytes, size: int) -> bytes:
    """The bytes of a ZIP block: differences summed, then the two halves interleaved."""
    stream = zlib.decompressobj()
    raw = np.frombuffer(stream.decompress(packed, size), dtype=np.uint8).astype(np.int64)
    if len(raw) != size:
        raise ValueError("a block that ends early")
    raw[1:] -= 128
    summed = np.cumsum(raw).astype(np.uint8)
    whole = np.empty(size, dtype=np.uint8)
    half = (size + 1) // 2
    whole[0::2], whole[1::2] = summed[:half], summed[half:]
    return whole.tobytes()


def _text(data: bytes, place: int) -> tuple[str, int]:
    """The text that ends with a zero byte, and the place after it."""
    end = data.index(b"\0", place)
    return data[place:end].decode("ascii"), end + 1


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


@dataclass(frozen=True, slots=True)
class MetricDepth:
    """A folder of depth maps, named as the pictures (`depth_files` says in which forms).

    png_metres : metres of one step of a PNG; unit : `metres`, or one of `FOCAL_UNITS`; network_sd : what the network's
    metres are worth, one standard deviation of ln scale, all pictures alike.
    """

    folder: Path
    png_metres: float = 0.001
    unit: str = "metres"
    network_sd: float = NETWORK_SD

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:  # noqa: ARG002
        """The median over views of each view's median ratio; silent without maps of its views."""
        if not self.folder.is_dir():
            raise InputError.at(self.folder, "--metric-depth", "a folder of depth maps", "no such folder")
        seen = [_log_ratio(view, scene, depth) for view, depth in self._maps(scene)]
        ratios = np.array([ratio for ratio in seen if ratio is not None])
        if not len(ratios):
            return silent(KIND, self.folder.name, "no depth map has the name of a view and points in it")
        middle = float(np.median(ratios))
        spread = math.hypot(frame_sd(ratios) / math.sqrt(len(ratios)), self.network_sd)
        return (ScaleEvidence(KIND, self.folder.name, math.exp(middle), spread),)

    def _maps(self, scene: Scene) -> Iterator[tuple[View, FloatArray]]:
        """The views that have a map, each with its metres (h, w)."""
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
        """(h, w) metres of one of the maps. The focal length is the file's own, else that of the view's camera."""
        values = np.asarray(maps.values[row])
        if self.unit == "metres":
            return values
        # the first parameter of every camera model is a focal length in pixels
        focal = float(view.camera.params[0]) * values.shape[1] / view.camera.width
        if maps.focal is not None and len(maps.focal) in {1, len(maps.values)}:
            focal = float(maps.focal[row % len(maps.focal)])
        return np.asarray(values * (focal / FOCAL_UNITS[self.unit]))


def frame_sd(ratios: FloatArray) -> float:
    """The standard deviation of the pictures' own scales from their log ratios (n,), shrunk to what is usual."""
    own = robust_sigma(ratios) if len(ratios) > 1 else 0.0
    seen = len(ratios) - 1
    return math.sqrt((seen * own**2 + FRAME_WORTH * FRAME_SD**2) / (seen + FRAME_WORTH))


def _file(folder: Path, name: str) -> Path | None:
    """The view's map: `a/b.jpg` is `a/b.npy`, else `b.npy`; or `b_depth.npy`, or `b/depth.exr`."""
    relative = PurePosixPath(name.replace("\\", "/"))
    if relative.is_absolute() or ".." in relative.parts:
        relative = PurePosixPath(relative.name)
    stems = [folder / relative.with_suffix(""), folder / relative.stem]
    places = [place for stem in stems for place in (stem, stem.with_name(f"{stem.name}_depth"), stem / "depth")]
    files = (place.with_name(place.name + suffix) for place in places for suffix in SUFFIXES)
    return next((file for file in files if file.is_file()), None)


def _log_ratio(view: View, scene: Scene, depth: FloatArray) -> float | None:
    """Median ln(metres / units) over a view's points by its depth (h, w); None if too few are seen."""
    rows = view.point_index if len(view.point_index) else np.arange(len(scene.points))
    rows = rows[:: max(1, -(-len(rows) // MOST_POINTS))]
    pixels, depths = pixels_in_view(view, scene.points[rows])
    height, width = depth.shape
    with np.errstate(invalid="ignore"):
        column = np.floor(pixels[:, 0] * width / view.camera.width)
        line = np.floor(pixels[:, 1] * height / view.camera.height)
        inside = (depths > 0) & (column >= 0) & (column < width) & (line >= 0) & (line < height)
    metres = depth[line[inside].astype(int), column[inside].astype(int)]
    good = np.isfinite(metres) & (metres > 0)
    if np.count_nonzero(good) < LEAST_POINTS:
        return None
    return float(np.median(np.log(metres[good] / depths[inside][good])))
