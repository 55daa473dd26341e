"""The pose of one camera from points of the model and where it sees them, by robust Gauss-Newton steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.records.scene import Camera
from metric_base.arrays import BoolArray, FloatArray

__all__ = ["PosePoints", "rays_of", "refined_pose", "residuals_px"]

#: Steps from the pose of the frame before; it has converged in four.
STEPS = 10
#: Residual in pixels at which a point has half its weight (Cauchy); tracks are good to a few tenths.
HALF_WEIGHT_PX = 1.0
#: A point within so many pixels of its projection agrees with the pose.
AGREES_PX = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class PosePoints:
    """points : (n, 3) in the world; rays : (n, 2) x / z and y / z of the rays that see them, without distortion."""

    points: FloatArray
    rays: FloatArray

    def some(self, rows: BoolArray) -> PosePoints:
        """The points where `rows` (n,) is true."""
        return PosePoints(self.points[rows], self.rays[rows])


def rays_of(camera: Camera, pixels: FloatArray) -> FloatArray:
    """(n, 2) rays of (n, 2) pixels through COLMAP's camera, lens included."""
    if camera.model in {"PINHOLE", "SIMPLE_PINHOLE"} or not len(pixels):
        return np.asarray((pixels - camera.params[-2:]) / camera.params[:-2])
    from estimator.reconstructions.pycolmap_library import pycolmap

    lens = pycolmap.Camera(model=camera.model, width=camera.width, height=camera.height, params=camera.params)
    return np.asarray(lens.cam_from_img(np.ascontiguousarray(pixels, dtype=np.float64)), dtype=np.float64)[:, :2]


def residuals_px(points: PosePoints, rotation: FloatArray, translation: FloatArray, focal: float) -> FloatArray:
    """(n,) distances in pixels near the axis; infinite behind the camera."""
    local = points.points @ rotation.T + translation
    with np.errstate(divide="ignore", invalid="ignore"):
        error = focal * np.linalg.norm(local[:, :2] / local[:, 2:] - points.rays, axis=1)
    return np.where(local[:, 2] > 0, error, np.inf)


def refined_pose(
    points: PosePoints, rotation: FloatArray, translation: FloatArray, focal: float
) -> tuple[FloatArray, FloatArray, int]:
    """Rotation (3, 3), translation (3,) that minimise sum log(1 + |r|^2 / c^2), and how many points agree.

    A step (w, v) moves p = R X + t to p + w x p + v.
    """
    for step in range(STEPS):
        local = points.points @ rotation.T + translation
        ahead = local[:, 2] > 1e-9
        p, rays = local[ahead], points.rays[ahead]
        inverse = 1.0 / p[:, 2]
        x, y = p[:, 0] * inverse, p[:, 1] * inverse
        error = focal * (np.column_stack([x, y]) - rays)  # (m, 2)
        width = HALF_WEIGHT_PX * (8.0 if step < 3 else 1.0)  # wide at first, so that a larger motion is followed
        weight = 1.0 / (1.0 + (error**2).sum(axis=1) / width**2)
        zero = np.zeros_like(x)
        # (m, 2, 6) derivative of the pixel by w and v
        rows = np.stack(
            [
                np.column_stack([-x * y, 1 + x * x, -y, inverse, zero, -x * inverse]),
                np.column_stack([-1 - y * y, x * y, x, zero, inverse, -y * inverse]),
            ],
            axis=1,
        )
        jacobian = focal * rows
        normal = np.einsum("mki,m,mkj->ij", jacobian, weight, jacobian) + 1e-9 * np.eye(6)
        change = -np.linalg.solve(normal, np.einsum("mki,m,mk->i", jacobian, weight, error))
        turn = _rotation(change[:3])
        rotation, translation = turn @ rotation, turn @ translation + change[3:]
        if np.abs(change).max() < 1e-10:
            break
    agreeing = int((residuals_px(points, rotation, translation, focal) < AGREES_PX).sum())
    return rotation, translation, agreeing


def _rotation(vector: FloatArray) -> FloatArray:
    """(3, 3) rotation by a vector in radians."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vector).as_matrix())
