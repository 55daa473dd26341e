"""The pose of one camera from points of the model and where it sees them, by robust Gauss-Newton steps.

Whether the focal length stays the same along a video: each frame's own, with the points held.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.records.scene import Camera, Scene, View
from metric_base.arrays import BoolArray, FloatArray

#: Steps from the pose of the frame before; it has converged in four.
STEPS = 10
#: Residual in pixels at which a point has half its weight (Cauchy); tracks are good to a few tenths.
HALF_WEIGHT_PX = 1.0
#: A point within so many pixels of its projection agrees with the pose.
AGREES_PX = 3.0
#: Steps from the model's own pose; it has converged in four.
FOCAL_STEPS = 6
#: Fewest points that say something about one frame's focal length.
LEAST_POINTS = 30


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


def focal_variation(scene: Scene) -> tuple[float, float, float] | None:
    """Return how the frames' own focal lengths vary, or None if fewer than three frames have enough points.

    The pose and the focal length of each frame are fitted to the points of the model, which are held. A zoom that one
    shared focal length had to explain, or moving objects, leave frames that disagree; the residuals hardly show it.

    Returns
    -------
    spread : float
        Standard deviation of the logarithm of the focal lengths, beyond that of their noise.
    change : float
        Change of the logarithm from the first to the last frame in the order of the names, by linear regression.
    error : float
        Standard error of the change, by the scatter about the regression line.
    """
    views = sorted(scene.views, key=lambda view: view.name)
    rows = [_focal_factor(scene, view) for view in views if len(view.point_index) >= LEAST_POINTS]
    if len(rows) < 3 or not np.isfinite(rows).all():  # a diverged camera model has no rays
        return None
    factors, errors = np.array(rows).T
    logs = np.log(np.clip(factors, 0.1, 10.0))
    spread = float(np.sqrt(max(np.var(logs) - np.mean(errors**2), 0.0)))
    position = np.linspace(-0.5, 0.5, len(logs))
    change = float(position @ logs / (position @ position))
    scatter = logs - logs.mean() - change * position
    error = float(np.sqrt(scatter @ scatter / (len(logs) - 2) / (position @ position)))
    return spread, change, error


def _focal_factor(scene: Scene, view: View) -> tuple[float, float]:
    """The frame's own focal length over that of its camera, and its relative standard error.

    By robust Gauss-Newton steps (w, v, g), which move p = R X + t to p + w x p + v and the factor g by as much. The
    error is that of a robust fit, A^-1 B A^-1 (Huber 1967): A the normal matrix, B the sum of the squared gradients.
    """
    points, rays = scene.points[view.point_index], rays_of(view.camera, view.keypoints)
    width = HALF_WEIGHT_PX / view.camera.focal_px
    local, factor = view.to_camera(points), 1.0
    for _ in range(FOCAL_STEPS):
        seen = local[:, 2] > 1e-9
        x, y = (local[seen, :2] / local[seen, 2:]).T
        error = factor * np.column_stack([x, y]) - rays[seen]  # (m, 2)
        weight = 1.0 / (1.0 + (error**2).sum(axis=1) / width**2)
        jacobian = _jacobian(x, y, 1.0 / local[seen, 2], factor)
        gradient = np.einsum("mki,m,mk->mi", jacobian, weight, error)  # (m, 7)
        inverse = np.linalg.inv(np.einsum("mki,m,mkj->ij", jacobian, weight, jacobian) + 1e-12 * np.eye(7))
        change = -inverse @ gradient.sum(axis=0)
        local = local + np.cross(change[:3], local) + change[3:6]
        factor += float(change[6])
    covariance = inverse @ (gradient.T @ gradient) @ inverse
    return factor, float(np.sqrt(max(covariance[6, 6], 0.0)) / max(factor, 1e-6))


def _jacobian(x: FloatArray, y: FloatArray, inverse: FloatArray, factor: float) -> FloatArray:
    """(m, 2, 7) derivative of the rays by turn, shift and focal factor; x, y, inverse depth : (m,)."""
    zero = np.zeros_like(x)
    across = np.column_stack([-x * y, 1 + x * x, -y, inverse, zero, -x * inverse, x / factor])
    down = np.column_stack([-1 - y * y, x * y, x, zero, inverse, -y * inverse, y / factor])
    return np.asarray(factor * np.stack([across, down], axis=1))
