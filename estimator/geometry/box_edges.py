"""Boxes of objects as lines: corners, edges by axis, and how they fall into a picture."""

from __future__ import annotations

import numpy as np

from estimator.projection.cameras import project
from estimator.records.measured_object import Box
from estimator.records.scene import View
from metric_base.arrays import FloatArray, IntArray

__all__ = ["EDGES", "corners", "edge_axis", "projected_edges"]

#: (8, 3) signs of the corners along length, width, height.
_SIGNS = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=np.float64)
#: (12, 2) pairs of corners that differ in one sign: four edges along each axis, in the order of the axes.
EDGES: IntArray = np.array(
    [(a, b) for axis in range(3) for a in range(8) for b in [a + (1, 2, 4)[axis]] if not a & (1, 2, 4)[axis]]
)
#: Pieces that an edge is drawn in, so that a lens may bend it and a camera cut it.
_PIECES = 24


def corners(box: Box) -> FloatArray:
    """(8, 3) corners in the scene: centre + sum over the axes of +- extent / 2."""
    return np.asarray(box.centre + (_SIGNS * box.extents / 2) @ box.axes)


def edge_axis(edge: int) -> int:
    """Which axis (0 length, 1 width, 2 height) edge number `edge` runs along."""
    return edge // 4


def projected_edges(box: Box, view: View) -> FloatArray:
    """(12, pieces + 1, 2) pixels along each edge, NaN where it is behind the camera or beyond its lens."""
    ends = corners(box)[EDGES]  # (12, 2, 3)
    steps = np.linspace(0.0, 1.0, _PIECES + 1)[None, :, None]
    points = ends[:, None, 0] * (1 - steps) + ends[:, None, 1] * steps
    points_camera = points.reshape(-1, 3) @ view.rotation.T + view.translation
    return project(view.camera, points_camera).reshape(len(EDGES), _PIECES + 1, 2)
