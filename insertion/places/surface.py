"""Where a support plane is really there.

A plane of the cloud says at which height something is level, not how far it reaches: the armrests of a chair are as
high as the desk. A place belongs to the surface if points on the plane are nearer than rays that pass through the
plane on their way from a camera to something below it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from estimator.geometry.planes import SupportPlane
from estimator.records.scene import View
from insertion.scene.cloud import Cloud, front_points
from metric_base.arrays import BoolArray, FloatArray

__all__ = ["Surface", "cell_centres", "surface_of"]

#: Cells of the map along one cell of the plane's own.
FINER = 3
#: Half the thickness of a plane in standard deviations of its points, and at least this share of a cell.
THICK_SIGMAS, THICK_SHARE = 4.0, 0.25
#: A ray passes through the plane if it ends this many thicknesses below it.
BELOW = 3.0
#: The neighbours that decide, so that one stray does not.
NEIGHBOURS = 3
#: A place further from all points of the plane than this many times their usual spacing is not known to be solid.
SPACINGS = 6.0
MAX_POINTS, MAX_VIEWS = 30_000, 16


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The extent of a support plane.

    number : of the plane, lowest first; solid : (a, b) cells where it is there, cell (0, 0) starting at `origin` (2,)
    of the plane's horizontal axes, with side `cell`; taken : (n, 2) and rise : (n,) points above it, scene units.
    """

    number: int
    plane: SupportPlane
    origin: FloatArray
    cell: float
    solid: BoolArray
    taken: FloatArray
    rise: FloatArray

    def holds(self, local: FloatArray) -> BoolArray:
        """(n,) whether the surface is there at each of (n, 2) horizontal coordinates."""
        index = np.floor((np.nan_to_num(local, nan=1e12) - self.origin) / self.cell)
        inside: BoolArray = np.all((index >= 0) & (index < self.solid.shape), axis=1)
        index = np.where(inside[:, None], index, 0).astype(np.int64)
        return np.asarray(inside & self.solid[index[:, 0], index[:, 1]])


def surface_of(number: int, plane: SupportPlane, cloud: Cloud, views: Sequence[View]) -> Surface:
    """The surface of a plane."""
    local = cloud.points @ plane.basis.T
    rise = local[:, 2] - plane.height
    thick = max(THICK_SIGMAS * plane.sigma, THICK_SHARE * plane.cell)
    on = local[np.abs(rise) < thick, :2]
    over = rise > thick
    cell = plane.cell / FINER
    shape = tuple(int(n) * FINER for n in plane.cells.shape)
    if len(on) < NEIGHBOURS:
        return Surface(number, plane, plane.origin, cell, np.zeros(shape, dtype=bool), local[over, :2], rise[over])
    centres = cell_centres(plane.origin, cell, shape).reshape(-1, 2)
    to_point, spacing = _distance(on, centres)
    passing = _passing(plane, cloud, views, BELOW * thick)
    to_ray = _distance(passing, centres)[0] if len(passing) >= NEIGHBOURS else np.full(len(centres), np.inf)
    reach = max(SPACINGS * spacing, plane.cell)
    solid = ((to_point < to_ray) & (to_point < reach)).reshape(shape)
    return Surface(number, plane, plane.origin, cell, solid, local[over, :2], rise[over])


def cell_centres(origin: FloatArray, cell: float, shape: tuple[int, ...]) -> FloatArray:
    """(a, b, 2) centres of the cells of a map."""
    rows, columns = np.indices(shape)
    return np.asarray(origin + (np.stack([rows, columns], axis=-1) + 0.5) * cell)


def _distance(points: FloatArray, centres: FloatArray) -> tuple[FloatArray, float]:
    """(n,) distance to the NEIGHBOURS-th nearest point, and the usual distance between points."""
    points = points[:: max(1, len(points) // MAX_POINTS)]
    tree = cKDTree(points)
    sample = points[:: max(1, len(points) // 2000)]
    spacing = float(np.median(tree.query(sample, k=min(NEIGHBOURS + 1, len(points)))[0][:, -1]))
    return np.asarray(tree.query(centres, k=[NEIGHBOURS])[0][:, 0]), spacing


def _passing(plane: SupportPlane, cloud: Cloud, views: Sequence[View], below: float) -> FloatArray:
    """(m, 2) where rays from cameras above the plane to points below it pass through it."""
    hits = []
    step = max(1, len(cloud.points) // MAX_POINTS)
    thinner = Cloud(cloud.points[::step], cloud.colours[::step], cloud.dense)
    for view in views[:: max(1, -(-len(views) // MAX_VIEWS))]:
        eye = plane.basis @ view.centre
        if eye[2] <= plane.height:
            continue
        ends = thinner.points[front_points(view, thinner).rows] @ plane.basis.T
        ends = ends[ends[:, 2] < plane.height - below]
        share = (eye[2] - plane.height) / (eye[2] - ends[:, 2])
        hits.append(eye[:2] + share[:, None] * (ends[:, :2] - eye[:2]))
    return np.concatenate(hits) if hits else np.empty((0, 2))
