"""Confidence of a dimension as the paper defines it (section 4.2): how dense the ends are against the rest."""

from __future__ import annotations

import numpy as np

from metric_base.arrays import FloatArray, IntArray

__all__ = ["eta"]

# The paper's grid.
GRID = 8


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
