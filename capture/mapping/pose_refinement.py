"""Fit the pose of a camera, and optionally its focal length, to points with a robust loss (Cauchy)."""

from __future__ import annotations

import numpy as np

from estimator.projection.cameras import view_rays
from estimator.records.scene import Scene, View
from metric_base.arrays import FloatArray

#: Maximum number of steps from the pose of the frame before; four usually suffice.
MAX_POSE_STEPS = 10
#: Number of first steps with a Cauchy scale larger by a factor, which bridge a larger motion.
N_WIDE_STEPS, WIDE_FACTOR = 3, 8.0
#: Residual in pixels at which a point has half its weight (Cauchy); tracks are good to a few tenths.
HALF_WEIGHT_PX = 1.0
#: Minimum number of points for the focal length of a frame.
MIN_FOCAL_POINTS = 30


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

    The pose and the focal length of each frame are fitted to the points of the model, which are held, once to every
    second point and once to the others. The two have independent noise, so that their covariance over the frames is the
    variance without it. A zoom that one shared focal length had to explain, or moving objects, leave frames that
    disagree; the residuals hardly show it. Returns None if fewer than three frames have enough points.
    """
    rows = []
    for view in scene.views:
        rays = view_rays(view.camera, view.keypoints)[:, :2]
        known = np.isfinite(rays).all(axis=1)  # a diverged camera model has no rays at some pixels
        rays, points = rays[known], scene.points[view.point_index[known]]
        if len(rays) >= 2 * MIN_FOCAL_POINTS:
            rows.append([_focal_factor(view, rays[half::2], points[half::2]) for half in (0, 1)])
    if len(rows) < 3:
        return None
    return float(np.sqrt(max(np.cov(np.log(np.clip(rows, 0.1, 10.0)), rowvar=False)[0, 1], 0.0)))


def _focal_factor(view: View, rays: FloatArray, points: FloatArray) -> float:
    """Return the focal length of a frame, relative to its camera, from rays (n, 2) to points (n, 3)."""
    from estimator.reconstructions.pycolmap_library import pycolmap

    focal = view.camera.focal_px
    camera = pycolmap.Camera(model="SIMPLE_PINHOLE", width=1, height=1, params=[focal, 0.0, 0.0])
    pose = pycolmap.Rigid3d(pycolmap.Rotation3d(view.rotation), view.translation)
    options = pycolmap.AbsolutePoseRefinementOptions(loss_function_scale=HALF_WEIGHT_PX, refine_focal_length=True)
    pycolmap.refine_absolute_pose(pose, focal * rays, points, np.ones(len(points), dtype=bool), camera, options)
    return float(camera.params[0] / focal)
