"""What a camera writes of its lens into its videos: a telephone's focal length, an action camera's field of view.

The layout is that of Apple's "QuickTime File Format", chapter "Metadata": atoms `meta` with `keys` and `ilst`. FFmpeg
shows the entries of the video alone; the lens is one of the video track. GoPro's settings are keys of its metadata
format in the atom `GPMF` of `udta`.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from pathlib import Path

from estimator.telemetry.gpmf import keys

KEY = b"com.apple.quicktime.camera.focal_length.35mm_equivalent"
#: Largest table of contents that is read.
MAX_BYTES = 1 << 26
#: Focal lengths in millimetres of 35 mm film that a lens can have.
SHORTEST, LONGEST = 5.0, 1000.0
#: GoPro: the field of view from corner to corner in degrees, after cropping and stabilisation; the projection, and its
#: name of an uncorrected lens; the setting of the lens, and its name of a corrected one.
FIELD, PROJECTION, UNCORRECTED, SETTING, CORRECTED = b"ZFOV", b"PRJT", b"GPRO", b"VFOV", b"L"
#: Fields of view in degrees that an uncorrected lens can have.
NARROWEST, WIDEST = 60.0, 200.0
#: QuickTime's numbers for types of values.
_UTF8, _SIGNED, _UNSIGNED = 1, {21, 65, 66, 67, 74}, {22, 75, 76, 77, 78}
_FLOATS = {23: ">f", 24: ">d"}


def stated_focal_35mm(path: Path) -> float | None:
    """The focal length in millimetres of 35 mm film, None if the file states none, or is not of QuickTime's layout."""
    try:
        contents = _table_of_contents(path)
    except OSError:
        return None
    for atom in _metadata(contents):
        value = _value_in(atom)
        if value is not None and SHORTEST < value < LONGEST:
            return value
    return None


def stated_fisheye_deg(path: Path) -> float | None:
    """The field of view in degrees, from corner to corner, of a GoPro's uncorrected lens; None where none is stated."""
    try:
        contents = _table_of_contents(path)
    except OSError:
        return None
    users = [content for kind, content in _atoms(contents) if kind == b"udta"]
    for data in (content for user in users for kind, content in _atoms(user) if kind == b"GPMF"):
        stated = {row.name: row.value for device in keys(data) for row in keys(device.value)}
        if (
            stated.get(PROJECTION) != UNCORRECTED
            or stated.get(SETTING) == CORRECTED
            or len(stated.get(FIELD, b"")) != 4
        ):
            continue
        (degrees,) = struct.unpack(">f", stated[FIELD])
        if NARROWEST < degrees < WIDEST:
            return float(degrees)
    return None


def _table_of_contents(path: Path) -> bytes:
    """The bytes of the atom `moov`, which the frames are not part of; empty without one."""
    with path.open("rb") as file:
        while len(head := file.read(8)) == 8:
            size, kind = struct.unpack(">I4s", head)
            length = size - 8
            if size == 1:
                length = int.from_bytes(file.read(8), "big") - 16
            if kind == b"moov" and 0 < length <= MAX_BYTES:
                return file.read(length)
            if length < 0:  # to the end of the file, or damaged
                return b""
            file.seek(length, 1)
    return b""


def _atoms(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kind and content of each atom, up to one that does not fit."""
    at = 0
    while at + 8 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        if size < 8 or at + size > len(data):
            return
        yield kind, data[at + 8 : at + size]
        at += size


def _metadata(contents: bytes) -> Iterator[bytes]:
    """The atoms `meta` of the video and of its tracks."""
    for kind, content in _atoms(contents):
        if kind == b"meta":
            yield content
        elif kind in (b"trak", b"udta"):
            yield from (inner for name, inner in _atoms(content) if name == b"meta")


def _value_in(meta: bytes) -> float | None:
    """The value of the key in an atom `meta`, which in MPEG-4's form begins with four bytes of version."""
    parts = dict(_atoms(meta if meta[4:8] == b"hdlr" else meta[4:]))
    names = [name for _, name in _atoms(parts.get(b"keys", b"")[8:])]
    for number, item in _atoms(parts.get(b"ilst", b"")):
        row = int.from_bytes(number, "big") - 1
        if 0 <= row < len(names) and names[row] == KEY:
            return _number(dict(_atoms(item)).get(b"data", b""))
    return None


def _number(data: bytes) -> float | None:
    """The number in an atom `data`: its type, its language, its bytes."""
    kind, value = int.from_bytes(data[:4], "big"), data[8:]
    if kind in _SIGNED | _UNSIGNED and 0 < len(value) <= 8:
        return float(int.from_bytes(value, "big", signed=kind in _SIGNED))
    if kind in _FLOATS and len(value) == struct.calcsize(_FLOATS[kind]):
        return float(struct.unpack(_FLOATS[kind], value)[0])
    text = re.match(rb"\d{1,4}(\.\d{1,9})?", value) if kind == _UTF8 else None
    return float(text[0]) if text else None
