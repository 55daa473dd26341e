"""Read `cameras.json`, which the training program of 3D Gaussian Splatting writes next to its splats.

`position` and `rotation` are the pose of the camera in the world (from camera to world), with the axes right, down,
forward. `img_name` has no suffix. The sparse points are in `input.ply`. The principal point is not stated: the program
renders with it in the middle of the image.
"""

from __future__ import annotations

from pathlib import Path

from estimator.records.scene import Scene, View
from estimator.scene_formats.common import (
    IMAGE_FOLDERS,
    matrix_of,
    number_of,
    pinhole_camera,
    posed_view,
    read_point_file,
)
from metric_base.errors import FieldError, at_field, expect, in_file
from metric_base.input_files import folder_entries, read_json
from metric_base.parsing import json_array, json_object


def read_gaussian_splatting(file: Path) -> Scene:
    """Read a `cameras.json`, which has no observations.

    Raises
    ------
    InputError
        The file is damaged, or a pose is not a rotation.
    """
    folders = [file.parent / name for name in IMAGE_FOLDERS[:2]]
    images = {entry.stem: entry.name for folder in folders if folder.is_dir() for entry in folder_entries(folder)}
    views: list[View] = []
    with in_file(file):
        for row, entry in enumerate(json_array(read_json(file))):
            with at_field(f"camera {row}"):
                camera = json_object(entry, "")
                name = camera.get("img_name")
                if not isinstance(name, str) or not name:
                    raise FieldError("img_name", "a name", name)
                width, height = (round(number_of(camera, side)) for side in ("width", "height"))
                focal = (number_of(camera, "fx"), number_of(camera, "fy"))
                lens = pinhole_camera((width, height), focal, (width / 2, height / 2), {})
                rotation = matrix_of(camera.get("rotation"), (3, 3), "rotation")
                centre = matrix_of(camera.get("position"), (3,), "position")
                views.append(posed_view(images.get(name, name), lens, rotation.T, centre))
        expect(views, "cameras", "at least one", 0)
    points = read_point_file(file, ["input.ply", "points.ply"])
    return Scene(file.parent, "gaussian-splatting", tuple(views), points, model_path=file.parent)
