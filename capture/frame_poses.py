"""The pose of every frame of a capture, kept in `frame_poses.json` of the work folder.

Frames and units are those of `estimator.records.scene`: x_camera = rotation @ x_world + translation in scene units, +z
ahead, +y down, and COLMAP's pixels, in which (0.5, 0.5) is the centre of the upper left pixel. The world is that of
`sparse/0` in the same folder.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from estimator.records.scene import Camera
from metric_base.arrays import FloatArray
from metric_base.errors import InputError, in_file
from metric_base.input_files import read_json
from metric_base.parsing import json_object

FILE_NAME = "frame_poses.json"
SCHEMA = "metric-tree/frame-poses/1"

#: How a pose was obtained: by the reconstruction itself; from points of the model that were tracked into the frame;
#: between its neighbours in time; `none` where no pose is known.
PoseOrigin = Literal["reconstructed", "localised", "interpolated", "none"]


@dataclass(frozen=True, slots=True, eq=False)
class FramePose:
    """One frame of the source.

    index : its number in the source, from 0, in presentation order; time_s : its presentation time in seconds (None
    for pictures); name : its file in `frames/`, None for a frame of the video that was not chosen.
    rotation : (3, 3) world to camera; translation : (3,); both None where `origin` is `none`.
    check_px : median distance in pixels of the source between tracked points of the model that were not used for the
    pose and their projection, None where there are too few; n_points : points of the model that the pose rests on.
    """

    index: int
    time_s: float | None
    name: str | None
    origin: PoseOrigin
    rotation: FloatArray | None = None
    translation: FloatArray | None = None
    check_px: float | None = None
    n_points: int = 0

    @property
    def centre(self) -> FloatArray | None:
        """(3,) camera centre in the world, None without a pose."""
        if self.rotation is None or self.translation is None:
            return None
        return np.asarray(-self.rotation.T @ self.translation)


@dataclass(frozen=True, slots=True, eq=False)
class FramePoses:
    """All frames of one capture.

    source : the video or the folder of pictures, as an absolute path; camera : of the upright frames at the source's
    full size, one for all frames (None for pictures of several sizes); turned_deg : the clockwise rotation that the
    container asks for and that the upright frames have had applied; frames : in presentation order.
    """

    source: Path
    camera: Camera | None
    turned_deg: int
    frames: tuple[FramePose, ...]

    def at(self, frame: int | str) -> FramePose:
        """The frame with this index or file name; the suffix of the name may be missing.

        Raises
        ------
        KeyError
            No frame has it.
        """
        for pose in self.frames:
            if frame in (pose.index, pose.name) or (pose.name is not None and frame == Path(pose.name).stem):
                return pose
        if isinstance(frame, str) and frame.isdecimal():
            return self.at(int(frame))
        raise KeyError(frame)


class _Camera(msgspec.Struct):
    model: str
    width: int
    height: int
    params: list[float]


class _Pose(msgspec.Struct, kw_only=True):
    index: int
    time_s: float | None
    name: str | None
    origin: PoseOrigin
    rotation: list[list[float]] | None
    translation: list[float] | None
    check_px: float | None
    n_points: int


class _Document(msgspec.Struct, kw_only=True):
    """Layout of the file, as in docs/reference/formats.md."""

    schema: str
    source: str
    turned_deg: int
    camera: _Camera | None
    frames: list[_Pose]


def write_frame_poses(poses: FramePoses, file: Path) -> None:
    """Write the file; the caller makes it whole or absent."""
    camera = poses.camera
    document = {
        "schema": SCHEMA,
        "source": str(poses.source),
        "turned_deg": poses.turned_deg,
        "camera": None if camera is None else {**asdict(camera), "params": camera.params.tolist()},
        "frames": [
            {
                **asdict(pose),
                "rotation": None if pose.rotation is None else np.asarray(pose.rotation).tolist(),
                "translation": None if pose.translation is None else np.asarray(pose.translation).tolist(),
            }
            for pose in poses.frames
        ],
    }
    file.write_text(json.dumps(document, allow_nan=False) + "\n", encoding="utf-8")


def read_frame_poses(file: Path) -> FramePoses:
    """Return the poses of a `frame_poses.json`, or of the one in a work folder.

    Raises
    ------
    InputError
        The file is missing, is of another kind or version, or a value in it is wrong.
    """
    file = file / FILE_NAME if file.is_dir() else file
    with in_file(file):
        record = json_object(read_json(file))
    if record.get("schema") != SCHEMA:
        raise InputError.at(file, "schema", SCHEMA, record.get("schema"))
    try:
        document = msgspec.convert(record, _Document)
        frames = []
        for row in document.frames:
            rotation, translation = (
                None if value is None else np.asarray(value, dtype=np.float64)
                for value in (row.rotation, row.translation)
            )
            if (rotation is None or translation is None) != (row.origin == "none"):
                raise ValueError(f"frame {row.index}: a pose with origin {row.origin!r}")
            if (
                rotation is not None
                and translation is not None
                and (rotation.shape, translation.shape) != ((3, 3), (3,))
            ):
                raise ValueError(f"frame {row.index}: expected (3, 3) and (3,) numbers")
            pose = FramePose(row.index, row.time_s, row.name, row.origin, rotation, translation)
            frames.append(replace(pose, check_px=row.check_px, n_points=row.n_points))
    except ValueError as error:  # of msgspec, too
        raise InputError.at(file, "frames", "the fields of docs/reference/formats.md", str(error)) from None
    lens = document.camera
    camera = None if lens is None else Camera(lens.model, lens.width, lens.height, np.asarray(lens.params))
    return FramePoses(Path(document.source), camera, document.turned_deg, tuple(frames))
