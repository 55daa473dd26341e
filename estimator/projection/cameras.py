"""Cameras: COLMAP's models by name, checked once, and the projection of points through their lenses."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from estimator.records.scene import Camera, View
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, Unquoted

#: COLMAP's camera models by name: number in binary files, parameters in file order (colmap/sensor/models.h).
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

#: Longest side of an image that is believed: JPEG stops at 65,535 and stitched surveys at about as much.
MAX_SIDE_PX = 100_000
#: Most pixels of an image that is believed; a mask of it takes as many bytes.
MAX_PIXELS = 2**28
#: Widest angle from the axis at which a lens is sampled, just short of the plane through the camera.
_WIDEST = np.deg2rad(89.9)
_STEPS = 1024
_DIRECTIONS = 16


def make_camera(model: str, size: tuple[int, int], params: Any) -> Camera:
    """A camera whose every number was checked.

    size : (width, height) in pixels. FieldError for an unknown model, a wrong number of parameters, sizes outside
    1 ... MAX_SIDE_PX, numbers that are not finite, or a focal length that is not positive.
    """
    if model not in CAMERA_MODELS:
        raise FieldError("model", "one of COLMAP's, such as PINHOLE or OPENCV, and no panorama", model)
    width, height = size
    if not (1 <= width <= MAX_SIDE_PX and 1 <= height <= MAX_SIDE_PX and width * height <= MAX_PIXELS):
        raise FieldError("size", f"sides of 1 to {MAX_SIDE_PX} pixels", Unquoted(f"{width} x {height}"))
    names = CAMERA_MODELS[model][1]
    values = np.asarray(params, dtype=np.float64)
    if values.shape != (len(names),):
        raise FieldError("parameters", f"{len(names)} numbers of {model}", Unquoted(f"{values.size}"))
    if not np.isfinite(values).all():
        raise FieldError("parameters", "finite numbers", values.tolist())
    focal = values[: 1 if names[0] == "f" else 2]
    if (focal <= 0).any():
        raise FieldError("focal length", "more than 0", focal.tolist())
    return Camera(model, width, height, values)


def project(camera: Camera, points_camera: FloatArray) -> FloatArray:
    """(n, 2) pixels of (n, 3) points in the camera's frame, by COLMAP's own models, distortion included.

    NaN behind the camera, and beyond the angle at which the lens polynomial turns back on itself: past it,
    points far outside the picture would be drawn inside it.
    """
    if camera.model in PINHOLES:
        return _pinhole_pixels(camera, points_camera)
    points = np.ascontiguousarray(points_camera, dtype=np.float64)
    if not len(points):
        return np.empty((0, 2))
    pixels = _raw_projected(camera, points)
    limit = _widest_tangent(camera.model, camera.width, camera.height, camera.params.tobytes())
    # (n,) tangent of the angle from the axis is hypot(x, y) / z
    hidden = ~(points[:, 2] > 0) | ~np.isfinite(pixels).all(axis=1)
    if np.isfinite(limit):
        hidden |= np.hypot(points[:, 0], points[:, 1]) > limit * points[:, 2]
    pixels[hidden] = np.nan
    return pixels


def pixels_in_view(view: View, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, 2) pixels and (n,) depths of (n, 3) world points; pixels are NaN outside the picture or behind it."""
    # (n, 3) = (n, 3) @ (3, 3): x_camera = R x_world + t
    points_camera = points @ view.rotation.T + view.translation
    pixels = project(view.camera, points_camera)
    with np.errstate(invalid="ignore"):
        inside = (pixels >= 0).all(axis=1) & (pixels < (view.camera.width, view.camera.height)).all(axis=1)
    pixels[~inside] = np.nan
    return pixels, points_camera[:, 2]


def view_rays(camera: Camera, pixels: FloatArray) -> FloatArray:
    """(n, 3) rays of unit depth in the camera's frame through pixels (n, 2), lens distortion removed."""
    if camera.model == "PINHOLE":
        flat = (pixels - camera.params[2:]) / camera.params[:2]
    elif camera.model == "SIMPLE_PINHOLE":
        flat = (pixels - camera.params[1:]) / camera.params[0]
    else:
        from estimator.reconstructions.pycolmap_library import pycolmap

        lens = pycolmap.Camera(model=camera.model, width=camera.width, height=camera.height, params=camera.params)
        flat = np.asarray(lens.cam_from_img(pixels), dtype=float)[:, :2]
    return np.column_stack([flat, np.ones(len(pixels))])


def _pinhole_pixels(camera: Camera, points: FloatArray) -> FloatArray:
    """(n, 2) pixels of (n, 3) points, NaN behind the camera; x = f X / Z + c, coordinate by coordinate in memory."""
    *focal, centre_x, centre_y = camera.params
    x, y, z = np.asarray(points, dtype=np.float64).T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        pixels = np.array([x / z * focal[0] + centre_x, y / z * focal[-1] + centre_y])
        hidden = np.flatnonzero(~((z > 0) & np.isfinite(pixels[0]) & np.isfinite(pixels[1])))
    pixels[:, hidden] = np.nan
    return pixels.T


def _raw_projected(camera: Camera, points: FloatArray) -> FloatArray:
    """(n, 2) pixels as COLMAP gives them; pycolmap is a heavy import, so pinholes do without."""
    from estimator.reconstructions.pycolmap_library import pycolmap

    lens = pycolmap.Camera(model=camera.model, width=camera.width, height=camera.height, params=camera.params)
    return np.array(lens.img_from_cam(points), dtype=np.float64)


@lru_cache(maxsize=256)
def _widest_tangent(model: str, width: int, height: int, params: bytes) -> float:
    """Tangent of the widest angle up to which pixels move outwards with the angle, in every direction."""
    camera = Camera(model, width, height, np.frombuffer(params, dtype=np.float64))
    angles = np.linspace(0.0, _WIDEST, _STEPS)
    azimuths = np.linspace(0.0, 2 * np.pi, _DIRECTIONS, endpoint=False)
    # (directions, steps, 3) unit rays
    rays = np.stack(
        [
            np.outer(np.cos(azimuths), np.sin(angles)),
            np.outer(np.sin(azimuths), np.sin(angles)),
            np.broadcast_to(np.cos(angles), (_DIRECTIONS, _STEPS)),
        ],
        axis=-1,
    )
    pixels = _raw_projected(camera, np.ascontiguousarray(rays.reshape(-1, 3))).reshape(_DIRECTIONS, _STEPS, 2)
    with np.errstate(invalid="ignore", over="ignore"):
        radius = np.linalg.norm(pixels - pixels[:1, :1], axis=-1)
        turns = ~(np.diff(radius, axis=1) > 0)  # NaN counts as a turn
    first = np.where(turns.any(axis=1), turns.argmax(axis=1), _STEPS - 1).min()
    return float(np.tan(angles[first])) if first < _STEPS - 1 else np.inf
