"""Read "Internal/External camera parameters" of RealityCapture, a CSV file, with points in a PLY file.

The columns `#name, x, y, alt, heading, pitch, roll, f, px, py, k1 ... k4, t1, t2` contain the position; heading, pitch
and roll in degrees about the axes up, right and forward; and focal length and principal point in millimetres for an
image that is 36 mm wide.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.records.scene import Scene, View
from estimator.scene_formats.common import FLIP, brown_camera, checked_image_size, posed_view, read_point_file
from metric_base.errors import at_field, expect, in_file
from metric_base.input_files import read_text
from metric_base.parsing import csv_rows, json_name, number_of

PLY_FILES = ("points.ply", "sparse_pc.ply", "sparse.ply", "point_cloud.ply")
COLUMNS = ("#name", "x", "y", "alt", "heading", "pitch", "roll", "f")
#: Width of the image to which focal lengths refer, in millimetres.
IMAGE_WIDTH_MM = 36.0


def is_realitycapture(head: str) -> bool:
    """Return True if the first lines of a CSV file contain the columns of RealityCapture."""
    return {word.strip() for word in _without_count(head).partition("\n")[0].split(",")} >= set(COLUMNS)


def _without_count(text: str) -> str:
    """Return the text without the line `#cameras 12` that may precede the columns."""
    first, _, rest = text.partition("\n")
    return rest if first.startswith("#cameras") else text


def read_realitycapture(file: Path) -> Scene:
    """Read a CSV file; the sizes of the images are read from the images themselves.

    Raises
    ------
    InputError
        The file is damaged, or an image is missing.
    """
    with in_file(file):
        names, records = csv_rows(file, _without_count(read_text(file)))
        expect(set(names) >= set(COLUMNS), "columns", ", ".join(COLUMNS), names)
        views: list[View] = []
        for line, record in records:
            with at_field(f"line {line}"):
                row = {name: value for name, value in record.items() if isinstance(name, str)}
                name = json_name(row["#name"], "#name").strip()
                size = checked_image_size(file, name)
                px_per_mm = max(size) / IMAGE_WIDTH_MM
                focal = number_of(row, "f") * px_per_mm
                centre = (
                    size[0] / 2 + number_of(row, "px", 0.0) * px_per_mm,
                    size[1] / 2 + number_of(row, "py", 0.0) * px_per_mm,
                )
                distortion = {name: number_of(row, name, 0.0) for name in ("k1", "k2", "k3", "k4")}
                tangential = {"p1": number_of(row, "t1", 0.0), "p2": number_of(row, "t2", 0.0)}
                camera = brown_camera(size, (focal, focal), centre, distortion | tangential)
                angles = [-number_of(row, "heading"), number_of(row, "pitch"), number_of(row, "roll")]
                # From camera (axes right, up, back) to world: R = Rz(-heading) Rx(pitch) Ry(roll).
                rotation = Rotation.from_euler("ZXY", angles, degrees=True).as_matrix() @ FLIP
                views.append(
                    posed_view(name, camera, rotation.T, np.array([number_of(row, axis) for axis in ("x", "y", "alt")]))
                )
        expect(views, "lines", "at least one camera", 0)
    points = read_point_file(file, (f"{file.stem}.ply", *PLY_FILES))
    return Scene(file.parent, "realitycapture", tuple(views), points, model_path=file.parent)
