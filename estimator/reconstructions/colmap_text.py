"""COLMAP's text files (colmap/scene/reconstruction_io_text.cc)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from estimator.projection.cameras import make_camera
from estimator.reconstructions.colmap_model import ColmapImage, ColmapModel
from estimator.records.scene import Camera
from metric_base.arrays import FloatArray, IntArray
from metric_base.errors import FieldError, Unquoted, at_field, in_file
from metric_base.input_files import read_text

__all__ = ["read_text_model"]

_IMAGE_FIELDS = 10  # id, quaternion, translation, camera id, name (which may hold spaces)
_POINT_FIELDS = 4  # id, x, y, z; colour, error and track follow
#: Largest whole number up to which doubles hold every one of them.
MAX_EXACT = 2**53


def read_text_model(folder: Path) -> ColmapModel:
    """cameras.txt, images.txt and points3D.txt; rigs.txt and frames.txt repeat what the images say."""
    with in_file(folder / "cameras.txt") as file:
        cameras = _cameras(_lines(file))
    with in_file(folder / "images.txt") as file:
        images = _images(_lines(file))
    with in_file(folder / "points3D.txt") as file:
        ids, points = _points(_lines(file))
    return ColmapModel(cameras, images, ids, points)


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Number and text of the lines, the comments left out; blank lines are kept, for they can mean no keypoints."""
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        if not line.lstrip().startswith("#"):
            yield number, line.strip()


def _cameras(lines: Iterator[tuple[int, str]]) -> dict[int, Camera]:
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


def _images(lines: Iterator[tuple[int, str]]) -> tuple[ColmapImage, ...]:
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


def _points(lines: Iterator[tuple[int, str]]) -> tuple[IntArray, FloatArray]:
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
