"""A place: where an object stands and which way it looks, and the words of `--at` and `--facing` that ask for one.

Which way an object looks.
"""

from __future__ import annotations

import numpy as np

from insertion.request import Place
from insertion.scene.plane_cells import plane_patches
from insertion.scene.point_cloud import Cloud
from metric_base.arrays import FloatArray
from metric_base.errors import InputError

#: A plane whose normal's cosine with up is below this is upright; it is a wall if it spans this share of the scene's
#: own height, as a wall does between furniture and the pictures' upper border.
UPRIGHT, WALL_SHARE = 0.2, 0.4


class NoPlace(InputError):
    """There is nothing to stand on where the object was asked to stand; the message says why."""


def heading(place: Place, facing: float | str, cloud: Cloud) -> tuple[FloatArray, float]:
    """The horizontal unit direction (3,) of the object's front, and its angle in degrees.

    The angle is counted from the direction to the camera of the place, counter-clockwise seen from above. facing :
    `camera`, `wall` (the back to the nearest wall) or degrees. Raises NoPlace where there is no wall.
    """
    up = place.basis[2]
    to_camera = place.camera - place.position
    to_camera = to_camera - (to_camera @ up) * up
    length = float(np.linalg.norm(to_camera))
    front = to_camera / length if length > 1e-9 else place.basis[0]
    if facing == "camera":
        return front, 0.0
    if facing == "wall":
        away = _away_from_wall(place, cloud)
        angle = float(np.degrees(np.arctan2(np.cross(front, away) @ up, front @ away)))
        return away, angle
    return turn_about(front, up, float(facing)), float(facing)


def turn_about(front: FloatArray, up: FloatArray, degrees: float) -> FloatArray:
    """A horizontal direction (3,) turned counter-clockwise seen from above; up : (3,) unit vector."""
    angle = np.radians(degrees)
    return np.asarray(np.cos(angle) * front + np.sin(angle) * np.cross(up, front))


def _away_from_wall(place: Place, cloud: Cloud) -> FloatArray:
    """Horizontal unit direction (3,) away from the nearest wall: an upright plane of the cloud that is tall enough."""
    patches = plane_patches(cloud, place.camera[None])
    up = place.basis[2]
    low, high = np.percentile(cloud.points @ up, [2, 98])
    walls = []
    for number in np.unique(patches.plane):
        own = patches.plane == number
        normal, cells = patches.normals[own][0], patches.places[own]
        if abs(normal @ up) < UPRIGHT and np.ptp(cells @ up) > WALL_SHARE * (high - low):
            distance = float(np.abs((cells - place.position) @ normal).mean())
            walls.append((distance, normal))
    if not walls:
        raise NoPlace("--facing wall: expected a wall in the cloud; found no tall upright surface")
    normal = min(walls, key=lambda wall: wall[0])[1]
    flat = normal - (normal @ up) * up
    return np.asarray(flat / np.linalg.norm(flat))
