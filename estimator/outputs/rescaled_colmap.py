"""COLMAP's files with every length scaled in place: image, frame and sensor translations, and points."""

from __future__ import annotations

import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from estimator.reconstructions.checked_files import ByteReader
from estimator.reconstructions.colmap_binary import image_places, point_places
from metric_base.arrays import IntArray
from metric_base.errors import FieldError, Unquoted, at_field, in_file
from metric_base.input_files import read_text

__all__ = ["write_scaled_colmap"]

_RIG = struct.Struct("<II")  # id, number of sensors
_SENSOR = struct.Struct("<iI")  # type, id
_FLAG = struct.Struct("<B")  # whether a pose follows
_POSE = struct.Struct("<7d")  # quaternion, translation
_FRAME = struct.Struct("<II7dI")  # id, rig id, pose, number of data ids
_DATA = struct.Struct("<iIQ")  # sensor type, sensor id, data id
_ROTATION_BYTES = 4 * 8
_BYTES = 3 * 8
#: Triples scaled at a time, which bounds the memory of the index that gathers them.
_CHUNK = 1 << 16


def write_scaled_colmap(source: Path, suffix: str, scale: float, target: Path) -> None:
    """The model's files (three, or five with rigs and frames) of one kind, `.bin` or `.txt`, in the folder `target`."""
    shutil.copyfile(source / f"cameras{suffix}", target / f"cameras{suffix}")
    for part in ("images", "points3D", "rigs", "frames"):
        file = source / f"{part}{suffix}"
        if part in {"rigs", "frames"} and not file.is_file():
            continue
        if suffix == ".bin":
            reader = ByteReader(file)
            (target / file.name).write_bytes(_scaled_bytes(reader.data, _BINARY_PLACES[part](reader), scale))
        else:
            (target / file.name).write_text(_scaled_text(file, part, scale), encoding="utf-8")


def _scaled_bytes(data: bytes, places: IntArray, scale: float) -> bytearray:
    """The bytes with the three doubles at each place (n,) multiplied."""
    scaled = bytearray(data)
    view = np.frombuffer(scaled, dtype=np.uint8)
    for start in range(0, len(places), _CHUNK):
        index = places[start : start + _CHUNK, None] + np.arange(_BYTES)
        view[index] = (view[index].view("<f8") * scale).view(np.uint8)
    return scaled


def _image_translations(reader: ByteReader) -> IntArray:
    """(n,) bytes at which the translations of the images begin."""
    return np.array(image_places(reader), dtype=np.int64) + 4 + _ROTATION_BYTES


def _point_coordinates(reader: ByteReader) -> IntArray:
    """(n,) bytes at which the coordinates of the points begin."""
    return point_places(reader) + 8


def _rig_translations(reader: ByteReader) -> IntArray:
    """(n,) bytes at which the translations of the rigs' sensors begin."""
    places = []
    for rig in range(reader.count("number of rigs", _RIG.size)):
        _, sensors = reader.take(_RIG, f"rig {rig}")
        for sensor in range(sensors):
            reader.take(_SENSOR, f"rig {rig} sensor {sensor}")
            # the first sensor is the reference and has no pose of its own
            if sensor and reader.take(_FLAG, f"rig {rig} sensor {sensor}")[0]:
                places.append(reader.place + _ROTATION_BYTES)
                reader.take(_POSE, f"rig {rig} sensor {sensor} pose")
    return np.array(places, dtype=np.int64)


def _frame_translations(reader: ByteReader) -> IntArray:
    """(n,) bytes at which the translations of the frames begin."""
    places = []
    for frame in range(reader.count("number of frames", _FRAME.size)):
        places.append(reader.place + 2 * 4 + _ROTATION_BYTES)
        *_, data_ids = reader.take(_FRAME, f"frame {frame}")
        reader.rows(f"V{_DATA.size}", data_ids, f"frame {frame} data ids")
    return np.array(places, dtype=np.int64)


_BINARY_PLACES: dict[str, Callable[[ByteReader], IntArray]] = {
    "images": _image_translations,
    "points3D": _point_coordinates,
    "rigs": _rig_translations,
    "frames": _frame_translations,
}


def _scaled_text(file: Path, part: str, scale: float) -> str:
    """The file with its lengths multiplied; comments and the lines of keypoints stay as they are."""
    lines, is_keypoints = read_text(file).split("\n"), False
    for row, line in enumerate(lines):
        if line.lstrip().startswith("#") or not (line.strip() or is_keypoints):
            continue
        if not is_keypoints:
            with in_file(file), at_field(f"line {row + 1}"):
                lines[row] = _scaled_line(line, part, scale)
        is_keypoints = part == "images" and not is_keypoints
    return "\n".join(lines)


def _rig_columns(words: list[str]) -> list[int]:
    """Columns of translations: RIG_ID NUM TYPE ID, then TYPE ID HAS_POSE and, with a pose, seven numbers."""
    columns, place = [], 4
    while place + 2 < len(words):
        has_pose = words[place + 2] == "1"
        if has_pose:
            columns += [place + 7, place + 8, place + 9]
        place += 10 if has_pose else 3
    return columns


#: How often a line is split (an image's name may hold blanks), and the columns of its lengths.
_TEXT_PLACES: dict[str, tuple[int, Callable[[list[str]], list[int]]]] = {
    "images": (9, lambda _: [5, 6, 7]),
    "points3D": (4, lambda _: [1, 2, 3]),
    "frames": (9, lambda _: [6, 7, 8]),
    "rigs": (-1, _rig_columns),
}


def _scaled_line(line: str, part: str, scale: float) -> str:
    splits, columns = _TEXT_PLACES[part]
    words = line.split(None, splits)
    try:
        for column in columns(words):
            words[column] = repr(float(words[column]) * scale)
    except (ValueError, IndexError):
        record = Unquoted(" ".join(words))
        raise FieldError("", "a record of COLMAP's text form", record) from None
    return " ".join(words)
