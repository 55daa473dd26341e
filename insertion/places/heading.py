"""Which way an object looks."""

from __future__ import annotations

import numpy as np

from insertion.places.place import NoPlace, Place
from insertion.scene.cloud import Cloud
from metric_base.arrays import FloatArray

__all__ = ["heading"]

#: A column of space is a wall if its points span this share of the scene's own height above the place.
WALL_SHARE = 0.35
_COLUMNS = 80


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
    angle = np.radians(float(facing))
    return np.asarray(np.cos(angle) * front + np.sin(angle) * np.cross(up, front)), float(facing)


def _away_from_wall(place: Place, cloud: Cloud) -> FloatArray:
    """(3,) horizontal unit direction away from the nearest wall: the normal of the nearest tall columns."""
    local = (cloud.points - place.position) @ place.basis.T
    low, high = np.percentile(local, [2, 98], axis=0)
    cell = float((high - low)[:2].max()) / _COLUMNS
    column = np.floor(local[:, :2] / cell).astype(np.int64)
    keys, group = np.unique(column, axis=0, return_inverse=True)
    top = np.full(len(keys), -np.inf)
    bottom = np.full(len(keys), np.inf)
    np.maximum.at(top, group.ravel(), local[:, 2])
    np.minimum.at(bottom, group.ravel(), local[:, 2])
    walls = (keys[top - bottom > WALL_SHARE * (high[2] - low[2])] + 0.5) * cell
    if len(walls) < 5:
        raise NoPlace("--facing wall: expected a wall in the cloud; found no tall upright surface")
    distance = np.linalg.norm(walls, axis=1)
    nearest = walls[distance.argmin()]
    around = walls[np.linalg.norm(walls - nearest, axis=1) < 6 * cell]
    normal = np.linalg.eigh(np.cov((around - around.mean(axis=0)).T) if len(around) > 2 else np.eye(2))[1][:, 0]
    if normal @ nearest > 0:
        normal = -normal
    return np.asarray(normal @ place.basis[:2])
