"""COLMAP's text files (colmap/scene/reconstruction_io_text.cc)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from estimator.reconstructions.cameras import make_camera
from estimator.reconstructions.checked_files import read_text
from estimator.reconstructions.colmap_model import ColmapImage, ColmapModel
from estimator.records.scene import Camera
from metric_base.arrays import FloatArray, IntArray
from metric_base.faults import InputFault, Words

__all__ = ["read_text_model"]

_IMAGE_FIELDS = 10  # id, quaternion, translation, camera id, name (which may hold spaces)
_POINT_FIELDS = 4  # id, x, y, z; colour, error and track follow
#: Largest whole number up to which doubles hold every one of them.
MAX_EXACT = 2**53


def read_text_model(folder: Path) -> ColmapModel:
    """cameras.txt, images.txt and points3D.txt; rigs.txt and frames.txt repeat what the images say."""
    cameras = _cameras(folder / "cameras.txt")
    images = _images(folder / "images.txt")
    ids, points = _points(folder / "points3D.txt")
    return ColmapModel(cameras, images, ids, points)


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Number and text of the lines, the comments left out; blank lines are kept, for they can mean no keypoints."""
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        if not line.lstrip().startswith("#"):
            yield number, line.strip()


def _cameras(path: Path) -> dict[int, Camera]:
    cameras: dict[int, Camera] = {}
    for number, line in _lines(path):
        if not line:
            continue
        field, words = f"line {number}", line.split()
        if len(words) < 4:
            raise InputFault.at(path, field, "camera id, model, width, height and parameters", line)
        camera_id, width, height = (_integer(path, field, word) for word in (words[0], words[2], words[3]))
        if camera_id in cameras:
            raise InputFault.at(path, field, "each camera id once", Words(f"{camera_id} twice"))
        params = _numbers(path, field, words[4:])
        cameras[camera_id] = make_camera(path, f"{field} camera {camera_id}", words[1], (width, height), params)
    return cameras


def _images(path: Path) -> tuple[ColmapImage, ...]:
    """Two lines an image; the second, its keypoints, may be blank."""
    images, lines = [], _lines(path)
    for number, line in lines:
        if not line:
            continue
        field, words = f"line {number}", line.split(maxsplit=_IMAGE_FIELDS - 1)
        if len(words) != _IMAGE_FIELDS:
            raise InputFault.at(path, field, "id, quaternion, translation, camera id and name", line)
        image_id, camera_id = _integer(path, field, words[0]), _integer(path, field, words[8])
        pose = _numbers(path, field, words[1:8])
        number, row = next(lines, (number + 1, ""))  # noqa: PLW2901 (the pair of lines is one record)
        keypoints, point_ids = _keypoints(path, f"line {number}", row)
        images.append(ColmapImage(image_id, pose[:4], pose[4:], camera_id, words[9], keypoints, point_ids))
    return tuple(images)


def _keypoints(path: Path, field: str, row: str) -> tuple[FloatArray, IntArray]:
    values = _table(path, field, [row])[0] if row else np.empty(0)
    if len(values) % 3:
        raise InputFault.at(path, field, "keypoints as x, y, point id", Words(f"{len(values)} numbers"))
    triples = values.reshape(-1, 3)
    return triples[:, :2], _whole(path, field, triples[:, 2])


def _points(path: Path) -> tuple[IntArray, FloatArray]:
    lines = [line for _, line in _lines(path) if line]
    if not lines:
        return np.empty(0, dtype=np.int64), np.empty((0, 3))
    table = _table(path, "points", lines, range(_POINT_FIELDS))
    return _whole(path, "point id", table[:, 0]), table[:, 1:]


def _table(path: Path, field: str, lines: Sequence[str], columns: Sequence[int] | None = None) -> FloatArray:
    """(lines, columns) of numbers, as doubles: whole numbers up to 2^53 stay exact."""
    try:
        return np.loadtxt(lines, dtype=np.float64, comments=None, usecols=columns, ndmin=2)
    except ValueError as fault:
        raise InputFault.at(path, field, "numbers", Words(str(fault))) from None


def _whole(path: Path, field: str, values: FloatArray) -> IntArray:
    faulty = ~(np.abs(values) <= MAX_EXACT) | (values != np.floor(values))
    if faulty.any():
        raise InputFault.at(path, field, "whole numbers", float(values[faulty.argmax()]))
    return values.astype(np.int64)


def _integer(path: Path, field: str, word: str) -> int:
    return int(_whole(path, field, _numbers(path, field, [word]))[0])


def _numbers(path: Path, field: str, words: Sequence[str]) -> FloatArray:
    return _table(path, field, [" ".join(words)])[0] if words else np.empty(0)
