"""Errors of sparse points: how far the rays that meet in a point leave its place open."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.projection.cameras import pixels_in_view
from estimator.records.scene import View
from metric_base.arrays import FloatArray

__all__ = ["point_covariances"]

# A keypoint is off by at least this much, in pixels, and in a good model by 1 at the most.
LEAST_PX, MOST_PX = 0.5, 3.0
# Observations of a view that say how far keypoints are off.
MAX_OBSERVATIONS = 500
# No point is known better than to this share of its distance, and none worse than to this multiple of it: without a
# baseline the rays leave the depth open.
LEAST_SHARE, MOST_SHARE = 0.002, 1.0


def point_covariances(views: Sequence[View], points: FloatArray) -> FloatArray:
    """(n, 3, 3) covariance of each sparse point (n, 3) from the rays of its observations, in the world.

    Equation: C = (sum over its views of (f / (s d))^2 (1 - r r'))^-1 with the focal length f and the error s in
    pixels, the distance d and the unit ray r. Without observations it is `MOST_SHARE` of the distance all round.
    """
    information = np.zeros((len(points), 3, 3))
    distance = np.full(len(points), np.inf)
    error = keypoint_error(views, points)
    for view in views:
        rows = view.point_index
        rays = points[rows] - view.centre
        away = np.maximum(np.linalg.norm(rays, axis=1), np.finfo(float).tiny)
        rays = rays / away[:, None]
        # the first parameter of every camera model is a focal length in pixels
        sharp = (float(view.camera.params[0]) / (error * away)) ** 2
        own = sharp[:, None, None] * (np.eye(3) - rays[:, :, None] * rays[:, None, :])
        np.add.at(information, rows, own)
        np.minimum.at(distance, rows, away)
    far = np.where(np.isfinite(distance), distance, 1.0)[:, None, None]
    covariance = np.linalg.inv(information + np.eye(3) / (MOST_SHARE * far) ** 2)
    return np.asarray(covariance + np.eye(3) * (LEAST_SHARE * far) ** 2)


def keypoint_error(views: Sequence[View], points: FloatArray) -> float:
    """Standard deviation of the keypoints of points (n, 3) along either axis of a picture, in pixels."""
    misses = [np.empty(0)]
    for view in views:
        step = max(1, -(-len(view.point_index) // MAX_OBSERVATIONS))
        pixels, _ = pixels_in_view(view, points[view.point_index[::step]])
        misses.append(np.linalg.norm(pixels - view.keypoints[::step], axis=1))
    every = np.concatenate(misses)
    every = every[np.isfinite(every)]
    # the median of a Rayleigh distribution is 1.18 of its parameter
    return float(np.clip(np.median(every) / 1.18, LEAST_PX, MOST_PX)) if every.size else MOST_PX
