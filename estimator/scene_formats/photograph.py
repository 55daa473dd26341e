"""Read one photograph with the depth map or the points of a network as a scene with one view.

The camera is at the origin and has the size of the photograph. The unit is that of the map, which may be arbitrary;
maps up to an unknown shift (the inverse depths of Depth Anything 1 and 2) are no depths.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimator.reconstructions.ply import read_points
from estimator.records.network_outputs import POINT_KEYS
from estimator.records.scene import DenseCloud, Scene
from estimator.scene_formats.common import glb_parts, pinhole_camera, posed_view
from estimator.scene_formats.depth_files import archive_arrays, read_depths, read_exr, read_npy
from estimator.scene_formats.networks import MAX_ASPECT_DIFFERENCE, depth_cloud, focal_of_points
from metric_base.arrays import FloatArray
from metric_base.errors import InputError, Unquoted, in_file
from metric_base.images import image_header
from metric_base.input_files import is_file, read_json
from metric_base.parsing import json_object

#: EXIF tag of the orientation, and its values for images that are shown rotated by a quarter turn.
ORIENTATION, QUARTER_TURNS = 274, {5, 6, 7, 8}
#: File in which MoGe states the field of view in degrees, in the folder of its maps.
FIELD_OF_VIEW = "fov.json"


def read_photograph(
    image: Path,
    depth_map: Path | None = None,
    points: Path | None = None,
    focal_px: float | None = None,
    png_unit: float = 0.001,
) -> Scene:
    """Read a photograph as a scene.

    Parameters
    ----------
    image : Path
    depth_map, points : Path, optional
        Depths along the optical axis, or points (h, w, 3) in the frame of the camera (also PLY or GLB). One of
        them.
    focal_px : float, optional
        Focal length in pixels of the photograph; by default that of the file of the network, of the points, or of EXIF.
    png_unit : float, default 0.001
        Size of a step of a PNG.

    Raises
    ------
    InputError
        A file is damaged, the shapes differ, or the focal length is unknown.
    """
    header = image_header(image)
    if header is None:
        raise InputError.at(image, "photograph", "an image", Unquoted("something else"))
    size = (header.width, header.height)
    size = size[::-1] if header.tags.get(ORIENTATION) in QUARTER_TURNS else size
    file = points or depth_map
    assert file is not None
    cloud, depth, file_focal = None, np.empty((0, 0)), None
    if points is not None and points.suffix.lower() == ".ply":
        cloud = _in_camera_axes(read_points(points))
    elif points is not None and points.suffix.lower() == ".glb":
        with in_file(points):
            cloud = _in_camera_axes(np.concatenate([vertices for vertices, _ in glb_parts(points)]))
    elif points is not None:
        values = _in_camera_axes(_point_map(points))
        depth, file_focal = values[..., 2], focal_of_points(values) * size[0] / values.shape[1]
    else:
        maps = read_depths(file, png_unit)
        if len(maps.values) != 1:
            raise InputError.at(file, "shape", "(h, w), one map", maps.values.shape)
        depth = maps.values[0]
        file_focal = None if maps.focal is None else float(maps.focal[0]) * size[0] / depth.shape[1]
    if file_focal is None and is_file(file.with_name(FIELD_OF_VIEW)):
        with in_file(file.with_name(FIELD_OF_VIEW)):
            angle = json_object(read_json(file.with_name(FIELD_OF_VIEW)), "").get("fov_x")
            file_focal = (
                size[0] / 2 / math.tan(math.radians(float(angle)) / 2) if isinstance(angle, int | float) else None
            )
    focal = focal_px or file_focal or header.focal_px
    if focal is None:
        expected = "a focal length: --focal PX, EXIF, or intrinsics in the file of the network"
        raise InputError.at(image, "focal length", expected, Unquoted("none"))
    with in_file(image):
        camera = pinhole_camera(size, (focal, focal), (size[0] / 2, size[1] / 2), {})
        view = posed_view(image.name, camera, np.eye(3), np.zeros(3))
    if cloud is not None:
        counts = np.arange(len(cloud) + 1)
        dense = DenseCloud(cloud, counts, np.zeros(len(cloud), dtype=np.int64))
    else:
        shape = (depth.shape[1], depth.shape[0])
        if abs(math.log(size[0] * shape[1] / size[1] / shape[0])) > MAX_ASPECT_DIFFERENCE:
            raise InputError.at(file, "shape", f"the aspect ratio of {image.name}, {size[0]} x {size[1]}", shape)
        ratio = shape[0] / size[0]
        small = pinhole_camera(shape, (focal * ratio, focal * shape[1] / size[1]), (shape[0] / 2, shape[1] / 2), {})
        dense = depth_cloud([replace(view, camera=small)], depth[None])
    return Scene(image, "photograph", (view,), np.empty((0, 3)), dense)


def _point_map(file: Path) -> FloatArray:
    """Read a map of points (h, w, 3)."""
    kind = file.suffix.lower()
    if kind == ".npz":
        arrays = archive_arrays(file, POINT_KEYS)
        values = next(iter(arrays.values()), np.empty(0))
    else:
        values = read_exr(file, is_points=True) if kind == ".exr" else read_npy(file)
    values = values[0] if values.ndim == 4 and len(values) == 1 else values
    if values.ndim != 3 or values.shape[2] != 3 or not values.size:
        raise InputError.at(file, "shape", f"points (h, w, 3); archives: {', '.join(POINT_KEYS)}", values.shape)
    return values


def _in_camera_axes(points: FloatArray) -> FloatArray:
    """Return points (..., 3) with the axes right, down, forward; the PLY and GLB of MoGe have right, up, back."""
    z = points[..., 2]
    return points * (1.0, -1.0, -1.0) if np.median(z[np.isfinite(z)] if np.isfinite(z).any() else [1.0]) < 0 else points
