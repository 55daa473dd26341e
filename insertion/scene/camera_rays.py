"""The part of an ideal picture that is rendered: a window of the undistorted image plane.

Rays through pixels, by COLMAP's own camera models.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator.projection.cameras import CAMERA_MODELS
from estimator.records.scene import Camera, View
from metric_base.arrays import FloatArray

_PINHOLES = ("PINHOLE", "SIMPLE_PINHOLE")


@dataclass(frozen=True, slots=True)
class Window:
    """Pixels x0 .. x0 + width of a pinhole picture with focal lengths fx, fy and principal point (cx, cy).

    COLMAP's pixels: the centre of a picture's first pixel is (0.5, 0.5).
    """

    fx: float
    fy: float
    cx: float
    cy: float
    x0: int
    y0: int
    width: int
    height: int

    def clip(self, rotation: FloatArray, translation: FloatArray, near: float, far: float) -> FloatArray:
        """(4, 4) local to clip space; y points down, so that the first row read back is the window's upper row."""
        ahead = np.array([
            [2 * self.fx / self.width, 0, 2 * (self.cx - self.x0) / self.width - 1, 0],
            [0, 2 * self.fy / self.height, 2 * (self.cy - self.y0) / self.height - 1, 0],
            [0, 0, (far + near) / (far - near), -2 * far * near / (far - near)],
            [0, 0, 1, 0],
        ])  # fmt: skip
        view = np.eye(4)
        view[:3, :3], view[:3, 3] = rotation, translation
        return np.asarray(ahead @ view)


def focal_lengths(camera: Camera) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy of the ideal picture: the camera's own, its lens left out."""
    values = dict(zip(CAMERA_MODELS[camera.model][1], camera.params.tolist(), strict=True))
    focal = values.get("f", 0.0)
    return values.get("fx", focal), values.get("fy", focal), values["cx"], values["cy"]


def normalized_pixels(camera: Camera, pixels: FloatArray) -> FloatArray:
    """(n, 2) x / z and y / z in the camera of (n, 2) pixels, the lens undone."""
    if camera.model in _PINHOLES:
        return np.asarray((pixels - camera.params[-2:]) / camera.params[:-2])
    from estimator.reconstructions.pycolmap_library import pycolmap

    lens = pycolmap.Camera(model=camera.model, width=camera.width, height=camera.height, params=camera.params)
    return np.asarray(lens.cam_from_img(np.ascontiguousarray(pixels, dtype=np.float64)), dtype=np.float64)[:, :2]


def ray_through(view: View, x: float, y: float) -> FloatArray:
    """(3,) direction in the scene of the ray through a pixel, of length 1 along the optical axis."""
    flat = normalized_pixels(view.camera, np.array([[x, y]]))[0]
    return np.asarray(np.append(flat, 1.0) @ view.rotation)


def pixel_grid(x0: int, y0: int, width: int, height: int) -> FloatArray:
    """(n, 2) centres of the n = width height pixels of a box, row by row."""
    x, y = np.meshgrid(x0 + np.arange(width) + 0.5, y0 + np.arange(height) + 0.5)
    return np.column_stack([x.ravel(), y.ravel()])


def camera_rays(camera: Camera) -> NDArray[np.float32]:
    """(h, w, 2) x / z and y / z of every pixel's centre; made once for a camera."""
    return _rays(camera.model, camera.width, camera.height, camera.params.tobytes())


@lru_cache(maxsize=2)
def _rays(model: str, width: int, height: int, params: bytes) -> NDArray[np.float32]:
    """(h, w, 2) x / z and y / z of a camera's pixels, kept for cameras of equal parameters."""
    camera = Camera(model, width, height, np.frombuffer(params, dtype=np.float64))
    flat = normalized_pixels(camera, pixel_grid(0, 0, width, height))
    return flat.reshape(height, width, 2).astype(np.float32)
