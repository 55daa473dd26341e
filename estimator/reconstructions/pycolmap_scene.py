"""A `pycolmap.Reconstruction` in memory as a scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.projection.cameras import make_camera
from estimator.records.scene import MAX_COORDINATE, Camera, Scene, View
from metric_base.errors import InputError, at_field, in_file

if TYPE_CHECKING:
    from pycolmap import Reconstruction

__all__ = ["scene_of_reconstruction"]

#: What an error names in place of a file.
SOURCE = Path("pycolmap.Reconstruction")

#: What pycolmap answers for an observation without a point.
NO_POINT = np.uint64(2**64 - 1)


def scene_of_reconstruction(reconstruction: Reconstruction) -> Scene:
    """The scene of a reconstruction; views in the order of their image ids.

    Raises
    ------
    InputError
        It has no registered image, or a camera or a coordinate that no scene can have.
    """
    ids = sorted(reconstruction.reg_image_ids())
    if not ids:
        raise InputError.at(SOURCE, "images", "at least one registered image", 0)
    point_ids = np.array(sorted(reconstruction.points3D), dtype=np.uint64)
    points = np.array([reconstruction.points3D[int(number)].xyz for number in point_ids], dtype=float).reshape(-1, 3)
    if not (np.abs(points) < MAX_COORDINATE).all():
        raise InputError.at(SOURCE, "points", f"finite coordinates below {MAX_COORDINATE:g}", "others")
    cameras = {number: _camera(number, camera) for number, camera in reconstruction.cameras.items()}
    views = tuple(_view(reconstruction.images[number], cameras, point_ids) for number in ids)
    return Scene(path=SOURCE, format="memory", views=views, points=points)


def _camera(number: int, camera: Any) -> Camera:
    size = (int(camera.width), int(camera.height))
    with in_file(SOURCE), at_field(f"camera {number}"):
        return make_camera(camera.model.name, size, np.array(camera.params, dtype=float))


def _view(image: Any, cameras: dict[int, Camera], point_ids: np.ndarray[Any, np.dtype[np.uint64]]) -> View:
    """The view of an image of pycolmap; `point_ids` (n,) are sorted."""
    pose = np.asarray(image.cam_from_world().matrix(), dtype=float)  # (3, 4)
    seen = [(point.xy, point.point3D_id) for point in image.points2D if point.point3D_id != NO_POINT]
    keypoints = np.array([xy for xy, _ in seen], dtype=float).reshape(-1, 2)
    rows = np.searchsorted(point_ids, np.array([number for _, number in seen], dtype=np.uint64))
    return View(image.name, cameras[image.camera_id], pose[:, :3], pose[:, 3], keypoints, rows)
