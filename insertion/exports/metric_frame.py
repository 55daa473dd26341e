"""The coordinate frame of the exports: metres, +y up, origin at the foot of the first object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.records.scene import Camera
from insertion.footage.footage import IMAGE_SEQUENCE_RATE, Frame
from insertion.placement.placed_object import PlacedObject
from metric_base.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class MetricTransform:
    """x_metric = scale * rotation @ (x_scene - origin); rotation : (3, 3), its second row is up."""

    scale: float
    rotation: FloatArray
    origin: FloatArray

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return points (n, 3) of the scene in metres."""
        return np.asarray(self.scale * (points - self.origin) @ self.rotation.T)


@dataclass(frozen=True, slots=True, eq=False)
class CameraKeyframe:
    """The camera of a frame.

    Attributes
    ----------
    name : str
        Name of the frame.
    time_s : float
        Time since the first frame in seconds.
    camera : Camera
        Intrinsics and lens.
    matrix : (4, 4) ndarray of float
        Camera to metric frame, with the axes of OpenGL, glTF, USD, Blender and nerfstudio (x right, y up, looking
        along -z).
    """

    name: str
    time_s: float
    camera: Camera
    matrix: FloatArray


def metric_transform(objects: Sequence[PlacedObject]) -> MetricTransform:
    """Return the transform to the frame of the first object."""
    place = objects[0].placement
    one, two, up = place.basis
    return MetricTransform(objects[0].metres_per_unit, np.stack([one, up, -two]), place.position)


def camera_keyframes(frames: Sequence[Frame], transform: MetricTransform) -> list[CameraKeyframe]:
    """Return the cameras of all frames with a known pose."""
    keys = []
    for frame, time_s in zip(frames, _times(frames), strict=True):
        if frame.view is not None:
            matrix = np.eye(4)
            # the camera of COLMAP looks along +z with y down
            matrix[:3, :3] = transform.rotation @ frame.view.rotation.T @ np.diag([1.0, -1.0, -1.0])
            matrix[:3, 3] = transform(frame.view.centre[None])[0]
            keys.append(CameraKeyframe(frame.name, time_s, frame.view.camera, matrix))
    return keys


def frame_rate(frames: Sequence[Frame]) -> float:
    """Return the frame rate in frames per second, from the median interval."""
    steps = np.diff(_times(frames))
    return float(1 / np.median(steps)) if len(steps) and np.median(steps) > 0 else IMAGE_SEQUENCE_RATE


def _times(frames: Sequence[Frame]) -> list[float]:
    """Return the time of each frame since the first one in seconds."""
    return [frame.clock_s - frames[0].clock_s for frame in frames]


def keyframes_by_camera(keys: Sequence[CameraKeyframe]) -> list[tuple[Camera, list[CameraKeyframe]]]:
    """Return the keyframes of each camera in order of appearance; cameras with equal parameters are one."""
    lenses: dict[tuple[str, int, int, bytes], tuple[Camera, list[CameraKeyframe]]] = {}
    for key in keys:
        lens = key.camera
        same = (lens.model, lens.width, lens.height, lens.params.tobytes())
        lenses.setdefault(same, (lens, []))[1].append(key)
    return list(lenses.values())


def object_matrix(placed: PlacedObject, transform: MetricTransform) -> FloatArray:
    """Return the matrix (4, 4) from the file of the model to the metric frame."""
    low, high = placed.model.bounds if placed.playback is None else placed.playback.bounds
    foot = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
    matrix = np.eye(4)
    matrix[:3, :3] = placed.size.factor * transform.rotation @ placed.turn
    matrix[:3, 3] = transform(placed.placement.position[None])[0] - matrix[:3, :3] @ foot
    return matrix
