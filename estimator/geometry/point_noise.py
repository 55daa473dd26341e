"""Estimate the noise of clouds: depth noise of dense points, covariances of sparse points.

Dense points have errors along their lines of sight that are proportional to the distance (`depth_noise`). They are
estimated in the images: in space, noise is not distinguishable from shape if it is as large as the neighbourhood, but
in an image, neighbours are the same for any depths, and the inverse depth of a plane is linear in the pixel.

Sparse points have the error of the intersection of their rays (`point_covariances`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.association.point_labels import PointLabels
from estimator.projection.cameras import pixels_in_view
from estimator.projection.visibility import row_indices
from estimator.records.scene import View
from metric_base.arrays import FloatArray, IntArray

# Maximum number of views for the depth noise; it is similar in all.
MAX_VIEWS = 4
# Maximum number of cells per view: 400 cells determine a quantile within 0.05.
MAX_CELLS = 100
# Number of points per cell: three determine the plane, and the others its residual within a sixth.
POINTS_PER_CELL = 24
MIN_POINTS_PER_CELL = 10
# Minimum number of cells; fewer are mainly at the borders of objects.
MIN_CELLS = 30
# Quantile of the residuals that is that of flat cells. Cells at the border of an object have large residuals, and most
# cells of a sparse cloud are such cells.
FLAT_CELL_QUANTILE = 0.15
# Ratio of the residual of about twenty points at this quantile to the noise of flat cells.
FLAT_CELL_RATIO = 0.86
# Range of the standard deviation of a keypoint in pixels; it is at most 1 in a good model.
MIN_KEYPOINT_SIGMA_PX = 0.5
MAX_KEYPOINT_SIGMA_PX = 3.0
# Median of a Rayleigh distribution relative to its parameter.
RAYLEIGH_MEDIAN = 1.18
# Maximum number of observations per view for this standard deviation.
MAX_OBSERVATIONS = 500
# Range of the standard deviation of a point relative to its distance: without a baseline, the rays do not determine the
# depth.
MIN_POINT_SIGMA = 0.002
MAX_POINT_SIGMA = 1.0


def depth_noise(views: Sequence[View], labels: PointLabels) -> float:
    """Estimate the standard deviation of points along their lines of sight, relative to the distance; 0 if unknown.

    In each cell of an image, 1 / z = a + b x + c y is fitted. The noise is the 15 % quantile over all cells of the
    standard deviation of the residual relative to the mean of 1 / z, divided by 0.86.

    Parameters
    ----------
    views : sequence of View
    labels : PointLabels
        The cloud, with n points.
    """
    step = max(1, -(-len(views) // MAX_VIEWS))
    residuals = [
        _residuals(labels.points, row_indices(labels.visibility, index), views[index])
        for index in range(0, len(views), step)
    ]
    relative = np.concatenate([*residuals, np.empty(0)])
    if relative.size < MIN_CELLS:
        return 0.0
    return float(np.quantile(relative, FLAT_CELL_QUANTILE)) / FLAT_CELL_RATIO


def view_direction_moment(eyes: FloatArray, position: FloatArray) -> tuple[float, FloatArray]:
    """Return the median distance of cameras (v, 3) from a position (3,), and the second moment (3, 3) of directions."""
    rays = position - eyes
    distances = np.sqrt(np.einsum("vi,vi->v", rays, rays))
    units = rays / np.maximum(distances, np.finfo(float).tiny)[:, None]
    return float(np.median(distances)), np.asarray(units.T @ units / len(units))


def _residuals(points: FloatArray, rows: IntArray, view: View) -> FloatArray:
    """Return the relative residual (k,) of the plane in each cell of a view with enough of the points `rows` (m,)."""
    camera = view.rotation @ points.take(rows, axis=0).T + view.translation[:, None]
    camera = camera[:, camera[2] > 0]
    if camera.shape[1] < MIN_POINTS_PER_CELL:
        return np.empty(0)
    inverse = 1 / camera[2]
    image = np.array([camera[0] * inverse, camera[1] * inverse, inverse])  # x, y and 1 / z
    # Square cells with about `POINTS_PER_CELL` points.
    x, y = image[:2]
    width, height = float(np.ptp(x)), float(np.ptp(y))
    side = max(np.sqrt(width * height * POINTS_PER_CELL / len(x)), max(width, height) / len(x), np.finfo(float).tiny)
    column, row = ((x - x.min()) / side).astype(np.int64), ((y - y.min()) / side).astype(np.int64)
    cells = np.asarray(row * (column.max() + 1) + column)
    full = np.flatnonzero(np.bincount(cells) >= MIN_POINTS_PER_CELL)
    full = full[:: max(1, -(-full.size // MAX_CELLS))]
    number = np.full(int(cells.max()) + 1, -1)
    number[full] = np.arange(full.size)
    keep = np.flatnonzero(number[cells] >= 0)
    # Standard deviation of 1 / z around the plane of each cell, relative to its mean.
    image = image.take(keep, axis=1)
    cells = number[cells[keep]]
    count = np.bincount(cells)
    means = np.array([np.bincount(cells, row) for row in image]) / count
    x, y, w = image - means[:, cells]
    xx, xy, yy, xw, yw, ww = (
        np.bincount(cells, one * two) for one, two in ((x, x), (x, y), (y, y), (x, w), (y, w), (w, w))
    )
    determinant = np.maximum(xx * yy - xy * xy, np.finfo(float).tiny)
    explained = (xw * xw * yy - 2 * xw * yw * xy + yw * yw * xx) / determinant
    return np.asarray(np.sqrt(np.maximum(ww - explained, 0.0) / (count - 3)) / means[2])


def point_covariances(views: Sequence[View], points: FloatArray) -> FloatArray:
    """Return the covariance (n, 3, 3) in the world of each sparse point (n, 3) from the rays of its observations.

    It is C = (sum over its views of (f / (s d))^2 (1 - r r'))^-1 with the focal length f and the error s in pixels, the
    distance d and the unit ray r. Without observations, the standard deviation is `MAX_POINT_SIGMA` in all directions.
    """
    information = np.zeros((len(points), 3, 3))
    distance = np.full(len(points), np.inf)
    error = keypoint_error(views, points)
    for view in views:
        rows = view.point_index
        rays = points[rows] - view.centre
        lengths = np.maximum(np.linalg.norm(rays, axis=1), np.finfo(float).tiny)
        rays = rays / lengths[:, None]
        # The first parameter of every camera model is a focal length in pixels.
        precision = (view.camera.focal_px / (error * lengths)) ** 2
        across = precision[:, None, None] * (np.eye(3) - rays[:, :, None] * rays[:, None, :])
        np.add.at(information, rows, across)
        np.minimum.at(distance, rows, lengths)
    closest = np.where(np.isfinite(distance), distance, 1.0)[:, None, None]
    covariance = np.linalg.inv(information + np.eye(3) / (MAX_POINT_SIGMA * closest) ** 2)
    return np.asarray(covariance + np.eye(3) * (MIN_POINT_SIGMA * closest) ** 2)


def keypoint_error(views: Sequence[View], points: FloatArray) -> float:
    """Estimate the standard deviation in pixels of the keypoints of points (n, 3) along each axis of the image."""
    errors = [np.empty(0)]
    for view in views:
        step = max(1, -(-len(view.point_index) // MAX_OBSERVATIONS))
        pixels, _ = pixels_in_view(view, points[view.point_index[::step]])
        errors.append(np.linalg.norm(pixels - view.keypoints[::step], axis=1))
    error = np.concatenate(errors)
    error = error[np.isfinite(error)]
    if not error.size:
        return MAX_KEYPOINT_SIGMA_PX
    return float(np.clip(np.median(error) / RAYLEIGH_MEDIAN, MIN_KEYPOINT_SIGMA_PX, MAX_KEYPOINT_SIGMA_PX))
