"""Read `transforms.json` of nerfstudio and instant-ngp: poses and cameras, with points in a PLY file.

`transform_matrix` is the transform from camera to world, with the axes right, up, back. `applied_transform` is the
transform of the world by the converter of nerfstudio. It is reversed, so that the scene has the frame of the original
reconstruction.
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
    MAX_ROTATION_ERROR,
    checked_image_size,
    pinhole_camera,
    posed_view,
    read_point_file,
)
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, at_field, expect, in_file
from metric_base.input_files import read_json
from metric_base.parsing import json_name, json_object, json_records, matrix_of, number_of

#: Files of the sparse points, without `ply_file_path`.
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
    """Read a `transforms.json`, which has no observations.

    Raises
    ------
    InputError
        The file is damaged, a pose is not a rotation, or an image without a stated size is missing.
    """
    with in_file(file):
        document = json_object(read_json(file))
        applied = document.get("applied_transform")
        world = np.eye(4)[:3] if applied is None else _upper_rows(applied, "applied_transform")
        if np.abs(world[:, :3] @ world[:, :3].T - np.eye(3)).max() > 1e-6:
            raise FieldError("applied_transform", "a rotation and a shift", world[:, :3].tolist())
        views: list[View] = []
        for field, frame in json_records(document.get("frames"), "frames"):
            with at_field(field):
                name = json_name(frame.get("file_path"), "file_path")
                pose = _upper_rows(frame.get("transform_matrix"), "transform_matrix")
                rotation = world[:, :3].T @ pose[:, :3] @ FLIP  # camera to world
                centre = world[:, :3].T @ (pose[:, 3] - world[:, 3])
                views.append(
                    posed_view(name.removeprefix("./"), _camera(file, {**document, **frame}, name), rotation.T, centre)
                )
        expect(views, "frames", "at least one", 0)
    ply_file = document.get("ply_file_path")
    points = read_point_file(file, ([ply_file] if isinstance(ply_file, str) else []) + list(PLY_FILES))
    points = (points - world[:, 3]) @ world[:, :3]  # R^-1 (x - t) with the rotation R
    return Scene(file.parent, "nerfstudio", tuple(views), points, model_path=file.parent)


def _upper_rows(values: object, field: str) -> FloatArray:
    """Return the first three rows (3, 4) of a transform."""
    return matrix_of(np.array(values, dtype=object).ravel()[:12].tolist(), (3, 4), field)


def read_normalisation(file: Path) -> tuple[float, FloatArray]:
    """Read the transform of a `dataparser_transforms.json`, from the original frame to that of the trained model.

    Returns
    -------
    scale : float
    transform : (3, 4) ndarray of float
        Rotation R and shift t; x' = scale (R x + t).

    Raises
    ------
    InputError
        The file is damaged, or the matrix is not a rotation.
    """
    with in_file(file):
        document = json_object(read_json(file))
        scale = number_of(document, "scale")
        transform = matrix_of(document.get("transform"), (3, 4), "transform")
        if not scale > 0 or np.abs(transform[:, :3] @ transform[:, :3].T - np.eye(3)).max() > MAX_ROTATION_ERROR:
            raise FieldError("transform", "a rotation and a shift, with a positive scale", transform[:, :3].tolist())
    return scale, transform


def _camera(file: Path, entry: dict[str, Any], name: str) -> Camera:
    """Return the camera of a frame; `entry` contains the values of the document and of the frame."""
    has_size = "w" in entry and "h" in entry
    size = (round(number_of(entry, "w")), round(number_of(entry, "h"))) if has_size else checked_image_size(file, name)
    if "fl_x" in entry or "fl_y" in entry:
        focal_x = number_of(entry, "fl_x", entry.get("fl_y"))
        focal = (focal_x, number_of(entry, "fl_y", focal_x))
    elif "camera_angle_x" in entry:
        focal_x = focal_y = size[0] / 2 / tan(number_of(entry, "camera_angle_x") / 2)
        if "camera_angle_y" in entry:
            focal_y = size[1] / 2 / tan(number_of(entry, "camera_angle_y") / 2)
        focal = (focal_x, focal_y)
    else:
        raise FieldError("fl_x", "a focal length, or camera_angle_x", None)
    centre = (number_of(entry, "cx", size[0] / 2), number_of(entry, "cy", size[1] / 2))
    distortion = {name: number_of(entry, name, 0.0) for name in _DISTORTION}
    model = entry.get("camera_model", "OPENCV")
    if model == "OPENCV_FISHEYE" or entry.get("is_fisheye"):
        return make_camera(
            "OPENCV_FISHEYE", size, [*focal, *centre, *(distortion[name] for name in ("k1", "k2", "k3", "k4"))]
        )
    expected = "OPENCV, OPENCV_FISHEYE or PINHOLE (cut a panorama into perspective views)"
    expect(model in PINHOLES, "camera_model", expected, model)
    return pinhole_camera(size, focal, centre, distortion)
