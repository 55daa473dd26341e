"""The pose of every frame of a capture, kept in `frame_poses.json` of the work folder.

Frames and units are those of `estimator.records.scene`: x_camera = rotation @ x_world + translation in scene units, +z
ahead, +y down, and COLMAP's pixels, in which (0.5, 0.5) is the centre of the upper left pixel. The world is that of
`sparse/0` in the same folder.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from estimator.records.scene import Camera
from metric_base.arrays import FloatArray
from metric_base.errors import InputError, in_file
from metric_base.input_files import read_json
from metric_base.parsing import json_array, json_object

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


def write_frame_poses(poses: FramePoses, file: Path) -> None:
    """Write the file; the caller makes it whole or absent."""
    camera = poses.camera
    document = {
        "schema": SCHEMA,
        "source": str(poses.source),
        "turned_deg": poses.turned_deg,
        "camera": None
        if camera is None
        else {
            "model": camera.model,
            "width": camera.width,
            "height": camera.height,
            "params": [float(value) for value in camera.params],
        },
        "frames": [_row(pose) for pose in poses.frames],
    }
    file.write_text(json.dumps(document, allow_nan=False) + "\n", encoding="utf-8")


def read_frame_poses(file: Path) -> FramePoses:
    """The poses of a `frame_poses.json`, or of the one in a work folder.

    Raises
    ------
    InputError
        The file is missing, is of another kind or version, or a value in it is wrong.
    """
    file = file / FILE_NAME if file.is_dir() else file
    with in_file(file):
        document = json_object(read_json(file))
    if document.get("schema") != SCHEMA:
        raise InputError.at(file, "schema", SCHEMA, document.get("schema"))
    try:
        camera = _camera(document["camera"])
        with in_file(file):
            frames = tuple(_pose(json_object(row, "frames")) for row in json_array(document["frames"], "frames"))
        return FramePoses(Path(document["source"]), camera, int(document["turned_deg"]), frames)
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError.at(
            file, "frames", "the fields of docs/reference/formats.md", f"{type(error).__name__}: {error}"
        ) from None


def _row(pose: FramePose) -> dict[str, Any]:
    return {
        "index": pose.index,
        "time_s": pose.time_s,
        "name": pose.name,
        "origin": pose.origin,
        "rotation": None if pose.rotation is None else np.asarray(pose.rotation).tolist(),
        "translation": None if pose.translation is None else np.asarray(pose.translation).tolist(),
        "check_px": pose.check_px,
        "n_points": pose.n_points,
    }


def _camera(row: Any) -> Camera | None:
    if row is None:
        return None
    return Camera(row["model"], int(row["width"]), int(row["height"]), np.asarray(row["params"], dtype=np.float64))


def _pose(row: dict[str, Any]) -> FramePose:
    origin: PoseOrigin = row["origin"]
    if origin not in get_args(PoseOrigin):
        raise ValueError(f"origin {origin!r}")
    rotation, translation = _array(row["rotation"], (3, 3)), _array(row["translation"], (3,))
    if (rotation is None or translation is None) != (origin == "none"):
        raise ValueError(f"frame {row['index']}: a pose with origin {origin!r}")
    time_s, check_px = row["time_s"], row["check_px"]
    return FramePose(
        index=int(row["index"]),
        time_s=None if time_s is None else float(time_s),
        name=row["name"],
        origin=origin,
        rotation=rotation,
        translation=translation,
        check_px=None if check_px is None else float(check_px),
        n_points=int(row["n_points"]),
    )


def _array(value: Sequence[Any] | None, shape: tuple[int, ...]) -> FloatArray | None:
    """The value as an array of `shape`, (3, 3) or (3,), None of None; ValueError if it is no such array of numbers."""
    if value is None:
        return None
    array = np.asarray(value, dtype=np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"expected {shape} finite numbers")
    return array
