"""Bundler's `bundle.out` (version 0.3), with the names of its pictures in `list.txt` or `<bundle>.list.txt`.

A Bundler camera looks along -z with y up, x_camera = R x + t; pixels count from the middle of the picture, y up.
The file states no sizes: they are read from the pictures.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimator.projection.cameras import make_camera
from estimator.records.scene import Scene, View
from estimator.scene_formats.common import FLIP, checked_image_size, observed_views, posed_view
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, InputError, Unquoted, at_field, in_file
from metric_base.input_files import read_text

_HEADER = "# Bundle file v0.3"
_CAMERA_NUMBERS = 15  # f k1 k2, R, t


def read_bundler(file: Path) -> Scene:
    """The scene of a bundle file; cameras of focal length zero were not registered and are left out.

    Raises
    ------
    InputError
        The file is damaged, or its list of pictures or a picture is missing.
    """
    head, _, body = read_text(file).partition("\n")
    if head.strip() != _HEADER:
        raise InputError.at(file, "header", _HEADER, head)
    try:
        numbers = np.array(body.split(), dtype=np.float64)
    except ValueError as error:
        raise InputError.at(file, "content", "numbers", Unquoted(str(error))) from None
    names = _names(file)
    with in_file(file):
        reader = _Numbers(numbers)
        n_views, n_points = (reader.whole("counts") for _ in range(2))
        if n_views != len(names):
            raise FieldError("number of cameras", f"{len(names)}, as many as the list names", n_views)
        cameras = reader.take(n_views * _CAMERA_NUMBERS, "cameras").reshape(n_views, _CAMERA_NUMBERS)
        views: list[View] = []
        row_of = np.full(n_views, -1, dtype=np.int64)
        for row in np.flatnonzero(cameras[:, 0] > 0).tolist():
            with at_field(f"camera {row}"):
                row_of[row] = len(views)
                views.append(_view(file, names[row], cameras[row]))
        if not views:
            raise FieldError("cameras", "at least one with a focal length", 0)
        points, seen = _points(reader, n_points)
    rows = row_of[np.clip(seen[:, 0].astype(np.int64), 0, n_views - 1)]
    kept = rows >= 0
    rows, seen = rows[kept], seen[kept]
    sizes = np.array([(view.camera.width, view.camera.height) for view in views], dtype=np.float64)
    pixels = seen[:, 2:] * (1, -1) + sizes[rows] / 2
    return Scene(
        file.parent,
        "bundler",
        observed_views(views, rows, seen[:, 1].astype(np.int64), pixels),
        points,
        model_path=file.parent,
    )


class _Numbers:
    """A row of numbers and a place in it."""

    def __init__(self, values: FloatArray) -> None:
        """Begin at the first of the numbers (n,)."""
        self.values, self.place = values, 0

    def take(self, count: int, field: str) -> FloatArray:
        """The next n = `count` numbers, (n,); FieldError if they are missing or not finite."""
        part = self.values[self.place : self.place + count]
        if len(part) < count or not np.isfinite(part).all():
            raise FieldError(field, f"{count} finite numbers", Unquoted(f"{len(part)} in the rest of the file"))
        self.place += count
        return part

    def whole(self, field: str) -> int:
        """The next number, a count of objects that the rest of the file has room for."""
        value = float(self.take(1, field)[0])
        if not (value.is_integer() and 0 <= value <= len(self.values)):
            raise FieldError(field, "a count that the file has room for", value)
        return int(value)


def _view(file: Path, name: str, numbers: FloatArray) -> View:
    """The view of its 15 numbers (15,): focal length, two distortions, rotation, translation."""
    width, height = checked_image_size(file, name)
    camera = make_camera("RADIAL", (width, height), [numbers[0], width / 2, height / 2, *numbers[1:3]])
    rotation, translation = FLIP @ numbers[3:12].reshape(3, 3), FLIP @ numbers[12:]
    return posed_view(name, camera, rotation, -rotation.T @ translation)


def _points(reader: _Numbers, count: int) -> tuple[FloatArray, FloatArray]:
    """(n, 3) points, and (m, 4) camera, point, x, y of their observations."""
    points, lists = np.empty((count, 3)), [np.empty((0, 4))]
    for row in range(count):
        points[row] = reader.take(6, f"point {row}")[:3]
        views = reader.take(4 * reader.whole(f"point {row} views"), f"point {row} views").reshape(-1, 4).copy()
        views[:, 1] = row
        lists.append(views)
    return points, np.concatenate(lists)


def _names(file: Path) -> list[str]:
    """The pictures' names, in the order of the cameras; what follows a name on its line is a focal length."""
    for name in (f"{file.stem}.list.txt", f"{file.name}.list.txt", "list.txt", "../list.txt"):
        path = file.parent / name
        if path.is_file():
            lines = [line.strip() for line in read_text(path).splitlines()]
            return [line.split(" 0 ")[0].strip() for line in lines if line]
    raise InputError.at(
        file, "pictures", f"their names in {file.stem}.list.txt or list.txt beside it", Unquoted("no list")
    )
