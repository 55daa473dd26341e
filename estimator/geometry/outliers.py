"""Removal of outliers from an object's points: by neighbours, or by neighbours and isolation forest as in the paper.

What a mask takes in beside the object is thin and lies apart: flying points at outlines, a corner of the wall. What
belongs to it can lie apart as well (a chair's feet without its legs), so a cluster is dropped only when it is far and
small.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import label, uniform_filter

from estimator.geometry.extents import quantiles, surface_cells
from metric_base.arrays import BoolArray, FloatArray, IntArray

__all__ = ["forest_inliers", "neighbour_inliers"]

# Fewer points have no density to speak of.
MIN_POINTS = 20
# A cell of the grid holds about four points of the surface, its neighbourhood some 36.
POINTS_PER_CELL = 4
# A point whose neighbourhood holds under this share of what is usual flies alone. Edges have half of it, corners a
# quarter, a thin leg a tenth.
LONELY_SHARE = 0.06
# A cluster is dropped when it lies further from the main one than this share of the main one's diagonal, and is small:
# chairs lose the legs between seat and castors, which is about half the diagonal of what is left.
FAR_SHARE = 0.7
SMALL_SHARE = 0.1
# Cells along a side; a grid beyond this is the sign of a point at infinity, not of detail.
MAX_CELLS = 48
# Paper's own trim: scikit-learn's usual choices, as the paper gives none.
PAPER_NEIGHBOURS = 8
PAPER_SIGMAS = 2.0
PAPER_TREES = 100


def neighbour_inliers(points: FloatArray) -> BoolArray:
    """(n,) True for points (n, 3) that are neither alone nor in a small cluster far from the rest.

    Counts in a grid stand in for nearest neighbours: a tenth of the time of a tree of points.
    """
    if len(points) < MIN_POINTS:
        return np.ones(len(points), dtype=bool)
    cells, inside = surface_cells(points, POINTS_PER_CELL, MAX_CELLS)
    placed = cells if inside.all() else cells[inside]
    shape = tuple(placed.max(axis=0) + 1)
    flat: IntArray = (placed[:, 0] * shape[1] + placed[:, 1]) * shape[2] + placed[:, 2]
    counts = np.bincount(flat, minlength=int(np.prod(shape))).reshape(shape).astype(np.float32)
    around = uniform_filter(counts, 3, mode="constant").ravel()[flat] * 27
    usual = np.float32(quantiles(around, np.array([0.5]))[0])
    rows = np.flatnonzero(inside)
    dense = np.flatnonzero(around >= LONELY_SHARE * usual)
    near = _near_clusters(points, rows[dense], flat[dense], shape)
    kept = np.zeros(len(points), dtype=bool)
    kept[rows[dense]] = near
    return kept


def forest_inliers(points: FloatArray, seed: int = 0) -> BoolArray:
    """(n,) True for points (n, 3) that pass both of the paper's filters: nearest neighbours and isolation forest."""
    if len(points) < MIN_POINTS:
        return np.ones(len(points), dtype=bool)
    from scipy.spatial import cKDTree
    from sklearn.ensemble import IsolationForest

    distance = cKDTree(points).query(points, PAPER_NEIGHBOURS + 1)[0][:, 1:].mean(axis=1)
    close = distance <= distance.mean() + PAPER_SIGMAS * distance.std()
    forest = IsolationForest(n_estimators=PAPER_TREES, random_state=seed).fit(points[close])
    kept = close.copy()
    kept[close] = forest.predict(points[close]) > 0
    return np.asarray(kept, dtype=bool)


def _near_clusters(points: FloatArray, rows: IntArray, cells: IntArray, shape: tuple[int, ...]) -> BoolArray:
    """(m,) True for those of the points (n, 3) in rows (m,) that are in the main cluster or not both small and far.

    cells : (m,) place of each in the flat grid of `shape`.
    """
    grid = np.zeros(shape, dtype=bool)
    grid.ravel()[cells] = True
    names, count = label(grid, np.ones((3, 3, 3)))
    if count == 1:
        return np.ones(len(rows), dtype=bool)
    points, names = points.take(rows, axis=0), names.ravel()[cells]
    sizes = np.bincount(names, minlength=count + 1)
    main = points[names == sizes.argmax()]
    low, high = main.min(axis=0), main.max(axis=0)
    # distance of each point to the main cluster's box
    apart = np.linalg.norm(np.maximum(np.maximum(low - points, points - high), 0), axis=1)
    nearest = np.full(count + 1, np.inf)
    np.minimum.at(nearest, names, apart)
    far = nearest > FAR_SHARE * np.linalg.norm(high - low)
    dropped: BoolArray = far & (sizes < SMALL_SHARE * len(points))
    return np.asarray(~dropped[names])
