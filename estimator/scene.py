"""The one internal form of a reconstruction: cameras, views, points, instances. Frozen, checked at the door.

Frames and units: world and camera coordinates are in scene units of unknown metric size; a camera looks along
its +z axis, +x is right and +y is down (COLMAP's and OpenCV's convention). Pixels are COLMAP's: the centre of
the upper left pixel is (0.5, 0.5).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from crawler.faults import InputFault

__all__ = [
    "BadScene",
    "BoolArray",
    "Camera",
    "DenseCloud",
    "FloatArray",
    "Instance",
    "IntArray",
    "Scene",
    "View",
]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class BadScene(InputFault):
    """An input that cannot be read: one line with file, field, what was expected and what was found."""


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """Intrinsics in COLMAP's words: `model` is COLMAP's name (`PINHOLE`, `OPENCV`, ...), `params` its order."""

    model: str
    width: int
    height: int
    params: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One registered image.

    rotation : (3, 3) world to camera; translation : (3,), so that x_camera = rotation @ x_world + translation.
    keypoints : (m, 2) pixels of the observations that have a point; point_index : (m,) rows of `Scene.points`.
    """

    name: str
    camera: Camera
    rotation: FloatArray
    translation: FloatArray
    keypoints: FloatArray
    point_index: IntArray

    @property
    def centre(self) -> FloatArray:
        """(3,) camera centre in the world."""
        return np.asarray(-self.rotation.T @ self.translation)


@dataclass(frozen=True, slots=True, eq=False)
class DenseCloud:
    """A dense cloud in the frame of the scene.

    points : (n, 3); visible_offsets : (n + 1,) and visible_views : (m,) say which rows of `Scene.views` see a
    point (compressed rows), or both are None where no visibility file is there.
    """

    points: FloatArray
    visible_offsets: IntArray | None = None
    visible_views: IntArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Instance:
    """One detection in one view.

    mask : (h, w) bool crop whose upper left pixel is `origin` (x, y) of the image at camera resolution.
    `from_box` marks a box that stands in for a mask: its border is not trusted.
    `track` is the annotation's own identity over frames where the file states one; kept for evaluation only.
    """

    id: str
    view: int
    category: str
    mask: BoolArray
    origin: tuple[int, int]
    score: float = 1.0
    from_box: bool = False
    track: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A reconstruction. points : (n, 3) sparse points; views in the order of the model file."""

    path: Path
    format: Literal["colmap-binary", "colmap-text", "opensfm", "memory"]
    views: tuple[View, ...]
    points: FloatArray
    dense: DenseCloud | None = None
    warnings: tuple[str, ...] = ()
