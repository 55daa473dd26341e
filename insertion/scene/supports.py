"""Where a support plane is really there.

A plane of the cloud says at which height something is level, not how far it reaches: the armrests of a chair are as
high as the desk. A place belongs to the surface if points on the plane are nearer than rays that pass through the
plane on their way from a camera to something below it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion
from scipy.spatial import cKDTree

from estimator.geometry.planes import floor_of, support_planes
from estimator.geometry.vertical import camera_up, refine_up
from estimator.records.objects import SupportPlane, Up
from estimator.records.scene import Scene, View
from insertion.scene.point_cloud import Cloud, front_points
from metric_base.arrays import BoolArray, FloatArray

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


#: A point above a surface by less than this share of the object's height is the surface's own roughness.
ABOVE_SHARE = 0.08


@dataclass(frozen=True, slots=True, eq=False)
class Supports:
    """Up and the support surfaces, lowest first."""

    up: Up
    surfaces: tuple[Surface, ...]

    def ground(self, cloud: Cloud) -> Surface | None:
        """What people stand on: the floor, which mirror images may lie below, else the lowest surface; None without."""
        floor = floor_of([surface.plane for surface in self.surfaces], cloud.points)
        return next((one for one in self.surfaces if floor is None or one.plane is floor), None)


def supports_of(scene: Scene, cloud: Cloud, up: Up | None = None) -> Supports:
    """The support surfaces of the scene's densest cloud; `up` as it is known, else by the cameras and the planes."""
    points = scene.points if scene.dense is None else scene.dense.points
    up = up or refine_up(camera_up(scene.views), points)
    planes = support_planes(up.vector, points)
    return Supports(up, tuple(surface_of(k, plane, cloud, scene.views) for k, plane in enumerate(planes)))


def free_cells(surface: Surface, radius: float, height: float) -> BoolArray:
    """(a, b) cells where an object's centre can be: its footprint is on the surface and nothing is in its way.

    radius : half the diagonal of the footprint; height : of the object, scene units.
    """
    if 2 * radius / surface.cell > max(surface.solid.shape):  # larger than the surface
        return np.zeros_like(surface.solid)
    near = (surface.rise > ABOVE_SHARE * height) & (surface.rise < height)
    index = np.floor((surface.taken[near] - surface.origin) / surface.cell).astype(np.int64)
    index = index[((index >= 0) & (index < surface.solid.shape)).all(axis=1)]
    taken = np.zeros(surface.solid.shape, dtype=bool)
    taken[tuple(index.T)] = True
    free = np.pad(surface.solid & ~taken, 1)
    return np.asarray(binary_erosion(free, _disc(radius / surface.cell))[1:-1, 1:-1])


def _disc(cells: float) -> BoolArray:
    """(s, s) disc of this radius in cells."""
    reach = int(np.ceil(cells))
    rows, columns = np.indices((2 * reach + 1, 2 * reach + 1)) - reach
    return np.asarray(rows**2 + columns**2 <= max(cells, 0.5) ** 2)
