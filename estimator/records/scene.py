"""A reconstruction (`Scene`) with its cameras, views, points and instances, validated when it is constructed.

World and camera coordinates are in scene units of unknown metric size. A camera looks along its +z axis, +x is right
and +y is down, as in COLMAP and OpenCV. The centre of the upper left pixel is (0.5, 0.5), as in COLMAP.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from metric_base.arrays import BoolArray, FloatArray, IntArray
from metric_base.errors import InputError, Unquoted

#: Maximum absolute coordinate. Larger ones have no digits left for an object near the origin; geocentric coordinates
#: are 6e6 metres.
MAX_COORDINATE = 1e12


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """Intrinsics of a camera."""

    model: str  #: Name in COLMAP, such as `PINHOLE` or `OPENCV`.
    width: int
    height: int
    params: FloatArray  #: (p,) in the order of COLMAP; the first is a focal length in pixels.

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise InputError.at("camera", "size", "a positive width and height", (self.width, self.height))
        if self.params.ndim != 1 or not np.isfinite(self.params).all():
            raise InputError.at("camera", "params", "a row of finite numbers", self.params.tolist())

    @property
    def focal_px(self) -> float:
        """Focal length in pixels; that along x if the model has two."""
        return float(self.params[0])


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One registered image, with x_camera = rotation @ x_world + translation."""

    name: str
    camera: Camera
    rotation: FloatArray  #: (3, 3) from world to camera.
    translation: FloatArray  #: (3,)
    keypoints: FloatArray  #: (m, 2) pixels of the observations that have a point.
    point_index: IntArray  #: (m,) indices of these points in `Scene.points`.

    def __post_init__(self) -> None:
        if self.rotation.shape != (3, 3) or self.translation.shape != (3,):
            shapes = (self.rotation.shape, self.translation.shape)
            raise InputError.at(f"view {self.name!r}", "pose", "shapes (3, 3) and (3,)", shapes)
        if self.keypoints.shape != (len(self.point_index), 2):
            shown = (self.keypoints.shape, self.point_index.shape)
            raise InputError.at(f"view {self.name!r}", "keypoints", "shapes (m, 2) and (m,)", shown)

    @property
    def centre(self) -> FloatArray:
        """Camera centre (3,) in the world."""
        return np.asarray(-self.rotation.T @ self.translation)

    def to_camera(self, points: FloatArray) -> FloatArray:
        """Transform points (n, 3) from the world to the frame of the camera."""
        return np.asarray(points @ self.rotation.T + self.translation)


def camera_centres(views: Iterable[View]) -> FloatArray:
    """Return the camera centres (n, 3) of views."""
    return np.array([view.centre for view in views])


@dataclass(frozen=True, slots=True, eq=False)
class DenseCloud:
    """A dense cloud in the frame of the scene."""

    points: FloatArray  #: (n, 3)
    #: (n + 1,) offsets in `visible_views` (compressed rows) of the views that see each point; None if unknown.
    visible_offsets: IntArray | None = None
    visible_views: IntArray | None = None  #: (m,) indices in `Scene.views`.
    path: Path | None = None  #: File of the cloud.
    file_views: IntArray | None = None  #: Index in `Scene.views` of each view of the visibility file; None if equal.

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 3:
            raise InputError.at("dense cloud", "points", "shape (n, 3)", self.points.shape)
        if self.visible_offsets is not None and len(self.visible_offsets) != len(self.points) + 1:
            shown = len(self.visible_offsets)
            raise InputError.at("dense cloud", "visible_offsets", f"{len(self.points) + 1} rows", shown)


@dataclass(frozen=True, slots=True, eq=False)
class Instance:
    """One detection in one view."""

    id: str
    view: int  #: Index in `Scene.views`.
    category: str
    mask: BoolArray  #: (h, w) crop of the mask at the resolution of the camera.
    origin: tuple[int, int]  #: x and y of the upper left pixel of the crop.
    score: float = 1.0
    from_box: bool = False  #: The mask is the box of a detector, whose border is not that of the object.
    track: str | None = None  #: Identity over frames in the annotation, if it contains one.


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
    is_doubtful: bool = False  #: The scale is `uncertain`, however well the objects agree.


#: Source of a scene.
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
    "gaussian-splatting",
    "network",
    "photograph",
]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A reconstruction."""

    path: Path  #: Folder that the user named.
    format: Format
    views: tuple[View, ...]  #: In the order of the model file.
    points: FloatArray  #: (n, 3) sparse points.
    dense: DenseCloud | None = None
    warnings: tuple[str, ...] = ()
    model_path: Path | None = None  #: Folder of the files of the model, such as `sparse/0` below `path`.
    observed: bool = True  #: The model contains the observations; otherwise they are inferred from depth.
    network: str = ""  #: Network that wrote the files, if they show it.
    file_units: float = 1.0  #: Units of the files of the cameras per scene unit; not 1 in the frame of a splat.

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 3:
            raise InputError.at(self.path, "points", "shape (n, 3)", self.points.shape)
        for view in self.views:
            rows = view.point_index
            if len(rows) and (rows.min() < 0 or rows.max() >= len(self.points)):
                shown = Unquoted(f"rows {rows.min()} to {rows.max()}")
                raise InputError.at(self.path, f"view {view.name!r}", f"rows of {len(self.points)} points", shown)


def observed_views(views: Sequence[View], rows: IntArray, point_rows: IntArray, pixels: FloatArray) -> tuple[View, ...]:
    """Return views with observations: `rows` (m,) of views, `point_rows` (m,) of points, and `pixels` (m, 2)."""
    order = np.argsort(rows, kind="stable")
    parts = np.split(order, np.searchsorted(rows[order], np.arange(1, len(views))))
    return tuple(
        replace(view, keypoints=pixels[part], point_index=point_rows[part])
        for view, part in zip(views, parts, strict=True)
    )
