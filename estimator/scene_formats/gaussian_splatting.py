"""Read `cameras.json`, which the training program of 3D Gaussian Splatting writes next to its splats.

`position` and `rotation` are the pose of the camera in the world (from camera to world), with the axes right, down,
forward. `img_name` has no suffix. The sparse points are in `input.ply`. The principal point is not stated: the program
renders with it in the middle of the image.
"""

from __future__ import annotations

from pathlib import Path

from estimator.records.scene import Scene, View
from estimator.scene_formats.common import IMAGE_FOLDERS, pinhole_camera, posed_view, read_point_file
from metric_base.errors import at_field, expect, in_file
from metric_base.input_files import folder_entries, read_json
from metric_base.parsing import json_name, json_records, matrix_of, number_of


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
        for field, camera in json_records(read_json(file), "cameras"):
            with at_field(field):
                name = json_name(camera.get("img_name"), "img_name")
                width, height = (round(number_of(camera, side)) for side in ("width", "height"))
                focal = (number_of(camera, "fx"), number_of(camera, "fy"))
                lens = pinhole_camera((width, height), focal, (width / 2, height / 2), {})
                rotation = matrix_of(camera.get("rotation"), (3, 3), "rotation")
                centre = matrix_of(camera.get("position"), (3,), "position")
                views.append(posed_view(images.get(name, name), lens, rotation.T, centre))
        expect(views, "cameras", "at least one", 0)
    points = read_point_file(file, ["input.ply", "points.ply"])
    return Scene(file.parent, "gaussian-splatting", tuple(views), points, model_path=file.parent)
