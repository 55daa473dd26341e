"""Whether the focal length stays the same along a video: each frame's own, with the points held."""

from __future__ import annotations

import numpy as np

from estimator.capture.cameras.absolute_pose import rays_of
from estimator.records.scene import Scene, View
from metric_base.arrays import FloatArray

__all__ = ["focal_spread"]

#: Steps from the model's own pose; it has converged in four.
STEPS = 6
#: Residual in pixels at which a point has half its weight (Cauchy).
HALF_WEIGHT_PX = 1.0
#: Fewest points that say something about one frame's focal length.
LEAST_POINTS = 30


def focal_spread(scene: Scene) -> float | None:
    """Standard deviation over the frames of the logarithm of each one's own focal length, beyond what noise explains.

    Every frame's pose and focal length are fitted to the points of the model, which stay. A zoom that one shared focal
    length had to explain, or objects that moved, leave frames at odds; the residuals hardly show it. None with fewer
    than three frames that see enough points.
    """
    rows = [_focal_factor(scene, view) for view in scene.views if len(view.point_index) >= LEAST_POINTS]
    if len(rows) < 3:
        return None
    factors, errors = np.array(rows).T
    return float(np.sqrt(max(np.var(np.log(np.clip(factors, 0.1, 10.0))) - np.mean(errors**2), 0.0)))


def _focal_factor(scene: Scene, view: View) -> tuple[float, float]:
    """The frame's own focal length over that of its camera, and its relative standard error.

    By robust Gauss-Newton steps (w, v, g), which move p = R X + t to p + w x p + v and the factor g by as much. The
    error is that of a robust fit, A^-1 B A^-1 (Huber 1967): A the normal matrix, B the sum of the squared gradients.
    """
    points, rays = scene.points[view.point_index], rays_of(view.camera, view.keypoints)
    width = HALF_WEIGHT_PX / float(view.camera.params[0])
    local, factor = points @ view.rotation.T + view.translation, 1.0
    for _ in range(STEPS):
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
