"""Depth noise of a cloud, read where it is plain: in the pictures, not in space.

Dense points err along their lines of sight by a share of their distance. In space that noise looks like shape
once it is as thick as the neighbourhood it is looked for in; in a picture, neighbours stay neighbours whatever their
depths, and the inverse depth of a plane is linear in the pixel.

Errors of sparse points: how far the rays that meet in a point leave its place open.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.association.point_labels import PointLabels
from estimator.geometry.extents import quantiles
from estimator.projection.cameras import pixels_in_view
from estimator.projection.visibility import row_indices
from estimator.records.scene import View
from metric_base.arrays import FloatArray, IntArray

# Views that are read, and cells of each: noise is much the same in all, and 400 cells tell a quantile to a twentieth.
MAX_VIEWS = 4
MAX_CELLS = 100
# Points of a cell: three are spent on the plane, and the others tell its residual to a sixth.
POINTS_PER_CELL = 24
MIN_POINTS_PER_CELL = 10
# Fewer cells are mostly outlines.
MIN_CELLS = 30
# Cells that hold an outline look thick, and of a sparse cloud most do: flat ones lie in the lowest part, and there the
# residual of some twenty points is this share of what all flat cells show.
FLAT_CELLS, FLAT_SHARE = 0.15, 0.86
# A keypoint is off by at least this much, in pixels, and in a good model by 1 at the most.
LEAST_PX, MOST_PX = 0.5, 3.0
# Observations of a view that say how far keypoints are off.
MAX_OBSERVATIONS = 500
# No point is known better than to this share of its distance, and none worse than to this multiple of it: without a
# baseline the rays leave the depth open.
LEAST_SHARE, MOST_SHARE = 0.002, 1.0


def depth_noise(views: Sequence[View], labels: PointLabels) -> float:
    """Standard deviation of the points along their lines of sight as a share of the distance, 0 where unknown.

    Equation: per cell of a picture, 1 / z = a + b x + c y by least squares; the 15 % quantile over all cells of the
    residual's standard deviation over the mean of 1 / z, over 0.86.
    """
    step = max(1, -(-len(views) // MAX_VIEWS))
    residuals = [
        _residuals(labels.points, row_indices(labels.visibility, index), views[index])
        for index in range(0, len(views), step)
    ]
    shares = np.concatenate([*residuals, np.empty(0)])
    return float(quantiles(shares, np.array([FLAT_CELLS]))[0]) / FLAT_SHARE if shares.size >= MIN_CELLS else 0.0


def sight_moment(eyes: FloatArray, place: FloatArray) -> tuple[float, FloatArray]:
    """Median distance of cameras (v, 3) from a place (3,), and the second moment (3, 3) of their directions to it."""
    rays = place - eyes
    distances = np.sqrt(np.einsum("vi,vi->v", rays, rays))
    units = rays / np.maximum(distances, np.finfo(float).tiny)[:, None]
    return float(np.median(distances)), np.asarray(units.T @ units / len(units))


def _residuals(points: FloatArray, rows: IntArray, view: View) -> FloatArray:
    """(k,) relative residual of the plane of each cell of a picture that has points enough."""
    camera = view.rotation @ points.take(rows, axis=0).T + view.translation[:, None]
    camera = camera[:, camera[2] > 0]
    if camera.shape[1] < MIN_POINTS_PER_CELL:
        return np.empty(0)
    inverse = 1 / camera[2]
    sight = np.array([camera[0] * inverse, camera[1] * inverse, inverse])
    cells = _cells(*sight[:2])
    full = np.flatnonzero(np.bincount(cells) >= MIN_POINTS_PER_CELL)
    full = full[:: max(1, -(-full.size // MAX_CELLS))]
    cell = np.full(int(cells.max()) + 1, -1)
    cell[full] = np.arange(full.size)
    kept = np.flatnonzero(cell[cells] >= 0)
    return _plane_residuals(sight.take(kept, axis=1), cell[cells[kept]])


def _plane_residuals(sight: FloatArray, cells: IntArray) -> FloatArray:
    """(k,) of x, y and 1 / z (3, n) in k cells: standard deviation of 1 / z about its plane over its mean."""
    count = np.bincount(cells)
    means = np.array([np.bincount(cells, row) for row in sight]) / count
    x, y, w = sight - means[:, cells]
    xx, xy, yy, xw, yw, ww = (
        np.bincount(cells, one * two) for one, two in ((x, x), (x, y), (y, y), (x, w), (y, w), (w, w))
    )
    determinant = np.maximum(xx * yy - xy * xy, np.finfo(float).tiny)
    explained = (xw * xw * yy - 2 * xw * yw * xy + yw * yw * xx) / determinant
    return np.asarray(np.sqrt(np.maximum(ww - explained, 0.0) / (count - 3)) / means[2])


def _cells(x: FloatArray, y: FloatArray) -> IntArray:
    """(n,) cell of each point in a square grid over the picture that holds about `POINTS_PER_CELL` in each."""
    across, along = float(np.ptp(x)), float(np.ptp(y))
    side = max(np.sqrt(across * along * POINTS_PER_CELL / len(x)), max(across, along) / len(x), np.finfo(float).tiny)
    columns, lines = ((x - x.min()) / side).astype(np.int64), ((y - y.min()) / side).astype(np.int64)
    return np.asarray(lines * (columns.max() + 1) + columns)


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
