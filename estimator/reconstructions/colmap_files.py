"""Parse the binary and text files of COLMAP (colmap/scene/reconstruction_io_binary.cc and reconstruction_io_text.cc).

Binary files are little endian. Counts are checked against the size of the file before memory is allocated; COLMAP
itself needs a minute and all memory for a points3D.bin of zero bytes. pycolmap is not used: it ends the process if a
file is damaged, and it returns keypoints one object at a time, which takes about ten times as long.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.projection.cameras import CAMERA_MODELS, make_camera
from estimator.records.scene import Camera
from metric_base.arrays import FloatArray, IntArray
from metric_base.errors import FieldError, InputError, Unquoted, at_field, damage_as_field_error, expect, in_file
from metric_base.input_files import read_text
from metric_base.parsing import BinaryReader

_CAMERA = struct.Struct("<IiQQ")  # id, model, width, height; then the parameters
_IMAGE = struct.Struct("<I7dI")  # id, quaternion, translation, camera id; then the name and the keypoints
_KEYPOINT = np.dtype([("pixel", "<f8", 2), ("point", "<u8")])
_POINT = struct.Struct("<Q3d3BdQ")  # id, x y z, colour, error, track length; then the track
_TRACK_LENGTH = struct.Struct("<Q")
_TRACK_ELEMENT_BYTES = 8
#: Number of points that are read at a time, which limits the memory of their index.
_CHUNK = 1 << 16
_MODEL_NAMES = {number: (name, len(params)) for name, (number, params) in CAMERA_MODELS.items()}
_IMAGE_FIELDS = 10  # id, quaternion, translation, camera id, name (which may contain spaces)
_POINT_FIELDS = 4  # id, x, y, z; colour, error and track follow
#: Maximum integer below which doubles represent all integers.
MAX_EXACT = 2**53


@dataclass(frozen=True, slots=True, eq=False)
class ColmapImage:
    """An image as its file states it."""

    id: int
    #: (4,) w, x, y, z of the rotation from world to camera.
    quaternion: FloatArray
    #: (3,)
    translation: FloatArray
    camera_id: int
    name: str
    #: (m, 2) pixels.
    keypoints: FloatArray
    #: (m,) ids of their points, -1 without a point.
    point_ids: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class ColmapModel:
    """A model as its files state it."""

    #: By id.
    cameras: dict[int, Camera]
    #: In the order of the file.
    images: tuple[ColmapImage, ...]
    #: (n,)
    point_ids: IntArray
    #: (n, 3)
    points: FloatArray


def read_binary_model(folder: Path) -> ColmapModel:
    """Read cameras.bin, images.bin and points3D.bin; rigs.bin and frames.bin repeat the poses of the images."""
    reader = BinaryReader(folder / "cameras.bin")
    cameras: dict[int, Camera] = {}
    for number in range(reader.count("number of cameras", _CAMERA.size)):
        camera_id, model_number, width, height = reader.take(_CAMERA, f"camera {number}")
        field = f"camera {camera_id}"
        if model_number not in _MODEL_NAMES:
            raise InputError.at(reader.path, f"{field} model", f"0 to {max(_MODEL_NAMES)}", model_number)
        if camera_id in cameras:
            raise InputError.at(reader.path, "camera id", "each one once", Unquoted(f"{camera_id} twice"))
        model, n_params = _MODEL_NAMES[model_number]
        params = reader.rows("<f8", n_params, f"{field} parameters")
        with in_file(reader.path), at_field(field):
            cameras[camera_id] = make_camera(model, (width, height), params)
    reader.end()

    reader = BinaryReader(folder / "images.bin")
    images = []
    for number in range(reader.count("number of images", _IMAGE.size + 1 + 8)):
        image_id, *pose, camera_id = reader.take(_IMAGE, f"image {number}")
        name = reader.name(f"image {number} name")
        field = f"image {name!r} keypoints"
        rows = reader.rows(_KEYPOINT, reader.count(field, _KEYPOINT.itemsize), field)
        # The invalid id of COLMAP, 2^64 - 1, becomes -1.
        point_ids = rows["point"].astype(np.int64)
        keypoints = rows["pixel"].astype(np.float64)
        images.append(
            ColmapImage(image_id, np.array(pose[:4]), np.array(pose[4:]), camera_id, name, keypoints, point_ids)
        )
    reader.end()

    reader = BinaryReader(folder / "points3D.bin")  # records have different lengths
    n = reader.count("number of points", _POINT.size)
    content, offset, last = reader.data, reader.place, len(reader.data) - _POINT.size
    offsets = np.empty(n, dtype=np.int64)
    length_at, record, length_of = _POINT.size - 8, _POINT.size, _TRACK_LENGTH.unpack_from
    for number in range(n):
        if offset > last:
            raise InputError.at(
                reader.path, f"point {number}", f"{record} bytes", Unquoted(f"{max(len(content) - offset, 0)} left")
            )
        offsets[number] = offset
        offset += record + _TRACK_ELEMENT_BYTES * length_of(content, offset + length_at)[0]
    if offset > len(content):
        overrun = Unquoted(f"a track that ends {offset - len(content)} bytes beyond it")
        raise InputError.at(reader.path, f"point {n - 1} track", "an end within the file", overrun)
    reader.place = offset
    reader.end()
    data = np.frombuffer(reader.data, dtype=np.uint8)
    ids, points = np.empty(len(offsets), dtype=np.int64), np.empty((len(offsets), 3))
    for start in range(0, len(offsets), _CHUNK):
        # (m, 32) bytes: 8 of the id, 24 of the coordinates.
        rows = data[offsets[start : start + _CHUNK, None] + np.arange(32)]
        ids[start : start + _CHUNK] = rows[:, :8].copy().view("<i8")[:, 0]
        points[start : start + _CHUNK] = rows[:, 8:].copy().view("<f8")
    return ColmapModel(cameras, tuple(images), ids, points)


def read_text_model(folder: Path) -> ColmapModel:
    """Read cameras.txt, images.txt and points3D.txt; rigs.txt and frames.txt repeat the poses of the images."""
    with in_file(folder / "cameras.txt") as file:
        cameras = _text_cameras(_lines(file))
    with in_file(folder / "images.txt") as file:
        images = _text_images(_lines(file))
    with in_file(folder / "points3D.txt") as file:
        rows = [line for _, line in _lines(file) if line]
        ids, points = np.empty(0, dtype=np.int64), np.empty((0, 3))
        if rows:
            with at_field("points"):
                table = _table(rows, range(_POINT_FIELDS))
            with at_field("point id"):
                ids, points = _integers(table[:, 0]), table[:, 1:]
    return ColmapModel(cameras, images, ids, points)


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield number and text of the lines without comments; an empty line may be an image without keypoints."""
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        if not line.lstrip().startswith("#"):
            yield number, line.strip()


