"""Strays of a dense cloud: points in the air that cameras see through."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.projection.cameras import pixels_in_view
from estimator.records.scene import View
from metric_base.arrays import BoolArray, FloatArray, IntArray

#: Side of the cells in which a view's surface has one depth, in pixels at a width of 640.
CELL_PX = 7.0
#: Points of a cell that its depth rests on.
CELL_POINTS = 3
#: A point is in front of a surface by more than this share of the depth, and on it within the same share.
IN_FRONT = 0.05
#: A stray is seen through in at least so many views, and in so many times as many as have it on their surface.
LEAST_VIEWS, TIMES = 2, 1.5


def stray_points(points: FloatArray, views: Sequence[View], seen_by: Sequence[IntArray]) -> BoolArray:
    """(n,) points that views see through: what a view is known to see in the same direction is clearly behind them.

    points : (n, 3); seen_by : rows of the points that each of the views is known to see.
    """
    through, on = np.zeros(len(points), np.int64), np.zeros(len(points), np.int64)
    for view, known in zip(views, seen_by, strict=True):
        pixels, depths = pixels_in_view(view, points)
        inside = np.flatnonzero(np.isfinite(pixels[:, 0]))
        surface = _surface(pixels, depths, np.intersect1d(inside, known), view)
        side = CELL_PX * view.camera.width / 640
        cells = (pixels[inside] // side).astype(np.int64)
        ahead = depths[inside] / surface[cells[:, 1], cells[:, 0]] - 1  # NaN where nothing is known
        through[inside] += ahead < -IN_FRONT
        on[inside] += np.abs(ahead) <= IN_FRONT
    return np.asarray((through >= LEAST_VIEWS) & (through > TIMES * on))


def _surface(pixels: FloatArray, depths: FloatArray, known: IntArray, view: View) -> FloatArray:
    """(h, w) median depth of the known points in each cell, NaN where there are too few."""
    side = CELL_PX * view.camera.width / 640
    shape = (int(view.camera.height // side) + 1, int(view.camera.width // side) + 1)
    cells = (pixels[known] // side).astype(np.int64)
    cell = cells[:, 1] * shape[1] + cells[:, 0]
    order = np.lexsort((depths[known], cell))
    counts = np.bincount(cell, minlength=shape[0] * shape[1])
    starts = np.cumsum(counts) - counts
    surface = np.full(shape[0] * shape[1], np.nan)
    full = counts >= CELL_POINTS
    surface[full] = depths[known][order][(starts + counts // 2)[full]]
    return surface.reshape(shape)
