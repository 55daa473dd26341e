"""The footprint of an object: the rectangle of least area in the ground plane (paper section 4.2), robustly.

The paper takes the minimum bounding box. From one corner of a box only two faces are seen, an L, and the rectangle
along its hypotenuse has exactly the area of the right one; so between rectangles of nearly the same area the one whose
sides the points lie closer to is taken (the closeness of L-shape fitting in laser scans). And the area is that of the
extent rule, so that one flying point does not turn the box.
"""

from __future__ import annotations

import numpy as np

from metric_base.arrays import FloatArray

__all__ = ["footprint_axes", "smallest_rectangle_axes"]

COARSE_DEG, FINE_DEG = 7.5, 1.5
# Points that decide the direction; one degree needs no more.
MAX_POINTS = 200
# Shares cut off on either side while the direction is sought.
TRIM = 0.02
# Weight of closeness against log area: a rectangle whose points lie a tenth of its size further inside must be an
# eighth smaller.
CLOSENESS_WEIGHT = 1.2


def footprint_axes(points: FloatArray) -> FloatArray:
    """(2, 2) unit rows along and across the best rectangle about points (n, 2).

    Cost of an angle: log(a b) + w mean(distance to the nearest side) / sqrt(a b), with a, b the extents at that angle.
    """
    thin = points[:: max(1, -(-len(points) // MAX_POINTS))]
    coarse = np.arange(0.0, 90.0, COARSE_DEG)
    best = coarse[int(_costs(thin, coarse).argmin())]
    fine = best + np.arange(-COARSE_DEG + FINE_DEG, COARSE_DEG, FINE_DEG)
    return _axes(float(fine[int(_costs(thin, fine).argmin())]))


def smallest_rectangle_axes(points: FloatArray) -> FloatArray:
    """(2, 2) unit rows of the paper's minimum bounding rectangle of points (n, 2), all of them."""
    import cv2

    return _axes(float(cv2.minAreaRect(points.astype(np.float32))[2]))


def _axes(degrees: float) -> FloatArray:
    """(2, 2) axes as rows, turned by an angle."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[cosine, sine], [-sine, cosine]])


def _costs(points: FloatArray, degrees: FloatArray) -> FloatArray:
    """(k,) cost of the rectangle at each angle."""
    angles = np.radians(degrees)
    # (2, k, 2) axes at each angle, (2, k, n) coordinates along them
    axes = np.array([[np.cos(angles), np.sin(angles)], [-np.sin(angles), np.cos(angles)]]).transpose(0, 2, 1)
    along = axes @ points.T
    cut = int(TRIM * points.shape[0])
    ordered = np.partition(along, (cut, -1 - cut), axis=-1)
    low, high = ordered[..., cut], ordered[..., -1 - cut]
    sides = np.maximum(high - low, np.finfo(float).tiny)
    # (2, k, n) distance of each point to the nearer of the two sides across the axis
    apart = np.minimum(np.abs(along - low[..., None]), np.abs(along - high[..., None]))
    size = np.sqrt(sides[0] * sides[1])
    return np.asarray(2 * np.log(size) + CLOSENESS_WEIGHT * apart.min(axis=0).mean(axis=-1) / size)
