"""Fit the pose of a camera to points, alone or with its focal length, robustly (Cauchy)."""

from __future__ import annotations

import numpy as np

from estimator.records.scene import Camera, Scene, View
from metric_base.arrays import FloatArray

#: Maximum number of steps from the pose of the frame before; four usually suffice.
MAX_POSE_STEPS = 10
#: Number of first steps with a Cauchy scale larger by a factor, which bridge a larger motion.
N_WIDE_STEPS, WIDE_FACTOR = 3, 8.0
#: Residual in pixels at which a point has half its weight (Cauchy); tracks are good to a few tenths.
HALF_WEIGHT_PX = 1.0
#: Number of steps from the model's own pose; four suffice.
N_FOCAL_STEPS = 6
#: Minimum number of points for the focal length of a frame.
MIN_FOCAL_POINTS = 30


def rays_of(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Return the rays x / z and y / z (n, 2) of pixels (n, 2), without distortion."""
    if camera.model in {"PINHOLE", "SIMPLE_PINHOLE"} or not len(pixels):
        return np.asarray((pixels - camera.params[-2:]) / camera.params[:-2])
    from estimator.reconstructions.pycolmap_library import pycolmap

    lens = pycolmap.Camera(model=camera.model, width=camera.width, height=camera.height, params=camera.params)
    return np.asarray(lens.cam_from_img(np.ascontiguousarray(pixels, dtype=np.float64)), dtype=np.float64)[:, :2]


def residuals_px(
    points: FloatArray, rays: FloatArray, rotation: FloatArray, translation: FloatArray, focal: float
) -> FloatArray:
    """Return the distances (n,) of points (n, 3) from rays (n, 2) in pixels near the axis; infinite behind it."""
    local = points @ rotation.T + translation
    with np.errstate(divide="ignore", invalid="ignore"):
        error = focal * np.linalg.norm(local[:, :2] / local[:, 2:] - rays, axis=1)
    return np.where(local[:, 2] > 0, error, np.inf)


def refined_pose(
    points: FloatArray, rays: FloatArray, rotation: FloatArray, translation: FloatArray, focal: float
) -> tuple[FloatArray, FloatArray]:
    """Return rotation (3, 3) and translation (3,) that minimise sum log(1 + |r|^2 / c^2) with the residuals r.

    Parameters
    ----------
    points : (n, 3) ndarray of float
        In the world.
    rays : (n, 2) ndarray of float
        Rays of the camera that see them.
    rotation, translation : (3, 3) and (3,) ndarray of float
        Initial pose.
    focal : float
        In pixels.
    """
    from estimator.reconstructions.pycolmap_library import pycolmap

    camera = pycolmap.Camera(model="SIMPLE_PINHOLE", width=1, height=1, params=[focal, 0.0, 0.0])
    pose = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), translation)
    for scale, n_steps in ((WIDE_FACTOR * HALF_WEIGHT_PX, N_WIDE_STEPS), (HALF_WEIGHT_PX, MAX_POSE_STEPS)):
        options = pycolmap.AbsolutePoseRefinementOptions(loss_function_scale=scale, max_num_iterations=n_steps)
        everyone = np.ones(len(points), dtype=bool)
        found = pycolmap.refine_absolute_pose(pose, focal * rays, points, everyone, camera, options)
        pose = pose if found is None else found["cam_from_world"]
    matrix = pose.matrix()
    return matrix[:, :3], matrix[:, 3]


def focal_variation(scene: Scene) -> float | None:
    """Return the standard deviation of the logarithm of the frames' own focal lengths, beyond that of their noise.

    The pose and the focal length of each frame are fitted to the points of the model, which are held. A zoom that one
    shared focal length had to explain, or moving objects, leave frames that disagree; the residuals hardly show it.
    Returns None if fewer than three frames have enough points.
    """
    rows = [_focal_factor(scene, view) for view in scene.views if len(view.point_index) >= MIN_FOCAL_POINTS]
    if len(rows) < 3 or not np.isfinite(rows).all():  # a diverged camera model has no rays
        return None
    factors, errors = np.array(rows).T
    return float(np.sqrt(max(np.var(np.log(np.clip(factors, 0.1, 10.0))) - np.mean(errors**2), 0.0)))


def _focal_factor(scene: Scene, view: View) -> tuple[float, float]:
    """Return a frame's own focal length relative to that of its camera, and its relative standard error.

    A step (w, v, g) moves p = R X + t to p + w x p + v and the factor by g. The error is that of a robust fit,
    A^-1 B A^-1 (Huber 1967), with the normal matrix A and the sum B of the squared gradients.
    """
    rays = rays_of(view.camera, view.keypoints)
    scale = HALF_WEIGHT_PX / view.camera.focal_px
    local, factor = view.to_camera(scene.points[view.point_index]), 1.0
    for _ in range(N_FOCAL_STEPS):
        ahead = local[:, 2] > 1e-9
        x, y = (local[ahead, :2] / local[ahead, 2:]).T
        error = factor * np.column_stack([x, y]) - rays[ahead]  # (m, 2)
        weight = 1.0 / (1.0 + (error**2).sum(axis=1) / scale**2)
        by_pose = factor * _pose_jacobian(x, y, 1.0 / local[ahead, 2])
        jacobian = np.concatenate([by_pose, np.stack([x, y], axis=1)[:, :, None]], axis=2)  # (m, 2, 7)
        gradient = np.einsum("mki,m,mk->mi", jacobian, weight, error)  # (m, 7)
        inverse = np.linalg.inv(np.einsum("mki,m,mkj->ij", jacobian, weight, jacobian) + 1e-12 * np.eye(7))
        change = -inverse @ gradient.sum(axis=0)
        local = local + np.cross(change[:3], local) + change[3:6]
        factor += float(change[6])
    covariance = inverse @ (gradient.T @ gradient) @ inverse
    return factor, float(np.sqrt(max(covariance[6, 6], 0.0)) / max(factor, 1e-6))


def _pose_jacobian(x: FloatArray, y: FloatArray, inverse: FloatArray) -> FloatArray:
    """Return the derivative (m, 2, 6) of rays by rotation and translation; x, y, inverse depth : (m,)."""
    zero = np.zeros_like(x)
    across = np.column_stack([-x * y, 1 + x * x, -y, inverse, zero, -x * inverse])
    down = np.column_stack([-1 - y * y, x * y, x, zero, inverse, -y * inverse])
    return np.asarray(np.stack([across, down], axis=1))
