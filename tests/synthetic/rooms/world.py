"""Records of a synthetic world: objects, other surfaces and camera poses, in metres with z up."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from metric_base.arrays import FloatArray
from tests.synthetic.rooms.solids import Mesh

__all__ = ["Pinhole", "Placed", "Pose", "World", "pose_towards"]


@dataclass(frozen=True, slots=True, eq=False)
class Pinhole:
    """A pinhole camera with COLMAP's pixel coordinates (the centre of the upper left pixel is 0.5, 0.5)."""

    width: int = 640
    height: int = 480
    focal: float = 500.0  # 65 degrees horizontally, as the main camera of a phone in video mode


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Pose with x_camera = rotation @ x_world + translation; the camera looks along +z, with y down."""

    rotation: FloatArray
    translation: FloatArray

    @property
    def centre(self) -> FloatArray:
        """Camera centre (3,) in the world."""
        return np.asarray(-self.rotation.T @ self.translation)


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """An object in the world.

    category, label : true category, and label of the detector.
    size : (3,) length, width and height in metres, without tilt.
    mesh : surface in the world at frame 0.
    velocity : (3,) in metres per frame.
    support : track of the supporting object; None: the floor.
    no_foot : whether the lowest fifth has no points.
    """

    track: str
    category: str
    label: str
    size: FloatArray
    mesh: Mesh
    velocity: FloatArray = field(default_factory=lambda: np.zeros(3))
    tilt_deg: float = 0.0
    support: str | None = None
    no_foot: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """A synthetic world. In images of ids, objects have numbers from 1, and other surfaces have 0."""

    kind: str
    seed: int
    objects: tuple[Placed, ...]
    surfaces: Mesh
    poses: tuple[Pose, ...]
    camera: Pinhole = field(default_factory=Pinhole)


def pose_towards(centre: FloatArray, target: FloatArray, roll_rad: float = 0.0) -> Pose:
    """Return the pose of a camera at `centre` that looks at `target`, with a roll of `roll_rad`."""
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    level = np.stack([right, down, forward])
    c, s = np.cos(roll_rad), np.sin(roll_rad)
    rotation = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ level
    return Pose(rotation, -rotation @ centre)
