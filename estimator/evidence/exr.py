"""One channel of an OpenEXR picture in scan lines, as depth networks write it: floats, uncompressed or ZIP.

OpenCV's wheels read EXR no longer, and a depth map needs no more than this. Layout: openexr.com, "OpenEXR File Layout".
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import InputError, Unquoted

__all__ = ["read_exr"]

MAGIC = 20000630
#: Bits of the version field that say tiles, deep data or several parts: none is a depth map of a network.
OTHER_LAYOUTS = 0x1A00
#: Types of a channel by their number: unsigned, half, float.
TYPES = (np.dtype("<u4"), np.dtype("<f2"), np.dtype("<f4"))
#: Scan lines of a block by the number of the compression: none, ZIP by the line, ZIP by sixteen.
BLOCK_LINES = {0: 1, 2: 1, 3: 16}
#: Names of the channel that holds the depth, best first; a grey picture of colours has the same in each.
DEPTH_CHANNELS = ("Z", "Y", "depth", "R")
MOST_PIXELS, MOST_BYTES = 2**27, 2**30


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
    data = file.read_bytes() if file.stat().st_size <= MOST_BYTES else b""
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
    if min(width, height) < 1 or width * height > MOST_PIXELS:
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
