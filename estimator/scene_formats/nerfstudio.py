"""nerfstudio's `transforms.json` (and instant-ngp's): poses and cameras, with points in a PLY file beside it.

`transform_matrix` is camera to world with axes right, up, back. What nerfstudio's own converter turned the world by is
stated as `applied_transform`, and undone here, so that the scene is that of the reconstruction it was made from.
"""

from __future__ import annotations

from math import tan
from pathlib import Path
from typing import Any

import numpy as np

from estimator.projection.cameras import make_camera
from estimator.records.scene import Camera, Scene, View
from estimator.scene_formats.common import (
    FLIP,
    checked_image_size,
    matrix_of,
    number_of,
    pinhole_camera,
    points_beside,
    posed_view,
)
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, at_field, in_file
from metric_base.input_files import read_json
from metric_base.parsing import json_array, json_object

#: Where the sparse points are, where `ply_file_path` does not say.
PLY_FILES = ("sparse_pc.ply", "points.ply", "sparse_point_cloud.ply", "points3D.ply", "point_cloud.ply")
PINHOLES = (
    "OPENCV",
    "PINHOLE",
    "SIMPLE_PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "FULL_OPENCV",
    "perspective",
    "PERSPECTIVE",
)
_DISTORTION = ("k1", "k2", "p1", "p2", "k3", "k4")


def read_nerfstudio(file: Path) -> Scene:
    """The scene of a `transforms.json`, which states no observations.

    Raises
    ------
    InputError
        The file is damaged, a pose is no rotation, or a size is not stated and its picture not there.
    """
    with in_file(file):
        document = json_object(read_json(file))
        world = _world(document)
        views: list[View] = []
        for row, entry in enumerate(json_array(document.get("frames"), "frames")):
            with at_field(f"frames[{row}]"):
                views.append(_view(file, document, json_object(entry, ""), world))
        if not views:
            raise FieldError("frames", "at least one", 0)
    stated = document.get("ply_file_path")
    points = points_beside(file, ([stated] if isinstance(stated, str) else []) + list(PLY_FILES))
    points = (points - world[:, 3]) @ world[:, :3]  # R^-1 (x - t), R a rotation
    return Scene(file.parent, "nerfstudio", tuple(views), points, model_path=file.parent)


def _world(document: dict[str, Any]) -> FloatArray:
    """(3, 4) what the world of the file is turned and moved by against that of the reconstruction."""
    applied = document.get("applied_transform")
    matrix = (
        np.eye(4)[:3]
        if applied is None
        else matrix_of(np.array(applied, dtype=object).ravel()[:12].tolist(), (3, 4), "applied_transform")
    )
    if np.abs(matrix[:, :3] @ matrix[:, :3].T - np.eye(3)).max() > 1e-6:
        raise FieldError("applied_transform", "a rotation and a shift", matrix[:, :3].tolist())
    return matrix


def _view(file: Path, document: dict[str, Any], frame: dict[str, Any], world: FloatArray) -> View:
    """The view of a frame; world : (3, 4) what the file's world is turned and moved by."""
    name = frame.get("file_path")
    if not isinstance(name, str) or not name:
        raise FieldError("file_path", "a name", name)
    pose = matrix_of(
        np.array(frame.get("transform_matrix"), dtype=object).ravel()[:12].tolist(), (3, 4), "transform_matrix"
    )
    rotation = world[:, :3].T @ pose[:, :3] @ FLIP  # camera to world
    centre = world[:, :3].T @ (pose[:, 3] - world[:, 3])
    return posed_view(name.removeprefix("./"), _camera(file, {**document, **frame}, name), rotation.T, centre)


def _camera(file: Path, entry: dict[str, Any], name: str) -> Camera:
    """The camera of a frame's own numbers, or of the document's."""
    stated = "w" in entry and "h" in entry
    size = (round(number_of(entry, "w")), round(number_of(entry, "h"))) if stated else checked_image_size(file, name)
    if "fl_x" in entry or "fl_y" in entry:
        focal_x = number_of(entry, "fl_x", entry.get("fl_y"))
        focal = (focal_x, number_of(entry, "fl_y", focal_x))
    elif "camera_angle_x" in entry:
        focal_x = size[0] / 2 / tan(number_of(entry, "camera_angle_x") / 2)
        focal = (
            focal_x,
            size[1] / 2 / tan(number_of(entry, "camera_angle_y") / 2) if "camera_angle_y" in entry else focal_x,
        )
    else:
        raise FieldError("fl_x", "a focal length, or camera_angle_x", None)
    centre = (number_of(entry, "cx", size[0] / 2), number_of(entry, "cy", size[1] / 2))
    distortion = {name: number_of(entry, name, 0.0) for name in _DISTORTION}
    model = entry.get("camera_model", "OPENCV")
    if model == "OPENCV_FISHEYE" or entry.get("is_fisheye"):
        return make_camera(
            "OPENCV_FISHEYE", size, [*focal, *centre, *(distortion[name] for name in ("k1", "k2", "k3", "k4"))]
        )
    if model not in PINHOLES:
        raise FieldError(
            "camera_model", "OPENCV, OPENCV_FISHEYE or PINHOLE (cut a panorama into perspective views)", model
        )
    return pinhole_camera(size, focal, centre, distortion)
