"""Pose of every frame of a capture, stored in `frame_poses.json` of the work folder.

Frames and units are those of `estimator.records.scene`: x_camera = rotation @ x_world + translation in scene units, +z
ahead, +y down, and COLMAP's pixels, in which (0.5, 0.5) is the centre of the upper left pixel. The world is that of
`sparse/0` in the same folder.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from estimator.projection.cameras import CAMERA_MODELS
from estimator.records.scene import Camera
from metric_base.arrays import FloatArray
from metric_base.errors import damage_as_field_error, expect, in_file
from metric_base.input_files import read_json
from metric_base.parsing import json_object

FILE_NAME = "frame_poses.json"
SCHEMA = "metric-tree/frame-poses/1"

#: Source of a pose: the reconstruction; points of the model that were tracked into the frame; interpolation between
#: its neighbours in time; `none` if the pose is unknown.
PoseOrigin = Literal["reconstructed", "localised", "interpolated", "none"]


@dataclass(frozen=True, slots=True, eq=False)
class FramePose:
    """Pose of one frame of the source."""

    index: int  #: Number in the source, from 0, in presentation order.
    time_s: float | None  #: Presentation time; None for images.
    name: str | None  #: File in `frames/`; None for a frame that was not chosen.
    origin: PoseOrigin
    rotation: FloatArray | None = None  #: (3, 3) world to camera; None if the origin is `none`.
    translation: FloatArray | None = None  #: (3,); None if the origin is `none`.
    check_px: float | None = None  #: Median error of points not used for the pose, in pixels of the source.
    n_points: int = 0  #: Number of points of the model that determine the pose.

    def __post_init__(self) -> None:
        shapes = [None if value is None else value.shape for value in (self.rotation, self.translation)]
        if shapes != ([None, None] if self.origin == "none" else [(3, 3), (3,)]):
            raise ValueError(f"frame {self.index}: rotation and translation do not fit the origin {self.origin!r}")

    @property
    def centre(self) -> FloatArray | None:
        """(3,) camera centre in the world, None without a pose."""
        if self.rotation is None or self.translation is None:
            return None
        return np.asarray(-self.rotation.T @ self.translation)


@dataclass(frozen=True, slots=True, eq=False)
class FramePoses:
    """Poses of all frames of a capture."""

    source: Path  #: Absolute path of the video or the folder of images.
    camera: Camera | None  #: Of the upright frames at full size; None for images of several sizes.
    turned_deg: int  #: Clockwise rotation that the container requests and that the upright frames have.
    frames: tuple[FramePose, ...]  #: In presentation order.


def scaled_camera(camera: Camera, width: int, height: int) -> Camera:
    """Return the camera for another image size: lengths in pixels are scaled, and the distortion is unchanged."""
    across, down = width / camera.width, height / camera.height
    factors = {"f": across, "fx": across, "cx": across, "fy": down, "cy": down}
    values = zip(CAMERA_MODELS[camera.model][1], camera.params, strict=True)
    params = np.array([value * factors.get(name, 1.0) for name, value in values])
    return Camera(camera.model, width, height, params)


def write_frame_poses(poses: FramePoses, file: Path) -> None:
    """Write the file; the caller ensures that it is complete or absent."""

    def encode(value: Any) -> Any:
        return str(value) if isinstance(value, Path) else value.tolist()

    document = {"schema": SCHEMA} | msgspec.to_builtins(poses, enc_hook=encode)
    file.write_text(json.dumps(document, allow_nan=False) + "\n", encoding="utf-8")


def read_frame_poses(file: Path) -> FramePoses:
    """Return the poses of a `frame_poses.json`, or of the one in a work folder.

    Raises
    ------
    InputError
        The file is missing, has another kind or version, or contains a wrong value.
    """

    def decode(kind: Any, value: Any) -> Any:
        return Path(value) if kind is Path else np.asarray(value, dtype=np.float64)

    file = file / FILE_NAME if file.is_dir() else file
    with in_file(file):
        record = json_object(read_json(file))
        expect(record.get("schema") == SCHEMA, "schema", SCHEMA, record.get("schema"))
        fields = "the fields of docs/reference/formats.md"
        with damage_as_field_error(fields, (ValueError, TypeError), str, field="frames"):  # of msgspec, too
            return msgspec.convert(record, FramePoses, dec_hook=decode)
