"""COLMAP's text files (colmap/scene/reconstruction_io_text.cc)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from estimator.cameras import camera_at
from estimator.colmap_model import ColmapImage, ColmapModel
from estimator.files import text_of
from estimator.scene import BadScene, Camera, FloatArray, IntArray, told

__all__ = ["text_model"]

_IMAGE_FIELDS = 10  # id, quaternion, translation, camera id, name (which may hold spaces)
_POINT_FIELDS = 4  # id, x, y, z; colour, error and track follow
_INTEGERS = np.iinfo(np.int64)


def text_model(folder: Path) -> ColmapModel:
    """cameras.txt, images.txt and points3D.txt; rigs.txt and frames.txt repeat what the images say."""
    cameras = _cameras(folder / "cameras.txt")
    images = _images(folder / "images.txt")
    ids, points = _points(folder / "points3D.txt")
    return ColmapModel(cameras, images, ids, points)


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Number and text of the lines, the comments left out; blank lines are kept, for they can mean no keypoints."""
    for number, line in enumerate(text_of(path).split("\n"), start=1):
        if not line.lstrip().startswith("#"):
            yield number, line.strip()


def _cameras(path: Path) -> dict[int, Camera]:
    cameras: dict[int, Camera] = {}
    for number, line in _lines(path):
        if not line:
            continue
        field, words = f"line {number}", line.split()
        if len(words) < 4:
            raise BadScene.at(path, field, "camera id, model, width, height and parameters", line)
        camera_id, width, height = (_integer(path, field, word) for word in (words[0], words[2], words[3]))
        if camera_id in cameras:
            raise BadScene.at(path, field, "each camera id once", told(f"{camera_id} twice"))
        params = _numbers(path, field, words[4:])
        cameras[camera_id] = camera_at(path, f"{field} camera {camera_id}", words[1], (width, height), params)
    return cameras


def _images(path: Path) -> tuple[ColmapImage, ...]:
    """Two lines an image; the second, its keypoints, may be blank."""
    images, lines = [], _lines(path)
    for number, line in lines:
        if not line:
            continue
        field, words = f"line {number}", line.split(maxsplit=_IMAGE_FIELDS - 1)
        if len(words) != _IMAGE_FIELDS:
            raise BadScene.at(path, field, "id, quaternion, translation, camera id and name", line)
        image_id, camera_id = _integer(path, field, words[0]), _integer(path, field, words[8])
        pose = _numbers(path, field, words[1:8])
        number, row = next(lines, (number + 1, ""))  # noqa: PLW2901 (the pair of lines is one record)
        keypoints, point_ids = _keypoints(path, f"line {number}", row.split())
        images.append(ColmapImage(image_id, pose[:4], pose[4:], camera_id, words[9], keypoints, point_ids))
    return tuple(images)


def _keypoints(path: Path, field: str, words: list[str]) -> tuple[FloatArray, IntArray]:
    if len(words) % 3:
        raise BadScene.at(path, field, "keypoints as x, y, point id", told(f"{len(words)} numbers"))
    xs, ys, ids = words[0::3], words[1::3], words[2::3]
    return np.column_stack([_numbers(path, field, xs), _numbers(path, field, ys)]), _integers(path, field, ids)


def _points(path: Path) -> tuple[IntArray, FloatArray]:
    rows = [(number, line.split(None, _POINT_FIELDS)) for number, line in _lines(path) if line]
    for number, words in rows:
        if len(words) < _POINT_FIELDS + 1:
            raise BadScene.at(path, f"line {number}", "id, x, y, z, colour, error and track", " ".join(words))
    field = f"lines {rows[0][0]} to {rows[-1][0]}" if rows else "lines"
    ids = _integers(path, field, [words[0] for _, words in rows])
    columns = [_numbers(path, field, [words[axis] for _, words in rows]) for axis in (1, 2, 3)]
    return ids, np.column_stack(columns)


def _integer(path: Path, field: str, word: str) -> int:
    return int(_integers(path, field, [word])[0])


def _integers(path: Path, field: str, words: Sequence[str]) -> IntArray:
    try:
        return np.array([int(word) for word in words], dtype=np.int64)
    except (ValueError, OverflowError):
        raise BadScene.at(path, field, "whole numbers", _first_not(int, words)) from None


def _numbers(path: Path, field: str, words: Sequence[str]) -> FloatArray:
    try:
        return np.array([float(word) for word in words], dtype=np.float64)
    except ValueError:
        raise BadScene.at(path, field, "numbers", _first_not(float, words)) from None


def _first_not(kind: type[int] | type[float], words: Sequence[str]) -> str:
    """The first word that is no number of the kind, for the message."""
    for word in words:
        try:
            value = kind(word)
        except ValueError:
            return word
        if kind is int and not _INTEGERS.min <= value <= _INTEGERS.max:
            return word
    return ""
