"""Find stray points of a dense cloud: points in the air, behind which cameras observe a surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.projection.cameras import pixels_in_view
from estimator.records.scene import View
from metric_base.arrays import BoolArray, FloatArray, IntArray

#: Side of the cells in which the surface of a view has one depth, in pixels at an image width of 640.
CELL_PX = 7.0
#: Minimum number of points for the depth of a cell.
MIN_CELL_POINTS = 3
#: Maximum relative difference in depth between a surface and the points on it.
DEPTH_TOLERANCE = 0.05
#: Minimum number of views that look through a stray point.
MIN_VIEWS = 2
#: Minimum ratio of the views that look through a stray point to those that have it on their surface.
MIN_VIEW_RATIO = 1.5


def stray_points(points: FloatArray, views: Sequence[View], seen_by: Sequence[IntArray]) -> BoolArray:
    """Return which points views look through: they observe a surface clearly behind the point.

    Parameters
    ----------
    points : (n, 3) ndarray of float
        Points of the scene.
    views : sequence of View
        Views that vote.
    seen_by : sequence of (k,) ndarray of int
        Indices of the points that each view observes.

    Returns
    -------
    (n,) ndarray of bool
    """
    through, on_surface = np.zeros(len(points), np.int64), np.zeros(len(points), np.int64)
    for view, known in zip(views, seen_by, strict=True):
        pixels, depths = pixels_in_view(view, points)
        inside = np.flatnonzero(np.isfinite(pixels[:, 0]))
        surface = _surface_depth(pixels, depths, np.intersect1d(inside, known), view)
        side = CELL_PX * view.camera.width / 640
        cells = (pixels[inside] // side).astype(np.int64)
        difference = depths[inside] / surface[cells[:, 1], cells[:, 0]] - 1  # NaN if the surface is not known
        through[inside] += difference < -DEPTH_TOLERANCE
        on_surface[inside] += np.abs(difference) <= DEPTH_TOLERANCE
    return np.asarray((through >= MIN_VIEWS) & (through > MIN_VIEW_RATIO * on_surface))


def _surface_depth(pixels: FloatArray, depths: FloatArray, known: IntArray, view: View) -> FloatArray:
    """Return the median depth (h, w) of the observed points in each cell, NaN if there are too few.

    Parameters
    ----------
    pixels, depths : (n, 2) and (n,) ndarray of float
        Projection of all points.
    known : (k,) ndarray of int
        Points that the view observes.
    """
    side = CELL_PX * view.camera.width / 640
    shape = (int(view.camera.height // side) + 1, int(view.camera.width // side) + 1)
    cells = (pixels[known] // side).astype(np.int64)
    cell = cells[:, 1] * shape[1] + cells[:, 0]
    order = np.lexsort((depths[known], cell))
    counts = np.bincount(cell, minlength=shape[0] * shape[1])
    starts = np.cumsum(counts) - counts
    surface = np.full(shape[0] * shape[1], np.nan)
    full = counts >= MIN_CELL_POINTS
    surface[full] = depths[known][order][(starts + counts // 2)[full]]
    return surface.reshape(shape)
