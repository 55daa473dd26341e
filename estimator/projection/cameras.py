"""Camera models of COLMAP: validation, projection with lens distortion, and rays of pixels."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from estimator.records.scene import Camera, View
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, Unquoted, expect

#: Camera models of COLMAP by name: number in binary files, parameters in file order (colmap/sensor/models.h).
CAMERA_MODELS: dict[str, tuple[int, tuple[str, ...]]] = {
    "SIMPLE_PINHOLE": (0, ("f", "cx", "cy")),
    "PINHOLE": (1, ("fx", "fy", "cx", "cy")),
    "SIMPLE_RADIAL": (2, ("f", "cx", "cy", "k")),
    "RADIAL": (3, ("f", "cx", "cy", "k1", "k2")),
    "OPENCV": (4, ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")),
    "OPENCV_FISHEYE": (5, ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")),
    "FULL_OPENCV": (6, ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    "FOV": (7, ("fx", "fy", "cx", "cy", "omega")),
    "SIMPLE_RADIAL_FISHEYE": (8, ("f", "cx", "cy", "k")),
    "RADIAL_FISHEYE": (9, ("f", "cx", "cy", "k1", "k2")),
    "THIN_PRISM_FISHEYE": (10, ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1")),
    "RAD_TAN_THIN_PRISM_FISHEYE": (
        11,
        ("fx", "fy", "cx", "cy", "k0", "k1", "k2", "k3", "k4", "k5", "p0", "p1", "s0", "s1", "s2", "s3"),
    ),
    "SIMPLE_DIVISION": (12, ("f", "cx", "cy", "k")),
    "DIVISION": (13, ("fx", "fy", "cx", "cy", "k")),
    "SIMPLE_FISHEYE": (14, ("f", "cx", "cy")),
    "FISHEYE": (15, ("fx", "fy", "cx", "cy")),
    "EUCM": (16, ("fx", "fy", "cx", "cy", "alpha", "beta")),
}

#: Models without distortion.
PINHOLES = frozenset({"PINHOLE", "SIMPLE_PINHOLE"})

#: Maximum side of an image in pixels: JPEG allows 65,535, and stitched survey images are about as large.
MAX_SIDE_PX = 100_000
#: Maximum number of pixels of an image; a mask needs one byte for each.
MAX_PIXELS = 2**28
#: Maximum angle from the optical axis at which a lens is sampled, just below 90 degrees; in radians.
_MAX_ANGLE = np.deg2rad(89.9)
#: Number of angles at which a lens is sampled.
_N_ANGLES = 1024
#: Number of directions around the optical axis in which a lens is sampled.
_N_AZIMUTHS = 16


def make_camera(model: str, size: tuple[int, int], params: Any) -> Camera:
    """Create a camera from values of a file.

    Parameters
    ----------
    model : str
        One of `CAMERA_MODELS`.
    size : (width, height)
        Image size in pixels.
    params : array_like of float
        Parameters in the order of `CAMERA_MODELS`.

    Raises
    ------
    FieldError
        The model is unknown, a side exceeds `MAX_SIDE_PX`, there are too many pixels, the number of parameters is
        wrong, a parameter is not finite, or a focal length is not positive.
    """
    expect(model in CAMERA_MODELS, "model", "one of COLMAP's, such as PINHOLE or OPENCV, and no panorama", model)
    width, height = size
    if not (1 <= width <= MAX_SIDE_PX and 1 <= height <= MAX_SIDE_PX and width * height <= MAX_PIXELS):
        raise FieldError("size", f"sides of 1 to {MAX_SIDE_PX} pixels", Unquoted(f"{width} x {height}"))
    names = CAMERA_MODELS[model][1]
    values = np.asarray(params, dtype=np.float64)
    expect(values.shape == (len(names),), "parameters", f"{len(names)} numbers of {model}", Unquoted(f"{values.size}"))
    expect(np.isfinite(values).all(), "parameters", "finite numbers", values.tolist())
    focal = values[: 1 if names[0] == "f" else 2]
    expect(not (focal <= 0).any(), "focal length", "more than 0", focal.tolist())
    return Camera(model, width, height, values)


def project(camera: Camera, points_camera: FloatArray) -> FloatArray:
    """Project points to pixels, with the distortion model of COLMAP.

    Parameters
    ----------
    camera : Camera
    points_camera : (n, 3) ndarray of float
        Points in the frame of the camera.

    Returns
    -------
    (n, 2) ndarray of float
        NaN behind the camera, and beyond the angle at which the distortion polynomial has its maximum: farther out,
        points outside the field of view would project into the image.
    """
    if camera.model in PINHOLES:
        # x = f X / Z + c; one row per coordinate in memory
        *focal, centre_x, centre_y = camera.params
        x, y, z = np.asarray(points_camera, dtype=np.float64).T
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            rows = np.array([x / z * focal[0] + centre_x, y / z * focal[-1] + centre_y])
            invalid = np.flatnonzero(~((z > 0) & np.isfinite(rows[0]) & np.isfinite(rows[1])))
        rows[:, invalid] = np.nan
        return rows.T
    points = np.ascontiguousarray(points_camera, dtype=np.float64)
    if not len(points):
        return np.empty((0, 2))
    pixels = np.array(_colmap_camera(camera).img_from_cam(points), dtype=np.float64)
    limit = _max_tangent(camera.model, camera.width, camera.height, camera.params.tobytes())
    is_invalid = ~(points[:, 2] > 0) | ~np.isfinite(pixels).all(axis=1)
    if np.isfinite(limit):  # the tangent of the angle from the axis is hypot(x, y) / z
        is_invalid |= np.hypot(points[:, 0], points[:, 1]) > limit * points[:, 2]
    pixels[is_invalid] = np.nan
    return pixels


def pixels_in_view(view: View, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return pixels (n, 2) and depths (n,) of world points (n, 3); pixels outside the image are NaN."""
    points_camera = view.to_camera(points)
    pixels = project(view.camera, points_camera)
    with np.errstate(invalid="ignore"):
        inside = (pixels >= 0).all(axis=1) & (pixels < (view.camera.width, view.camera.height)).all(axis=1)
    pixels[~inside] = np.nan
    return pixels, points_camera[:, 2]


