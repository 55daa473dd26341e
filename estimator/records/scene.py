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

from metric_base.arrays import BoolArray, FloatArray, IntArray
from metric_base.errors import InputError, Unquoted

#: Beyond this a coordinate has no digits left for an object beside the origin (and its square none to spare);
#: geocentric metres are 6e6, so no real model comes near.
MAX_COORDINATE = 1e12


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """Intrinsics in COLMAP's words: `model` is COLMAP's name (`PINHOLE`, `OPENCV`, ...), `params` its order."""

    model: str
    width: int
    height: int
    params: FloatArray

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise InputError.at("camera", "size", "a positive width and height", (self.width, self.height))
        if self.params.ndim != 1 or not np.isfinite(self.params).all():
            raise InputError.at("camera", "params", "a row of finite numbers", self.params.tolist())


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

    def __post_init__(self) -> None:
        if self.rotation.shape != (3, 3) or self.translation.shape != (3,):
            shapes = (self.rotation.shape, self.translation.shape)
            raise InputError.at(f"view {self.name!r}", "pose", "shapes (3, 3) and (3,)", shapes)
        if self.keypoints.shape != (len(self.point_index), 2):
            shown = (self.keypoints.shape, self.point_index.shape)
            raise InputError.at(f"view {self.name!r}", "keypoints", "shapes (m, 2) and (m,)", shown)

    @property
    def centre(self) -> FloatArray:
        """(3,) camera centre in the world."""
        return np.asarray(-self.rotation.T @ self.translation)


@dataclass(frozen=True, slots=True, eq=False)
class DenseCloud:
    """A dense cloud in the frame of the scene.

    points : (n, 3); visible_offsets : (n + 1,) and visible_views : (m,) say which rows of `Scene.views` see a
    point (compressed rows), or both are None where no visibility file is there. `path` is the file it came from,
    `file_views` the rows of `Scene.views` by the positions that its visibility file counts, None where these are
    the same.
    """

    points: FloatArray
    visible_offsets: IntArray | None = None
    visible_views: IntArray | None = None
    path: Path | None = None
    file_views: IntArray | None = None

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 3:
            raise InputError.at("dense cloud", "points", "shape (n, 3)", self.points.shape)
        if self.visible_offsets is not None and len(self.visible_offsets) != len(self.points) + 1:
            shown = len(self.visible_offsets)
            raise InputError.at("dense cloud", "visible_offsets", f"{len(self.points) + 1} rows", shown)


@dataclass(frozen=True, slots=True, eq=False)
class Instance:
    """One detection in one view.

    mask : (h, w) bool crop whose upper left pixel is `origin` (x, y) of the image at camera resolution.
    `from_box` marks a box that stands in for a mask: its border is not trusted.
    `track` is the annotation's own identity over frames where the file states one.
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
class InstanceSet:
    """The instances of a scene, and warnings about their files."""

    instances: tuple[Instance, ...]
    warnings: tuple[str, ...] = ()
    is_default: bool = False  #: The masks are those in the folder of the scene, which the caller did not name.


@dataclass(frozen=True, slots=True)
class SceneProblem:
    """A contradiction in a reconstruction, in its masks or in its vertical."""

    message: str  #: A sentence without a final period.
    is_fatal: bool = False  #: No scale follows from the scene; otherwise the message is a warning.


#: Where a scene comes from.
Format = Literal[
    "colmap-binary",
    "colmap-text",
    "opensfm",
    "memory",
    "nerfstudio",
    "bundler",
    "metashape",
    "realitycapture",
    "meshroom",
]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A reconstruction.

    path : the folder that was named; points : (n, 3) sparse points; views in the order of the model file;
    model_path : the folder of the model's own files, which may lie below `path` (`sparse/0`); observed : whether the
    model says which view sees which sparse point, rather than their order in depth.
    """

    path: Path
    format: Format
    views: tuple[View, ...]
    points: FloatArray
    dense: DenseCloud | None = None
    warnings: tuple[str, ...] = ()
    model_path: Path | None = None
    observed: bool = True

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 3:
            raise InputError.at(self.path, "points", "shape (n, 3)", self.points.shape)
        for view in self.views:
            rows = view.point_index
            if len(rows) and (rows.min() < 0 or rows.max() >= len(self.points)):
                shown = Unquoted(f"rows {rows.min()} to {rows.max()}")
                raise InputError.at(self.path, f"view {view.name!r}", f"rows of {len(self.points)} points", shown)
