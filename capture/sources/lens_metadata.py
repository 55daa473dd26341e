"""Read the lens from the metadata of a video: a phone's focal length, an action camera's field of view.

The layout is that of Apple's "QuickTime File Format", chapter "Metadata": atoms `meta` with `keys` and `ilst`. FFmpeg
shows the entries of the file alone; the lens is an entry of the video track. GoPro's settings are keys of its metadata
format in the atom `GPMF` of `udta`.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from pathlib import Path

from estimator.telemetry.gpmf import keys
from metric_base.images import FOCAL_RANGE_35MM

KEY = b"com.apple.quicktime.camera.focal_length.35mm_equivalent"
#: Maximum size in bytes of a table of contents.
MAX_CONTENTS_BYTES = 1 << 26
#: GoPro: the field of view from corner to corner in degrees, after cropping and stabilisation; the projection, and the
#: name of an uncorrected lens; the setting of the lens, and the name of a corrected one.
FIELD, PROJECTION, UNCORRECTED, SETTING, CORRECTED = b"ZFOV", b"PRJT", b"GPRO", b"VFOV", b"L"
#: Range in degrees of a fisheye lens's field of view that is used.
FISHEYE_RANGE_DEG = (60.0, 200.0)
#: Types of values in an atom `data`.
_UTF8, _SIGNED, _UNSIGNED = 1, {21, 65, 66, 67, 74}, {22, 75, 76, 77, 78}
_FLOATS = {23: ">f", 24: ">d"}


def stated_focal_35mm(path: Path) -> float | None:
    """Return the focal length in millimetres of 35 mm film, None if the file states none or has another layout."""
    contents = list(_atoms(_table_of_contents(path)))
    tracks = [atom for kind, content in contents if kind in (b"trak", b"udta") for atom in _atoms(content)]
    for meta in (content for kind, content in (*contents, *tracks) if kind == b"meta"):
        # in MPEG-4's form the atom begins with four bytes of version
        parts = dict(_atoms(meta if meta[4:8] == b"hdlr" else meta[4:]))
        names = [name for _, name in _atoms(parts.get(b"keys", b"")[8:])]
        for number, item in _atoms(parts.get(b"ilst", b"")):
            row = int.from_bytes(number, "big") - 1
            if 0 <= row < len(names) and names[row] == KEY:
                value = _number(dict(_atoms(item)).get(b"data", b""))
                if value is not None and FOCAL_RANGE_35MM[0] < value < FOCAL_RANGE_35MM[1]:
                    return value
    return None


def stated_fisheye_deg(path: Path) -> float | None:
    """Return the field of view in degrees, from corner to corner, of a GoPro's uncorrected lens, None if not stated."""
    for data in (content for kind, content in _atoms(_table_of_contents(path)) if kind == b"udta"):
        for gpmf in (content for kind, content in _atoms(data) if kind == b"GPMF"):
            stated = {row.name: row.value for device in keys(gpmf) for row in keys(device.value)}
            is_uncorrected = stated.get(PROJECTION) == UNCORRECTED and stated.get(SETTING) != CORRECTED
            if is_uncorrected and len(stated.get(FIELD, b"")) == 4:
                (degrees,) = struct.unpack(">f", stated[FIELD])
                if FISHEYE_RANGE_DEG[0] < degrees < FISHEYE_RANGE_DEG[1]:
                    return float(degrees)
    return None


def _table_of_contents(path: Path) -> bytes:
    """Return the content of the atom `moov`, which excludes the frames; empty without one."""
    try:
        with path.open("rb") as file:
            while len(head := file.read(8)) == 8:
                size, kind = struct.unpack(">I4s", head)
                length = size - 8
                if size == 1:
                    length = int.from_bytes(file.read(8), "big") - 16
                if kind == b"moov" and 0 < length <= MAX_CONTENTS_BYTES:
                    return file.read(length)
                if length < 0:  # to the end of the file, or damaged
                    return b""
                file.seek(length, 1)
    except OSError:
        pass
    return b""


def _atoms(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield kind and content of each atom until an atom exceeds the data."""
    start = 0
    while start + 8 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, start)
        if size < 8 or start + size > len(data):
            return
        yield kind, data[start + 8 : start + size]
        start += size


def _number(data: bytes) -> float | None:
    """Return the number in an atom `data`, which has its type, its language and its bytes."""
    kind, value = int.from_bytes(data[:4], "big"), data[8:]
    if kind in _SIGNED | _UNSIGNED and 0 < len(value) <= 8:
        return float(int.from_bytes(value, "big", signed=kind in _SIGNED))
    if kind in _FLOATS and len(value) == struct.calcsize(_FLOATS[kind]):
        return float(struct.unpack(_FLOATS[kind], value)[0])
    text = re.match(rb"\d{1,4}(\.\d{1,9})?", value) if kind == _UTF8 else None
    return float(text[0]) if text else None