def _text_cameras(lines: Iterator[tuple[int, str]]) -> dict[int, Camera]:
    """Return the cameras by id."""
    cameras: dict[int, Camera] = {}
    for number, line in lines:
        if not line:
            continue
        with at_field(f"line {number}"):
            words = line.split()
            expect(len(words) >= 4, "", "camera id, model, width, height and parameters", line)
            camera_id, width, height = (_integer(word) for word in (words[0], words[2], words[3]))
            expect(camera_id not in cameras, "", "each camera id once", Unquoted(f"{camera_id} twice"))
            params = _numbers(words[4:])
            with at_field(f"camera {camera_id}"):
                cameras[camera_id] = make_camera(words[1], (width, height), params)
    return cameras


def _text_images(lines: Iterator[tuple[int, str]]) -> tuple[ColmapImage, ...]:
    """Return the images, which have two lines each; the second one, with the keypoints, may be empty."""
    images = []
    for number, line in lines:
        if not line:
            continue
        with at_field(f"line {number}"):
            words = line.split(maxsplit=_IMAGE_FIELDS - 1)
            expect(len(words) == _IMAGE_FIELDS, "", "id, quaternion, translation, camera id and name", line)
            image_id, camera_id = _integer(words[0]), _integer(words[8])
            pose = _numbers(words[1:8])
        next_number, next_line = next(lines, (number + 1, ""))
        with at_field(f"line {next_number}"):
            values = _table([next_line])[0] if next_line else np.empty(0)
            expect(not len(values) % 3, "", "keypoints as x, y, point id", Unquoted(f"{len(values)} numbers"))
            triples = values.reshape(-1, 3)
            point_ids = _integers(triples[:, 2])
        images.append(ColmapImage(image_id, pose[:4], pose[4:], camera_id, words[9], triples[:, :2], point_ids))
    return tuple(images)


def _table(lines: Sequence[str], columns: Sequence[int] | None = None) -> FloatArray:
    """Return the numbers (n, c) of n lines of c columns as doubles; integers up to 2^53 are exact."""
    with damage_as_field_error("numbers", ValueError, str, field=""):
        return np.loadtxt(lines, dtype=np.float64, comments=None, usecols=columns, ndmin=2)


def _integers(values: FloatArray) -> IntArray:
    """Convert values (n,) to integers; FieldError for the first one that is not an integer."""
    is_invalid = ~(np.abs(values) <= MAX_EXACT) | (values != np.floor(values))
    if is_invalid.any():
        raise FieldError("", "whole numbers", float(values[is_invalid.argmax()]))
    return values.astype(np.int64)


def _integer(word: str) -> int:
    """Parse an integer."""
    return int(_integers(_numbers([word]))[0])


def _numbers(words: Sequence[str]) -> FloatArray:
    """Parse numbers (n,)."""
    return _table([" ".join(words)])[0] if words else np.empty(0)
