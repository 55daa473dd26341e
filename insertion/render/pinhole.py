"""The part of an ideal picture that is rendered: a window of the undistorted image plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.projection.cameras import CAMERA_MODELS
from estimator.records.scene import Camera
from metric_base.arrays import FloatArray

__all__ = ["Window", "focal_lengths"]


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
