"""Dimensions of one object: its box with one axis vertical, from the points that are left after outliers (paper section 4.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from estimator.confidence import eta
from estimator.extents import edges, extent_sigma, surface_noise
from estimator.footprint import footprint_axes, smallest_rectangle_axes
from estimator.outliers import forest_inliers, neighbour_inliers
from estimator.scene import FloatArray, IntArray

__all__ = ["MAX_OBJECT_POINTS", "Dimensions", "dimensions"]

# Extents of more points differ in the third digit and only take time.
MAX_OBJECT_POINTS = 6000


@dataclass(frozen=True, slots=True, eq=False)
class Dimensions:
    """The upright box of one object.

    axes : (3, 3) unit rows along length, width and up; low, high : (3,) edges along them; sigma : (3,) of log extents; eta : (3,);
    rows : the points that were kept, as positions in the given ones; noise : standard deviation of the surface.
    """

    axes: FloatArray
    low: FloatArray
    high: FloatArray
    sigma: FloatArray
    eta: FloatArray
    rows: IntArray
    noise: float

    @property
    def extents(self) -> FloatArray:
        """(3,) length, width, height in scene units."""
        return np.asarray(self.high - self.low)


def dimensions(
    points: FloatArray, basis: FloatArray, outliers: Literal["neighbours", "forest"] = "neighbours", robust: bool = True
) -> Dimensions:
    """The box of points (n, 3); `basis` (3, 3) has up as its last row.

    robust : the rectangle by `footprint_axes`; else the paper's plain minimum rectangle. The extent rule is the same.
    """
    step = max(1, -(-len(points) // MAX_OBJECT_POINTS))
    rows = np.arange(0, len(points), step)
    level = points[rows] @ basis.T
    kept = forest_inliers(level) if outliers == "forest" else neighbour_inliers(level)
    rows, level = rows[kept], level[kept]
    noise = surface_noise(level)
    turn = footprint_axes(level[:, :2]) if robust else smallest_rectangle_axes(level[:, :2])
    axes = np.vstack([turn @ basis[:2], basis[2]])
    local = np.column_stack([level[:, :2] @ turn.T, level[:, 2]])
    low, high = edges(local, noise)
    # length is the longer side
    if high[0] - low[0] < high[1] - low[1]:
        order = [1, 0, 2]
        axes, local, low, high = axes[order], local[:, order], low[order], high[order]
    return Dimensions(axes, low, high, extent_sigma(len(points), high - low, noise), eta(local, low, high), rows, noise)
