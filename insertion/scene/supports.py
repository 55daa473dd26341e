"""Support surfaces: horizontal planes of the cloud and their visible extent.

A plane of the cloud determines a height but not an extent: the armrests of a chair may be as high as the desk. A
position belongs to the surface if points on the plane are closer to it than the rays that pass through the plane on
their way from a camera to a point below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion
from scipy.spatial import cKDTree

from estimator.geometry.planes import floor_of, level_basis, support_planes, voxel_downsample
from estimator.geometry.vertical import camera_up, refine_up
from estimator.records.objects import SupportPlane, Up
from estimator.records.scene import Scene, View
from insertion.scene.point_cloud import ColouredPoints, visible_points
from metric_base.arrays import BoolArray, FloatArray

#: Number of cells of the map along one cell of the plane.
CELLS_PER_PLANE_CELL = 3
#: Half the thickness of a plane, in standard deviations of its points.
THICKNESS_SIGMAS = 4.0
#: Minimum of half the thickness, as a fraction of a cell of the plane.
MIN_THICKNESS_CELLS = 0.25
#: Minimum depth below the plane of the end of a ray that passes through it, in thicknesses.
MIN_DEPTH_BELOW = 3.0
#: Number of neighbours that decide on a cell, so that one stray point does not.
NEIGHBOURS = 3
#: Maximum distance of a solid cell from the points of the plane, in median distances between points.
MAX_SPACINGS = 6.0
#: Maximum number of points and of views for the rays.
MAX_POINTS, MAX_VIEWS = 30_000, 16
#: Maximum height of the surface's own roughness, as a fraction of the height of the object.
MAX_ROUGHNESS = 0.08


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The extent of a support plane. Cell (0, 0) starts at `origin`."""

    number: int  #: index of the plane, lowest first; -1 for a surface that is no support plane
    plane: SupportPlane
    origin: FloatArray  #: (2,) along the horizontal axes of the plane
    cell: float  #: side of a cell, scene units
    solid: BoolArray  #: (a, b) cells in which the surface exists
    obstacles: FloatArray  #: (n, 2) points above the plane, along its axes
    obstacle_heights: FloatArray  #: (n,) their heights above the plane, scene units

    def contains(self, local: FloatArray) -> BoolArray:
        """Return whether the surface exists at horizontal coordinates (n, 2) of its plane."""
        index = np.floor((np.nan_to_num(local, nan=1e12) - self.origin) / self.cell)
        inside: BoolArray = np.all((index >= 0) & (index < self.solid.shape), axis=1)
        index = np.where(inside[:, None], index, 0).astype(np.int64)
        return np.asarray(inside & self.solid[index[:, 0], index[:, 1]])

    @property
    def centre(self) -> FloatArray:
        """(2,) centre of the solid cells, along the axes of the plane."""
        return np.asarray(cell_centres(self.origin, self.cell, self.solid.shape)[self.solid].mean(axis=0))


@dataclass(frozen=True, slots=True, eq=False)
class SupportSurfaces:
    """The vertical and the support surfaces, lowest first."""

    up: Up
    surfaces: tuple[Surface, ...]

    @property
    def basis(self) -> FloatArray:
        """(3, 3) rows: two horizontal unit axes and up; those of the planes."""
        return self.surfaces[0].plane.basis if self.surfaces else level_basis(self.up.vector)

    def ground(self, cloud: ColouredPoints) -> Surface | None:
        """Return the floor, else the lowest surface; None without surfaces. Mirror images may lie below the floor."""
        floor = floor_of([surface.plane for surface in self.surfaces], cloud.points)
        return next((surface for surface in self.surfaces if floor is None or surface.plane is floor), None)


def support_surfaces(scene: Scene, cloud: ColouredPoints, up: Up | None = None) -> SupportSurfaces:
    """Find the support surfaces of a scene in its densest cloud.

    Parameters
    ----------
    up : Up, optional
        The vertical, if it is known; else it is estimated from the cameras and the planes.
    """
    clouds = [voxel_downsample(scene.points)]
    if scene.dense is not None:
        clouds.append(voxel_downsample(scene.dense.points))
    up = up or refine_up(camera_up(scene.views), clouds)
    planes = support_planes(up.vector, clouds[-1])
    return SupportSurfaces(up, tuple(surface_of(k, plane, cloud, scene.views) for k, plane in enumerate(planes)))


