"""Dimensions of one object: its upright box, from the points that are left after outliers (paper section 4.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from estimator.geometry.extents import edges, end_quantiles, extent_sigma
from estimator.geometry.footprint import footprint_axes, smallest_rectangle_axes
from estimator.geometry.outliers import forest_inliers, neighbour_inliers
from metric_base.arrays import FloatArray, IntArray

__all__ = ["Dimensions", "Inliers", "dimensions", "eta", "inliers"]

# Extents of more points differ in the third digit and only take time.
MAX_OBJECT_POINTS = 6000


# The paper's grid.
GRID = 8


@dataclass(frozen=True, slots=True, eq=False)
class Inliers:
    """Points of an object after outliers: rows of the given ones, (n, 3) in the level basis."""

    rows: IntArray
    level: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Dimensions:
    """The upright box of one object.

    axes : (3, 3) unit rows along length, width and up; low, high : (3,) edges along them; edge_sigma : (2, 3) of the
    low and the high edges, as shares of the extents; eta : (3,); rows : the points it was taken from, as positions in
    the object's own; lowest : the height of the lowest of them.
    """

    axes: FloatArray
    low: FloatArray
    high: FloatArray
    edge_sigma: FloatArray
    eta: FloatArray
    rows: IntArray
    lowest: float

    @property
    def extents(self) -> FloatArray:
        """(3,) length, width, height in scene units."""
        return np.asarray(self.high - self.low)


def inliers(points: FloatArray, basis: FloatArray, outliers: Literal["neighbours", "forest"]) -> Inliers:
    """The points (n, 3) of an object that are left after outliers; `basis` (3, 3) has up as its last row."""
    rows = np.arange(0, len(points), max(1, -(-len(points) // MAX_OBJECT_POINTS)))
    # coordinate by coordinate in memory: what follows runs along one at a time
    level = np.asfortranarray(points.take(rows, axis=0) @ basis.T)
    kept = np.flatnonzero(forest_inliers(level) if outliers == "forest" else neighbour_inliers(level))
    return Inliers(rows[kept], level.T.take(kept, axis=1).T)


def dimensions(kept: Inliers, basis: FloatArray, blur: FloatArray, robust: bool = True) -> Dimensions:
    """The box of an object's inliers.

    blur : (3, 3) covariance of the noise of its points in the scene; robust : the rectangle by `footprint_axes`; else
    the paper's plain minimum rectangle. The extent rule is the same.
    """
    level = kept.level
    turn = footprint_axes(level[:, :2]) if robust else smallest_rectangle_axes(level[:, :2])
    axes = np.vstack([turn @ basis[:2], basis[2]])
    local = np.vstack([turn @ level[:, :2].T, level[:, 2]]).T
    noise = np.sqrt(np.einsum("ai,ij,aj->a", axes, blur, axes))
    ends = end_quantiles(local)
    low, high = edges(local, noise, ends)
    # length is the longer side
    if high[0] - low[0] < high[1] - low[1]:
        order = [1, 0, 2]
        axes, local, low, high, noise = axes[order], local[:, order], low[order], high[order], noise[order]
        ends = ends[:, order]
    lowest = local.min(axis=0)
    sigma = extent_sigma(local, high - low, noise, ends)
    return Dimensions(axes, low, high, sigma, eta(local, lowest, local.max(axis=0)), kept.rows, lowest[2])


def eta(points: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """(3,) confidence along each axis of points (n, 3) in the frame of their box from `low` to `high` (3,).

    Equations (paper section 4.2), N(G) the points in cell G of the 8 x 8 x 8 grid and M the cells that hold any: rho_g
    = sum N(G) / |M|; rho_head, rho_tail the same over the first and last layer across the axis; eta = sqrt(rho_head
    rho_tail) / rho_g. A layer without points has density 0. Points outside the box, which the extent rule cut off, are
    left out.
    """
    # (3, n) cells; the upper face belongs to the last one
    index = ((points - low) * (GRID / np.maximum(high - low, np.finfo(float).tiny))).T
    inside = ((index >= 0) & (index <= GRID)).all(axis=0)
    x, y, z = np.minimum((index if inside.all() else index[:, inside]).astype(np.int64), GRID - 1)
    counts: IntArray = np.bincount((x * GRID + y) * GRID + z, minlength=GRID**3).reshape(GRID, GRID, GRID)
    overall = _density(counts)
    if overall == 0:
        return np.zeros(3)
    ends = ((counts[0], counts[-1]), (counts[:, 0], counts[:, -1]), (counts[:, :, 0], counts[:, :, -1]))
    return np.array([(_density(head) * _density(tail)) ** 0.5 / overall for head, tail in ends])


def _density(counts: IntArray) -> float:
    """Mean of the counts (c,) of the cells that hold a point; 0 where none does."""
    held = np.count_nonzero(counts)
    return float(counts.sum()) / held if held else 0.0
