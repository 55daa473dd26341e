"""COLMAP's binary files (colmap/scene/reconstruction_io_binary.cc), all little endian.

Counts are checked against the bytes that remain before anything is allocated: COLMAP itself takes a minute and
all memory over a points3D.bin of zero bytes. pycolmap does not take the place of this module: the check before it would
be the same walk through the files, which writing a model at another scale needs too, and it hands over keypoints one
object at a time, so that a scene takes about ten times as long.

COLMAP's text files (colmap/scene/reconstruction_io_text.cc).
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
from metric_base.errors import FieldError, InputError, Unquoted, at_field, in_file
from metric_base.input_files import read_text
from metric_base.parsing import BinaryReader

_CAMERA = struct.Struct("<IiQQ")  # id, model, width, height; then the parameters
_IMAGE = struct.Struct("<I7dI")  # id, quaternion, translation, camera id; then the name and the keypoints
_KEYPOINT = np.dtype([("pixel", "<f8", 2), ("point", "<u8")])
_POINT = struct.Struct("<Q3d3BdQ")  # id, x y z, colour, error, track length; then the track
_TRACK_LENGTH = struct.Struct("<Q")
_TRACK_ELEMENT_BYTES = 8
#: Points gathered at a time, which bounds the memory of the index that gathers them.
_CHUNK = 1 << 16
_MODEL_NAMES = {number: (name, len(params)) for name, (number, params) in CAMERA_MODELS.items()}
_IMAGE_FIELDS = 10  # id, quaternion, translation, camera id, name (which may hold spaces)
_POINT_FIELDS = 4  # id, x, y, z; colour, error and track follow
#: Largest whole number up to which doubles hold every one of them.
MAX_EXACT = 2**53


@dataclass(frozen=True, slots=True, eq=False)
class ColmapImage:
    """quaternion : (4,) w x y z, world to camera; keypoints : (m, 2); point_ids : (m,), -1 without a point."""

    id: int
    quaternion: FloatArray
    translation: FloatArray
    camera_id: int
    name: str
    keypoints: FloatArray
    point_ids: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class ColmapModel:
    """cameras by id; images in file order; point_ids : (n,); points : (n, 3)."""

    cameras: dict[int, Camera]
    images: tuple[ColmapImage, ...]
    point_ids: IntArray
    points: FloatArray


def read_binary_model(folder: Path) -> ColmapModel:
    """cameras.bin, images.bin and points3D.bin; rigs.bin and frames.bin repeat what the images say."""
    cameras = _binary_cameras(BinaryReader(folder / "cameras.bin"))
    images = _binary_images(BinaryReader(folder / "images.bin"))
    ids, points = _binary_points(BinaryReader(folder / "points3D.bin"))
    return ColmapModel(cameras, images, ids, points)


def point_places(reader: BinaryReader) -> IntArray:
    """(n,) where each point's record starts: the one walk through the file that its layout forces."""
    n = reader.count("number of points", _POINT.size)
    data, place, last = reader.data, reader.place, len(reader.data) - _POINT.size
    places = np.empty(n, dtype=np.int64)
    length_at, record, length_of = _POINT.size - 8, _POINT.size, _TRACK_LENGTH.unpack_from
    for number in range(n):
        if place > last:
            raise InputError.at(
                reader.path, f"point {number}", f"{record} bytes", Unquoted(f"{max(len(data) - place, 0)} left")
            )
        places[number] = place
        place += record + _TRACK_ELEMENT_BYTES * length_of(data, place + length_at)[0]
    if place > len(data):
        overrun = Unquoted(f"a track that ends {place - len(data)} bytes beyond it")
        raise InputError.at(reader.path, f"point {n - 1} track", "an end within the file", overrun)
    reader.place = place
    reader.end()
    return places


def _binary_cameras(reader: BinaryReader) -> dict[int, Camera]:
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
    return cameras


def _binary_images(reader: BinaryReader) -> tuple[ColmapImage, ...]:
    images = []
    for number in range(reader.count("number of images", _IMAGE.size + 1 + 8)):
        image_id, *pose, camera_id = reader.take(_IMAGE, f"image {number}")
        name = reader.name(f"image {number} name")
        field = f"image {name!r} keypoints"
        rows = reader.rows(_KEYPOINT, reader.count(field, _KEYPOINT.itemsize), field)
        # COLMAP's invalid id is 2^64 - 1, which is -1 here
        point_ids = rows["point"].astype(np.int64)
        keypoints = rows["pixel"].astype(np.float64)
        images.append(
            ColmapImage(image_id, np.array(pose[:4]), np.array(pose[4:]), camera_id, name, keypoints, point_ids)
        )
    reader.end()
    return tuple(images)