def surface_of(number: int, plane: SupportPlane, cloud: ColouredPoints, views: Sequence[View]) -> Surface:
    """Return the extent of a plane."""
    local = cloud.points @ plane.basis.T
    height = local[:, 2] - plane.height
    thickness = max(THICKNESS_SIGMAS * plane.sigma, MIN_THICKNESS_CELLS * plane.cell)
    on_plane = local[np.abs(height) < thickness, :2]
    above = height > thickness
    cell = plane.cell / CELLS_PER_PLANE_CELL
    shape = tuple(int(n) * CELLS_PER_PLANE_CELL for n in plane.cells.shape)
    solid = np.zeros(shape, dtype=bool)
    if len(on_plane) >= NEIGHBOURS:
        centres = cell_centres(plane.origin, cell, shape).reshape(-1, 2)
        to_point, spacing = _neighbour_distances(on_plane, centres)
        crossings = _ray_crossings(plane, cloud, views, MIN_DEPTH_BELOW * thickness)
        to_ray = np.full(len(centres), np.inf)
        if len(crossings) >= NEIGHBOURS:
            to_ray = _neighbour_distances(crossings, centres)[0]
        max_distance = max(MAX_SPACINGS * spacing, plane.cell)
        solid = ((to_point < to_ray) & (to_point < max_distance)).reshape(shape)
    return Surface(number, plane, plane.origin, cell, solid, local[above, :2], height[above])


def cell_centres(origin: FloatArray, cell: float, shape: tuple[int, ...]) -> FloatArray:
    """Return the centres (a, b, 2) of the cells of a map."""
    rows, columns = np.indices(shape)
    return np.asarray(origin + (np.stack([rows, columns], axis=-1) + 0.5) * cell)


def _neighbour_distances(points: FloatArray, centres: FloatArray) -> tuple[FloatArray, float]:
    """Return the distance (n,) of centres (n, 2) to the NEIGHBOURS-th nearest point, and the median spacing."""
    points = points[:: max(1, len(points) // MAX_POINTS)]
    tree = cKDTree(points)
    sample = points[:: max(1, len(points) // 2000)]
    spacing = float(np.median(tree.query(sample, k=min(NEIGHBOURS + 1, len(points)))[0][:, -1]))
    return np.asarray(tree.query(centres, k=[NEIGHBOURS])[0][:, 0]), spacing


def _ray_crossings(plane: SupportPlane, cloud: ColouredPoints, views: Sequence[View], depth: float) -> FloatArray:
    """Return where (m, 2) rays from cameras above a plane to points at least `depth` below cross the plane."""
    crossings = []
    step = max(1, len(cloud.points) // MAX_POINTS)
    thinned = ColouredPoints(cloud.points[::step], cloud.colours[::step], cloud.dense)
    for view in views[:: max(1, -(-len(views) // MAX_VIEWS))]:
        eye = plane.basis @ view.centre
        if eye[2] <= plane.height:
            continue
        ends = thinned.points[visible_points(view, thinned).rows] @ plane.basis.T
        ends = ends[ends[:, 2] < plane.height - depth]
        fraction = (eye[2] - plane.height) / (eye[2] - ends[:, 2])
        crossings.append(eye[:2] + fraction[:, None] * (ends[:, :2] - eye[:2]))
    return np.concatenate(crossings) if crossings else np.empty((0, 2))


def free_cells(surface: Surface, radius: float, height: float) -> BoolArray:
    """Return the cells (a, b) in which an object can be centred: its footprint is solid and free of obstacles.

    Parameters
    ----------
    radius : float
        Half the diagonal of the footprint, in scene units.
    height : float
        Height of the object, in scene units.
    """
    if 2 * radius / surface.cell > max(surface.solid.shape):  # larger than the surface
        return np.zeros_like(surface.solid)
    blocking = (surface.obstacle_heights > MAX_ROUGHNESS * height) & (surface.obstacle_heights < height)
    index = np.floor((surface.obstacles[blocking] - surface.origin) / surface.cell).astype(np.int64)
    index = index[((index >= 0) & (index < surface.solid.shape)).all(axis=1)]
    taken = np.zeros(surface.solid.shape, dtype=bool)
    taken[tuple(index.T)] = True
    free = np.pad(surface.solid & ~taken, 1)
    # the footprint: a disc of this radius in cells
    cells = radius / surface.cell
    extent = int(np.ceil(cells))
    rows, columns = np.indices((2 * extent + 1, 2 * extent + 1)) - extent
    return np.asarray(binary_erosion(free, rows**2 + columns**2 <= max(cells, 0.5) ** 2)[1:-1, 1:-1])
