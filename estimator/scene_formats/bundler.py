"""Read `bundle.out` of Bundler (version 0.3), with the names of its images in `list.txt` or `<bundle>.list.txt`.

The viewing direction of a camera is -z, with y up, x_camera = R x + t. Pixels are relative to the centre of the image,
with y up. The sizes of the images are read from the images themselves.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimator.projection.cameras import make_camera
from estimator.records.scene import Scene, View, observed_views
from estimator.scene_formats.common import FLIP, checked_image_size, posed_view
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, InputError, Unquoted, at_field, damage_as_field_error, expect, in_file
from metric_base.input_files import read_text

_HEADER = "# Bundle file v0.3"
#: Numbers of a camera: f k1 k2, R, t.
_N_CAMERA_NUMBERS = 15


def read_bundler(file: Path) -> Scene:
    """Read a bundle file; cameras with a focal length of zero are not registered and omitted.

    Raises
    ------
    InputError
        The file is damaged, or its list of images or an image is missing.
    """
    head, _, body = read_text(file).partition("\n")
    if head.strip() != _HEADER:
        raise InputError.at(file, "header", _HEADER, head)
    with in_file(file), damage_as_field_error("numbers", ValueError, str):
        numbers = np.array(body.split(), dtype=np.float64)
    # Names of the images in the order of the cameras; a focal length may follow a name.
    candidates = (f"{file.stem}.list.txt", f"{file.name}.list.txt", "list.txt", "../list.txt")
    list_file = next((path for name in candidates if (path := file.parent / name).is_file()), None)
    if list_file is None:
        expected = f"their names in {file.stem}.list.txt or list.txt in its folder"
        raise InputError.at(file, "images", expected, Unquoted("no list"))
    lines = [line.strip() for line in read_text(list_file).splitlines()]
    names = [line.split(" 0 ")[0].strip() for line in lines if line]
    with in_file(file):
        reader = _Numbers(numbers)
        n_views, n_points = (reader.count("counts") for _ in range(2))
        expect(n_views == len(names), "number of cameras", f"{len(names)}, as many as the list names", n_views)
        cameras = reader.take(n_views * _N_CAMERA_NUMBERS, "cameras").reshape(n_views, _N_CAMERA_NUMBERS)
        views: list[View] = []
        row_of = np.full(n_views, -1, dtype=np.int64)
        for row in np.flatnonzero(cameras[:, 0] > 0).tolist():
            with at_field(f"camera {row}"):
                row_of[row] = len(views)
                # 15 numbers: focal length, two distortion coefficients, rotation, translation.
                numbers = cameras[row]
                width, height = checked_image_size(file, names[row])
                camera = make_camera("RADIAL", (width, height), [numbers[0], width / 2, height / 2, *numbers[1:3]])
                rotation, translation = FLIP @ numbers[3:12].reshape(3, 3), FLIP @ numbers[12:]
                views.append(posed_view(names[row], camera, rotation, -rotation.T @ translation))
        expect(views, "cameras", "at least one with a focal length", 0)
        points, lists = np.empty((n_points, 3)), [np.empty((0, 4))]
        for row in range(n_points):
            points[row] = reader.take(6, f"point {row}")[:3]
            seen = reader.take(4 * reader.count(f"point {row} views"), f"point {row} views").reshape(-1, 4).copy()
            seen[:, 1] = row
            lists.append(seen)
        observations = np.concatenate(lists)  # (m, 4) camera, point, x, y
    rows = row_of[np.clip(observations[:, 0].astype(np.int64), 0, n_views - 1)]
    is_registered = rows >= 0
    rows, observations = rows[is_registered], observations[is_registered]
    sizes = np.array([(view.camera.width, view.camera.height) for view in views], dtype=np.float64)
    pixels = observations[:, 2:] * (1, -1) + sizes[rows] / 2
    return Scene(
        file.parent,
        "bundler",
        observed_views(views, rows, observations[:, 1].astype(np.int64), pixels),
        points,
        model_path=file.parent,
    )


class _Numbers:
    """Reader of a sequence of numbers (n,)."""

    def __init__(self, values: FloatArray) -> None:
        self.values, self.position = values, 0

    def take(self, count: int, field: str) -> FloatArray:
        """Return the next n = `count` numbers (n,); FieldError if they are missing or not finite."""
        part = self.values[self.position : self.position + count]
        if len(part) < count or not np.isfinite(part).all():
            raise FieldError(field, f"{count} finite numbers", Unquoted(f"{len(part)} in the rest of the file"))
        self.position += count
        return part

    def count(self, field: str) -> int:
        """Return the next number, a count that is not larger than the file."""
        value = float(self.take(1, field)[0])
        if not (value.is_integer() and 0 <= value <= len(self.values)):
            raise FieldError(field, "a count within the size of the file", value)
        return int(value)
