"""The synthetic world: placed objects, bare surfaces and the cameras that look at them, in metres with z up."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from metric_base.arrays import FloatArray
from tests.synthetic.rooms.solids import Mesh

__all__ = ["Pinhole", "Placed", "Pose", "World", "pose_towards"]


@dataclass(frozen=True, slots=True, eq=False)
class Pinhole:
    """An ideal camera; pixels are COLMAP's (the upper left pixel's centre is 0.5, 0.5)."""

    width: int = 640
    height: int = 480
    focal: float = 500.0  # 65 degrees across: a telephone's main camera in video


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """World to camera: x_camera = rotation @ x_world + translation, looking along +z, y down."""

    rotation: FloatArray
    translation: FloatArray

    @property
    def centre(self) -> FloatArray:
        """(3,) camera centre in the world."""
        return np.asarray(-self.rotation.T @ self.translation)


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """One object in the world.

    size : (3,) length, width, height in metres, true whatever its tilt; mesh : in the world at frame 0; `category` is
    what it is, `label` what the detector calls it; velocity : (3,) metres a frame; `support` is the track it stands on,
    None for the floor; `no_foot` says that its lowest fifth leaves no points.
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
    """Objects are numbered from 1 in images of ids; 0 is a bare surface."""

    kind: str
    seed: int
    objects: tuple[Placed, ...]
    surfaces: Mesh
    poses: tuple[Pose, ...]
    camera: Pinhole = field(default_factory=Pinhole)


def pose_towards(centre: FloatArray, target: FloatArray, roll_rad: float = 0.0) -> Pose:
    """The pose at `centre` looking at `target` with the horizon level but for `roll_rad`."""
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    level = np.stack([right, down, forward])
    c, s = np.cos(roll_rad), np.sin(roll_rad)
    rotation = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ level
    return Pose(rotation, -rotation @ centre)
