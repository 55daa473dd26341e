"""Rays of pixels by COLMAP's camera models, and windows of the undistorted image plane."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator.projection.cameras import CAMERA_MODELS, view_rays
from estimator.records.scene import Camera, View
from metric_base.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Window:
    """Rectangle of a pinhole image, in COLMAP's pixels: the centre of the first pixel is (0.5, 0.5)."""

    fx: float  #: focal lengths in pixels
    fy: float
    cx: float  #: principal point
    cy: float
    x0: int  #: first pixel of the rectangle
    y0: int
    width: int
    height: int

    def projection(self, rotation: FloatArray, translation: FloatArray, near: float, far: float) -> FloatArray:
        """Return the matrix (4, 4) from local to clip space.

        The y axis points down, so that the first row that is read back is the upper row of the window.
        """
        perspective = np.array([
            [2 * self.fx / self.width, 0, 2 * (self.cx - self.x0) / self.width - 1, 0],
            [0, 2 * self.fy / self.height, 2 * (self.cy - self.y0) / self.height - 1, 0],
            [0, 0, (far + near) / (far - near), -2 * far * near / (far - near)],
            [0, 0, 1, 0],
        ])  # fmt: skip
        view = np.eye(4)
        view[:3, :3], view[:3, 3] = rotation, translation
        return np.asarray(perspective @ view)


def focal_lengths(camera: Camera) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy of the undistorted image of a camera."""
    values = dict(zip(CAMERA_MODELS[camera.model][1], camera.params.tolist(), strict=True))
    focal = values.get("f", 0.0)
    return values.get("fx", focal), values.get("fy", focal), values["cx"], values["cy"]


def ray_through(view: View, x: float, y: float) -> FloatArray:
    """Return the direction (3,) in the scene of the ray through a pixel, of length 1 along the optical axis."""
    return np.asarray(view_rays(view.camera, np.array([[x, y]]))[0] @ view.rotation)


def pixel_grid(x0: int, y0: int, width: int, height: int) -> FloatArray:
    """Return the centres (n, 2) of the n = width * height pixels of a box, row by row."""
    x, y = np.meshgrid(x0 + np.arange(width) + 0.5, y0 + np.arange(height) + 0.5)
    return np.column_stack([x.ravel(), y.ravel()])


def camera_rays(camera: Camera) -> NDArray[np.float32]:
    """Return x / z and y / z (h, w, 2) of the centre of every pixel. The result is cached per camera."""
    return _rays(camera.model, camera.width, camera.height, camera.params.tobytes())


@lru_cache(maxsize=2)
def _rays(model: str, width: int, height: int, params: bytes) -> NDArray[np.float32]:
    """Return the rays (h, w, 2) of a camera; the arguments are hashable."""
    camera = Camera(model, width, height, np.frombuffer(params, dtype=np.float64))
    flat = view_rays(camera, pixel_grid(0, 0, width, height))[:, :2]
    return flat.reshape(height, width, 2).astype(np.float32)


def scene_positions(view: View, rays: NDArray[np.float32], depth: NDArray[np.floating]) -> FloatArray:
    """Return the positions (..., 3) in the scene of points at `depth` (...) on `rays` (..., 2) of a view."""
    local = np.concatenate([rays, np.ones((*rays.shape[:-1], 1), np.float32)], axis=-1) * depth[..., None]
    return np.asarray((local - view.translation) @ view.rotation)


def surface_normals(depth: NDArray[np.float32], rays: NDArray[np.float32]) -> NDArray[np.float32]:
    """Compute camera-facing unit normals (h, w, 3) from a depth (h, w) and rays (h, w, 2); 0 if unknown."""
    places = (
        np.dstack([rays, np.ones(depth.shape, np.float32)]) * np.where(np.isfinite(depth), depth, np.nan)[..., None]
    )
    down, across = np.gradient(places, axis=0), np.gradient(places, axis=1)
    normal = np.cross(down, across)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
        normal = np.where((normal * places).sum(axis=-1, keepdims=True) > 0, -normal, normal)
    return np.asarray(np.nan_to_num(normal), dtype=np.float32)
