"""Whether the focal length stays the same along a film: each frame's own, with the points held."""

from __future__ import annotations

import numpy as np

from estimator.capture.mapping.absolute_pose import rays_of
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
    """Standard deviation over the frames of the logarithm of each one's own focal length.

    Every frame's pose and focal length are fitted to the points of the model, which stay. A zoom that one shared focal
    length had to explain leaves the frames at odds; the residuals hardly show it. None with fewer than three frames
    that see enough points.
    """
    factors = [_focal_factor(scene, view) for view in scene.views if len(view.point_index) >= LEAST_POINTS]
    return float(np.std(np.log(np.clip(factors, 0.1, 10.0)))) if len(factors) >= 3 else None


def _focal_factor(scene: Scene, view: View) -> float:
    """The frame's own focal length over that of its camera, by robust Gauss-Newton steps.

    A step (w, v, g) moves p = R X + t to p + w x p + v and the factor g by as much.
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
        normal = np.einsum("mki,m,mkj->ij", jacobian, weight, jacobian) + 1e-12 * np.eye(7)
        change = -np.linalg.solve(normal, np.einsum("mki,m,mk->i", jacobian, weight, error))
        local = local + np.cross(change[:3], local) + change[3:6]
        factor += float(change[6])
    return factor


def _jacobian(x: FloatArray, y: FloatArray, inverse: FloatArray, factor: float) -> FloatArray:
    """(m, 2, 7) derivative of the rays by turn, shift and focal factor; x, y, inverse depth : (m,)."""
    zero = np.zeros_like(x)
    across = np.column_stack([-x * y, 1 + x * x, -y, inverse, zero, -x * inverse, x / factor])
    down = np.column_stack([-1 - y * y, x * y, x, zero, inverse, -y * inverse, y / factor])
    return np.asarray(factor * np.stack([across, down], axis=1))
