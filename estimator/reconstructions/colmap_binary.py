"""COLMAP's binary files (colmap/scene/reconstruction_io_binary.cc), all little endian.

Counts are checked against the bytes that remain before anything is allocated: COLMAP itself takes a minute and
all memory over a points3D.bin of zero bytes. pycolmap does not take the place of this module: the check before it would
be the same walk through the files, which writing a model at another scale needs too, and it hands over keypoints one
object at a time, so that a scene takes about ten times as long.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from estimator.projection.cameras import CAMERA_MODELS, make_camera
from estimator.reconstructions.checked_files import ByteReader
from estimator.reconstructions.colmap_model import ColmapImage, ColmapModel
from estimator.records.scene import Camera
from metric_base.arrays import FloatArray, IntArray
from metric_base.errors import InputError, Unquoted, at_field, in_file

__all__ = ["image_places", "point_places", "read_binary_model"]

_CAMERA = struct.Struct("<IiQQ")  # id, model, width, height; then the parameters
_IMAGE = struct.Struct("<I7dI")  # id, quaternion, translation, camera id; then the name and the keypoints
_KEYPOINT = np.dtype([("pixel", "<f8", 2), ("point", "<u8")])
_POINT = struct.Struct("<Q3d3BdQ")  # id, x y z, colour, error, track length; then the track
_TRACK_LENGTH = struct.Struct("<Q")
_TRACK_ELEMENT_BYTES = 8
#: Points gathered at a time, which bounds the memory of the index that gathers them.
_CHUNK = 1 << 16
_MODEL_NAMES = {number: (name, len(params)) for name, (number, params) in CAMERA_MODELS.items()}


def read_binary_model(folder: Path) -> ColmapModel:
    """cameras.bin, images.bin and points3D.bin; rigs.bin and frames.bin repeat what the images say."""
    cameras = _cameras(ByteReader(folder / "cameras.bin"))
    images = _images(ByteReader(folder / "images.bin"))
    ids, points = _points(ByteReader(folder / "points3D.bin"))
    return ColmapModel(cameras, images, ids, points)


def image_places(reader: ByteReader) -> list[int]:
    """Where each image's record starts in the file."""
    places = []
    for number in range(reader.count("number of images", _IMAGE.size + 1 + 8)):
        places.append(reader.place)
        reader.take(_IMAGE, f"image {number}")
        reader.name(f"image {number} name")
        field = f"image {number} keypoints"
        reader.rows(_KEYPOINT, reader.count(field, _KEYPOINT.itemsize), field)
    return places


def point_places(reader: ByteReader) -> IntArray:
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


def _cameras(reader: ByteReader) -> dict[int, Camera]:
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


def _images(reader: ByteReader) -> tuple[ColmapImage, ...]:
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


def _points(reader: ByteReader) -> tuple[IntArray, FloatArray]:
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