def _binary_points(reader: BinaryReader) -> tuple[IntArray, FloatArray]:
    """Ids (n,) and positions (n, 3) of the points."""
    places = point_places(reader)
    data = np.frombuffer(reader.data, dtype=np.uint8)
    ids, points = np.empty(len(places), dtype=np.int64), np.empty((len(places), 3))
    for start in range(0, len(places), _CHUNK):
        # (m, 32) bytes: 8 of the id, 24 of the coordinates
        rows = data[places[start : start + _CHUNK, None] + np.arange(32)]
        ids[start : start + _CHUNK] = rows[:, :8].copy().view("<i8")[:, 0]
        points[start : start + _CHUNK] = rows[:, 8:].copy().view("<f8")
    return ids, points


def read_text_model(folder: Path) -> ColmapModel:
    """cameras.txt, images.txt and points3D.txt; rigs.txt and frames.txt repeat what the images say."""
    with in_file(folder / "cameras.txt") as file:
        cameras = _text_cameras(_lines(file))
    with in_file(folder / "images.txt") as file:
        images = _text_images(_lines(file))
    with in_file(folder / "points3D.txt") as file:
        ids, points = _text_points(_lines(file))
    return ColmapModel(cameras, images, ids, points)


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Number and text of the lines, the comments left out; blank lines are kept, for they can mean no keypoints."""
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        if not line.lstrip().startswith("#"):
            yield number, line.strip()


def _text_cameras(lines: Iterator[tuple[int, str]]) -> dict[int, Camera]:
    cameras: dict[int, Camera] = {}
    for number, line in lines:
        if not line:
            continue
        with at_field(f"line {number}"):
            words = line.split()
            if len(words) < 4:
                raise FieldError("", "camera id, model, width, height and parameters", line)
            camera_id, width, height = (_integer(word) for word in (words[0], words[2], words[3]))
            if camera_id in cameras:
                raise FieldError("", "each camera id once", Unquoted(f"{camera_id} twice"))
            params = _numbers(words[4:])
            with at_field(f"camera {camera_id}"):
                cameras[camera_id] = make_camera(words[1], (width, height), params)
    return cameras


def _text_images(lines: Iterator[tuple[int, str]]) -> tuple[ColmapImage, ...]:
    """Two lines an image; the second, its keypoints, may be blank."""
    images = []
    for number, line in lines:
        if not line:
            continue
        with at_field(f"line {number}"):
            words = line.split(maxsplit=_IMAGE_FIELDS - 1)
            if len(words) != _IMAGE_FIELDS:
                raise FieldError("", "id, quaternion, translation, camera id and name", line)
            image_id, camera_id = _integer(words[0]), _integer(words[8])
            pose = _numbers(words[1:8])
        following, row = next(lines, (number + 1, ""))
        with at_field(f"line {following}"):
            keypoints, point_ids = _keypoints(row)
        images.append(ColmapImage(image_id, pose[:4], pose[4:], camera_id, words[9], keypoints, point_ids))
    return tuple(images)


def _keypoints(row: str) -> tuple[FloatArray, IntArray]:
    """(m, 2) pixels and (m,) point ids of a line of triples."""
    values = _table([row])[0] if row else np.empty(0)
    if len(values) % 3:
        raise FieldError("", "keypoints as x, y, point id", Unquoted(f"{len(values)} numbers"))
    triples = values.reshape(-1, 3)
    return triples[:, :2], _whole(triples[:, 2])


def _text_points(lines: Iterator[tuple[int, str]]) -> tuple[IntArray, FloatArray]:
    """(n,) ids and (n, 3) coordinates."""
    rows = [line for _, line in lines if line]
    if not rows:
        return np.empty(0, dtype=np.int64), np.empty((0, 3))
    with at_field("points"):
        table = _table(rows, range(_POINT_FIELDS))
    with at_field("point id"):
        return _whole(table[:, 0]), table[:, 1:]


def _table(lines: Sequence[str], columns: Sequence[int] | None = None) -> FloatArray:
    """(n, c) numbers of n lines of c columns, as doubles: whole numbers up to 2^53 stay exact."""
    try:
        return np.loadtxt(lines, dtype=np.float64, comments=None, usecols=columns, ndmin=2)
    except ValueError as error:
        raise FieldError("", "numbers", Unquoted(str(error))) from None


def _whole(values: FloatArray) -> IntArray:
    """The values (n,) as whole numbers; FieldError names the first that is not one."""
    faulty = ~(np.abs(values) <= MAX_EXACT) | (values != np.floor(values))
    if faulty.any():
        raise FieldError("", "whole numbers", float(values[faulty.argmax()]))
    return values.astype(np.int64)


def _integer(word: str) -> int:
    return int(_whole(_numbers([word]))[0])


def _numbers(words: Sequence[str]) -> FloatArray:
    """(n,) numbers of words."""
    return _table([" ".join(words)])[0] if words else np.empty(0)
