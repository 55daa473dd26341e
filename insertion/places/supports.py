"""The support planes of a scene with their free space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_closing, binary_erosion

from estimator.geometry.planes import SupportPlane, refine_up, support_planes
from estimator.geometry.up import Up, camera_up
from estimator.records.scene import Scene
from insertion.scene.cloud import Cloud
from metric_base.arrays import BoolArray, FloatArray

__all__ = ["Supports", "cell_centres", "free_cells", "supports_of"]

#: A point this far above a plane, in standard deviations of its points, belongs to something that stands on it.
ABOVE_SIGMAS = 4.0
#: ... and at least this share of the object's height above it, so that a rough plane does not fill itself.
ABOVE_SHARE = 0.12


@dataclass(frozen=True, slots=True, eq=False)
class Supports:
    """Up and the level surfaces, lowest first."""

    up: Up
    planes: tuple[SupportPlane, ...]


def supports_of(scene: Scene) -> Supports:
    """The support planes of the scene's densest cloud."""
    points = scene.points if scene.dense is None else scene.dense.points
    up = refine_up(camera_up(scene.views), points)
    return Supports(up, support_planes(up.vector, points))


def cell_centres(plane: SupportPlane) -> FloatArray:
    """(a, b, 2) centres of the plane's cells in its basis."""
    rows, columns = np.indices(plane.cells.shape)
    return np.asarray(plane.origin + (np.stack([rows, columns], axis=-1) + 0.5) * plane.cell)


def free_cells(plane: SupportPlane, cloud: Cloud, radius: float, height: float) -> BoolArray:
    """(a, b) cells where an object's centre can be: its footprint lies on the surface and nothing is in its way.

    radius : half the diagonal of the footprint; height : of the object, scene units.
    """
    local = cloud.points @ plane.basis.T
    rise = local[:, 2] - plane.height
    over = (rise > max(ABOVE_SIGMAS * plane.sigma, ABOVE_SHARE * height)) & (rise < height)
    index = np.floor((local[over, :2] - plane.origin) / plane.cell).astype(np.int64)
    index = index[((index >= 0) & (index < plane.cells.shape)).all(axis=1)]
    taken = np.zeros(plane.cells.shape, dtype=bool)
    taken[tuple(index.T)] = True
    surface = binary_closing(np.pad(plane.cells, 2), iterations=2)[2:-2, 2:-2]
    return np.asarray(binary_erosion(surface & ~taken, _disc(radius / plane.cell)))


def _disc(cells: float) -> BoolArray:
    reach = int(np.ceil(cells))
    rows, columns = np.indices((2 * reach + 1, 2 * reach + 1)) - reach
    return np.asarray(rows**2 + columns**2 <= max(cells, 0.5) ** 2)
