"""Confidence of a dimension as the paper defines it (section 4.2): how dense the ends are against the rest."""

from __future__ import annotations

import numpy as np

from estimator.scene import FloatArray, IntArray

__all__ = ["ETA_THRESHOLD", "eta"]

# The paper's grid, and the threshold of its example figure: below it a dimension is not used.
GRID = 8
ETA_THRESHOLD = 0.7


def eta(points: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """(3,) confidence along each axis of points (n, 3) in the frame of their box from `low` to `high` (3,).

    Equations (paper section 4.2), N(G) the points in cell G of the 8 x 8 x 8 grid and M the cells that hold any: rho_g
    = sum N(G) / |M|; rho_head, rho_tail the same over the first and last layer across the axis; eta = sqrt(rho_head
    rho_tail) / rho_g. A layer without points has density 0. Points outside the box, which the extent rule cut off, are
    left out.
    """
    index = np.floor((points - low) / np.maximum(high - low, np.finfo(float).tiny) * GRID).astype(np.int64)
    # the upper face belongs to the last cell
    index = np.where((points == high) & (index == GRID), GRID - 1, index)
    inside = ((index >= 0) & (index < GRID)).all(axis=1)
    flat = (index[inside, 0] * GRID + index[inside, 1]) * GRID + index[inside, 2]
    counts: IntArray = np.bincount(flat, minlength=GRID**3).reshape(GRID, GRID, GRID)
    overall = _density(counts)
    if overall == 0:
        return np.zeros(3)
    ends = [(np.moveaxis(counts, axis, 0)[0], np.moveaxis(counts, axis, 0)[-1]) for axis in range(3)]
    return np.array([np.sqrt(_density(head) * _density(tail)) / overall for head, tail in ends])


def _density(counts: IntArray) -> float:
    """Mean count of the cells that hold a point; 0 where none does."""
    held = np.count_nonzero(counts)
    return float(counts.sum()) / held if held else 0.0