def view_rays(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Return the rays (n, 3) through pixels (n, 2) in the frame of the camera, undistorted and of unit depth."""
    if camera.model in PINHOLES:
        directions = (pixels - camera.params[-2:]) / camera.params[:-2]
    else:
        directions = np.asarray(_colmap_camera(camera).cam_from_img(np.ascontiguousarray(pixels)), dtype=float)[:, :2]
    return np.column_stack([directions, np.ones(len(pixels))])


def _colmap_camera(camera: Camera) -> Any:
    """Return the camera of pycolmap, which is imported only for lenses with distortion."""
    from estimator.reconstructions.pycolmap_library import pycolmap

    return pycolmap.Camera(model=camera.model, width=camera.width, height=camera.height, params=camera.params)


@lru_cache(maxsize=256)
def _max_tangent(model: str, width: int, height: int, params: bytes) -> float:
    """Return the tangent of the angle up to which the image radius increases in every direction; may be infinite."""
    camera = Camera(model, width, height, np.frombuffer(params, dtype=np.float64))
    angles = np.linspace(0.0, _MAX_ANGLE, _N_ANGLES)
    azimuths = np.linspace(0.0, 2 * np.pi, _N_AZIMUTHS, endpoint=False)
    # (azimuths, angles, 3) unit rays
    rays = np.stack(
        [
            np.outer(np.cos(azimuths), np.sin(angles)),
            np.outer(np.sin(azimuths), np.sin(angles)),
            np.broadcast_to(np.cos(angles), (_N_AZIMUTHS, _N_ANGLES)),
        ],
        axis=-1,
    )
    projected = _colmap_camera(camera).img_from_cam(np.ascontiguousarray(rays.reshape(-1, 3)))
    pixels = np.array(projected, dtype=np.float64).reshape(_N_AZIMUTHS, _N_ANGLES, 2)
    with np.errstate(invalid="ignore", over="ignore"):
        radius = np.linalg.norm(pixels - pixels[:1, :1], axis=-1)
        decreases = ~(np.diff(radius, axis=1) > 0)  # also where the radius is NaN
    first = np.where(decreases.any(axis=1), decreases.argmax(axis=1), _N_ANGLES - 1).min()
    return float(np.tan(angles[first])) if first < _N_ANGLES - 1 else np.inf
