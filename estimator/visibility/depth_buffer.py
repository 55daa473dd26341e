"""Depth buffers of a cloud: what nearer points hide, and what a view sees around an object."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.sparse import csr_array

from estimator.records.scene import Camera, Scene, View
from estimator.visibility.sights import Sight, row_members, sight_of
from metric_base.arrays import FloatArray

__all__ = ["Surroundings", "unhidden", "views_by_depth"]

# A cell of the depth buffer should hold several points of a surface, else what lies behind shines through its gaps:
# with 8 points expected a cell is empty once in 3,000 (Poisson).
POINTS_PER_CELL = 8
# Coarsest and finest depth buffer, in cells along the longer image side. Under 24 an object is a cell or two; over 320
# a cell is two pixels of a video frame, which is finer than any dense cloud we are given.
CELLS_ALONG_SIDE = (24, 320)
# A point is hidden when it lies this share behind the nearest point of its cell. Surfaces seen at 20 degrees change
# depth by about this much within a cell; objects stand further than this in front of the wall.
DEPTH_TOLERANCE = 0.03
# Cotangent of the slant up to which one surface fills a cell, 20 degrees: in the coarse cells of a few thousand points
# an object's own far side is deeper than `DEPTH_TOLERANCE` and would be hidden by its near side.
SLANT = 2.75
# Cells of a depth picture along the image's width; holes in it are read as nothing there.
DEPTH_CELLS = 160
MAX_DEPTH_POINTS = 20_000


def unhidden(view: View, points: FloatArray, slant: float = 0.0) -> Sight:
    """The points (n, 3) that the view sees by a depth buffer of the cloud itself.

    The buffer's cells are as large as the cloud's density asks for; a point is kept when it lies within
    `DEPTH_TOLERANCE` of the nearest depth in its cell, or within what a surface of that slant (the cotangent of its
    angle to the line of sight) rises by across the cell.
    """
    sight = sight_of(view, points)
    if sight.rows.size == 0:
        return sight
    cell = _cell_size(view.camera, sight.rows.size)
    across = int(view.camera.width // cell) + 1
    columns, lines = (sight.pixels.T * (1 / cell)).astype(np.int64)
    cells = lines * across + columns
    # half the precision, and a twentieth of the time
    near = sight.depths.astype(np.float32)
    nearest = np.full(int(cells.max()) + 1, np.inf, dtype=np.float32)
    np.minimum.at(nearest, cells, near)
    # the first parameter of every camera model is a focal length in pixels
    tolerance = max(DEPTH_TOLERANCE, slant * cell / float(view.camera.params[0]))
    return sight.some(np.flatnonzero(near <= nearest[cells] * np.float32(1 + tolerance)))


def views_by_depth(views: Iterable[View], points: FloatArray) -> tuple[View, ...]:
    """The views of a reconstruction without observations, each observing the points (n, 3) that none hides from it."""
    sights = ((view, unhidden(view, points, SLANT)) for view in views)
    return tuple(replace(view, keypoints=sight.pixels, point_index=sight.rows) for view, sight in sights)


@dataclass(slots=True, eq=False)
class Surroundings:
    """What the views see around an object: the nearest cloud point per cell of each view, computed on demand.

    points : (n, 3) of a cloud of the scene; visibility : (v, n) sparse, 1 where the view sees the point; up : (3,).
    """

    scene: Scene
    points: FloatArray
    visibility: csr_array
    up: FloatArray
    _pictures: dict[int, tuple[FloatArray, FloatArray]] = field(default_factory=dict)

    def depths_and_heights(self, view: int, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(k,) depth and height along up of the nearest point at each pixel; depth is infinite where there is none."""
        if view not in self._pictures:
            self._pictures[view] = self._picture(view)
        depth, height = self._pictures[view]
        camera = self.scene.views[view].camera
        index = np.floor(pixels * (DEPTH_CELLS / camera.width)).astype(np.int64)
        inside = np.all((index >= 0) & (index < depth.shape[::-1]), axis=1)
        columns, lines = np.where(inside[:, None], index, 0).T
        return np.where(inside, depth[lines, columns], np.inf), height[lines, columns]

    def _picture(self, number: int) -> tuple[FloatArray, FloatArray]:
        """(h, w) depth and height of the nearest point in each cell of a view, scene units; infinite, 0 without."""
        view, rows = self.scene.views[number], row_members(self.visibility, number)
        points = self.points[rows[:: max(1, -(-len(rows) // MAX_DEPTH_POINTS))]]
        lines = int(view.camera.height * DEPTH_CELLS / view.camera.width) + 1
        depth, height = np.full((lines, DEPTH_CELLS), np.inf), np.zeros((lines, DEPTH_CELLS))
        sight = sight_of(view, points)
        # farthest first, so that the nearest is written last
        sight = sight.some(np.argsort(-sight.depths))
        cells = (sight.pixels * (DEPTH_CELLS / view.camera.width)).astype(np.int64)
        depth[cells[:, 1], cells[:, 0]] = sight.depths
        height[cells[:, 1], cells[:, 0]] = points[sight.rows] @ self.up
        return depth, height


def _cell_size(camera: Camera, count: int) -> float:
    """Side in pixels of a depth buffer's cell for `count` points in the image."""
    side = max(camera.width, camera.height)
    wanted = np.sqrt(camera.width * camera.height * POINTS_PER_CELL / count)
    return float(np.clip(wanted, side / CELLS_ALONG_SIDE[1], side / CELLS_ALONG_SIDE[0]))
