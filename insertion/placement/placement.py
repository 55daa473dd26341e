"""Position and orientation of an object on a support (`Placement`), and the scene as placement reads it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.records.scene import Instance, View
from insertion.scene.plane_cells import find_plane_cells
from insertion.scene.point_cloud import ColouredPoints
from insertion.scene.supports import SupportSurfaces, Surface
from metric_base.arrays import FloatArray
from metric_base.errors import InputError

#: Maximum cosine with up of the normal of a wall.
MAX_WALL_UP_COSINE = 0.2
#: Minimum height of a wall, as a fraction of the height of the scene: its visible part is between the furniture and the
#: upper border of the images.
MIN_WALL_HEIGHT = 0.4


class PlacementError(InputError):
    """An object cannot stand at the requested position."""


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Position of an object on a support."""

    position: FloatArray  #: (3,) bottom centre of the object, scene units
    basis: FloatArray  #: (3, 3) rows: two horizontal unit axes and up
    camera: FloatArray  #: (3,) centre of the camera that the position was chosen from
    support: str  #: name of the support for messages
    plane: int | None = None  #: index of the support plane, lowest first; None for a surface that is no support plane
    surface: Surface | None = None  #: extent of the surface, if `plane` is None and the extent is known


@dataclass(frozen=True, slots=True, eq=False)
class PlacementSpace:
    """The parts of a scene that placement reads."""

    views: tuple[View, ...]
    cloud: ColouredPoints
    supports: SupportSurfaces
    instances: tuple[Instance, ...]
    metres_per_unit: float


def heading(placement: Placement, facing: float | str, cloud: ColouredPoints) -> tuple[FloatArray, float]:
    """Compute the orientation of an object.

    Parameters
    ----------
    placement : Placement
        Position and camera.
    facing : float or str
        `camera`, `wall` (the back to the nearest wall), or degrees from the direction to the camera.
    cloud : ColouredPoints
        Points of the scene, for walls.

    Returns
    -------
    front : (3,) ndarray of float
        Horizontal unit direction of the front of the object.
    degrees : float
        Angle from the direction to the camera, counter-clockwise seen from above.

    Raises
    ------
    PlacementError
        The cloud has no wall.
    """
    up = placement.basis[2]
    to_camera = placement.camera - placement.position
    to_camera = to_camera - (to_camera @ up) * up
    length = float(np.linalg.norm(to_camera))
    front = to_camera / length if length > 1e-9 else placement.basis[0]
    if facing == "camera":
        return front, 0.0
    if facing == "wall":
        away = _away_from_wall(placement, cloud)
        angle = float(np.degrees(np.arctan2(np.cross(front, away) @ up, front @ away)))
        return away, angle
    return turn_about(front, up, float(facing)), float(facing)


def turn_about(front: FloatArray, up: FloatArray, degrees: float) -> FloatArray:
    """Rotate a horizontal direction (3,) counter-clockwise seen from above; `up` is a unit vector (3,)."""
    angle = np.radians(degrees)
    return np.asarray(np.cos(angle) * front + np.sin(angle) * np.cross(up, front))


def _away_from_wall(placement: Placement, cloud: ColouredPoints) -> FloatArray:
    """Return the horizontal unit direction (3,) away from the nearest wall, an upright plane of sufficient height."""
    cells = find_plane_cells(cloud, placement.camera[None])
    up = placement.basis[2]
    low, high = np.percentile(cloud.points @ up, [2, 98])
    walls = []
    for index in np.unique(cells.plane):
        on_plane = cells.plane == index
        normal, positions = cells.normals[on_plane][0], cells.positions[on_plane]
        is_upright = abs(normal @ up) < MAX_WALL_UP_COSINE
        if is_upright and np.ptp(positions @ up) > MIN_WALL_HEIGHT * (high - low):
            distance = float(np.abs((positions - placement.position) @ normal).mean())
            walls.append((distance, normal))
    if not walls:
        raise PlacementError("--facing wall: expected a wall in the cloud; found no tall upright surface")
    normal = min(walls, key=lambda wall: wall[0])[1]
    flat = normal - (normal @ up) * up
    return np.asarray(flat / np.linalg.norm(flat))
