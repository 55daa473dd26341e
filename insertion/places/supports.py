"""The support surfaces of a scene with their free space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion

from estimator.geometry.planes import refine_up, support_planes
from estimator.geometry.up import Up, camera_up
from estimator.records.scene import Scene
from insertion.places.surface import Surface, surface_of
from insertion.scene.cloud import Cloud
from metric_base.arrays import BoolArray

__all__ = ["Supports", "free_cells", "supports_of"]

#: A point above a surface by less than this share of the object's height is the surface's own roughness.
ABOVE_SHARE = 0.08


@dataclass(frozen=True, slots=True, eq=False)
class Supports:
    """Up and the support surfaces, lowest first."""

    up: Up
    surfaces: tuple[Surface, ...]


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
