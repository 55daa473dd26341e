"""RealityCapture's "Internal/External camera parameters", a CSV file, with points in a PLY file beside it.

Columns `#name, x, y, alt, heading, pitch, roll, f, px, py, k1 ... k4, t1, t2`: the position; heading, pitch and roll in
degrees about up, right and forward; focal length and principal point in millimetres of a video 36 mm wide.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.records.scene import Scene, View
from estimator.scene_formats.common import FLIP, brown_camera, checked_image_size, number_of, points_beside, posed_view
from metric_base.errors import FieldError, at_field, in_file
from metric_base.input_files import read_text
from metric_base.parsing import csv_rows

PLY_FILES = ("points.ply", "sparse_pc.ply", "sparse.ply", "point_cloud.ply")
COLUMNS = ("#name", "x", "y", "alt", "heading", "pitch", "roll", "f")
FILM_MM = 36.0


def is_realitycapture(head: str) -> bool:
    """Whether the first lines of a CSV file have this form's columns."""
    return {word.strip() for word in _without_count(head).partition("\n")[0].split(",")} >= set(COLUMNS)


def _without_count(text: str) -> str:
    """The text without the line `#cameras 12` before the columns, which some exports have."""
    first, _, rest = text.partition("\n")
    return rest if first.startswith("#cameras") else text


def read_realitycapture(file: Path) -> Scene:
    """The scene of a CSV file; sizes are read from the pictures, which it does not state.

    Raises
    ------
    InputError
        The file is damaged, or a picture is missing.
    """
    with in_file(file):
        names, records = csv_rows(file, _without_count(read_text(file)))
        if not set(names) >= set(COLUMNS):
            raise FieldError("columns", ", ".join(COLUMNS), names)
        views: list[View] = []
        for line, row in records:
            with at_field(f"line {line}"):
                views.append(_view(file, {name: value for name, value in row.items() if isinstance(name, str)}))
        if not views:
            raise FieldError("lines", "at least one camera", 0)
    points = points_beside(file, (f"{file.stem}.ply", *PLY_FILES))
    return Scene(file.parent, "realitycapture", tuple(views), points, model_path=file.parent)


def _view(file: Path, row: dict[str, str]) -> View:
    name = row["#name"].strip() if row["#name"] else ""
    if not name:
        raise FieldError("#name", "a name", row["#name"])
    size = checked_image_size(file, name)
    pixels = max(size) / FILM_MM
    focal = number_of(row, "f") * pixels
    centre = (size[0] / 2 + number_of(row, "px", 0.0) * pixels, size[1] / 2 + number_of(row, "py", 0.0) * pixels)
    distortion = {name: number_of(row, name, 0.0) for name in ("k1", "k2", "k3", "k4")}
    tangential = {"p1": number_of(row, "t1", 0.0), "p2": number_of(row, "t2", 0.0)}
    camera = brown_camera(size, (focal, focal), centre, distortion | tangential)
    angles = [-number_of(row, "heading"), number_of(row, "pitch"), number_of(row, "roll")]
    # camera to world, axes right, up, back: R = Rz(-heading) Rx(pitch) Ry(roll)
    rotation = Rotation.from_euler("ZXY", angles, degrees=True).as_matrix() @ FLIP
    return posed_view(name, camera, rotation.T, np.array([number_of(row, axis) for axis in ("x", "y", "alt")]))
