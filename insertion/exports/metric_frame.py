"""The frame of the exports: metres, +y up, the first object's foot at the origin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.records.scene import Camera, View
from insertion.footage.footage import STILLS_RATE, Frame
from insertion.placement.placed_object import PlacedObject
from metric_base.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class MetricTransform:
    """x_metric = scale * rotation @ (x_scene - origin); rotation : (3, 3), its second row is up."""

    scale: float
    rotation: FloatArray
    origin: FloatArray

    def __call__(self, points: FloatArray) -> FloatArray:
        """(n, 3) points of the scene in metres."""
        return np.asarray(self.scale * (points - self.origin) @ self.rotation.T)


@dataclass(frozen=True, slots=True, eq=False)
class CameraKeyframe:
    """The camera of one picture.

    time_s : seconds since the first picture; camera : its lens; matrix : (4, 4) camera to metric frame with OpenGL's
    axes (x right, y up, looking along -z), as glTF, USD, Blender and nerfstudio have them.
    """

    name: str
    time_s: float
    camera: Camera
    matrix: FloatArray


def metric_transform(objects: Sequence[PlacedObject], metres_per_unit: float) -> MetricTransform:
    """The frame about the first object."""
    place = objects[0].placement
    one, two, up = place.basis
    return MetricTransform(metres_per_unit, np.stack([one, up, -two]), place.position)


def camera_keyframes(frames: Sequence[Frame], transform: MetricTransform) -> list[CameraKeyframe]:
    """The cameras of all pictures with a known pose."""
    times = _times(frames)
    return [
        _key(frame, frame.view, time_s, transform)
        for frame, time_s in zip(frames, times, strict=True)
        if frame.view is not None
    ]


def frame_rate(frames: Sequence[Frame]) -> float:
    """Pictures a second: the usual one of a video whose rate varies."""
    steps = np.diff(_times(frames))
    return float(1 / np.median(steps)) if len(steps) and np.median(steps) > 0 else STILLS_RATE


def _times(frames: Sequence[Frame]) -> list[float]:
    """Seconds of each picture since the first."""
    return [frame.clock_s - frames[0].clock_s for frame in frames]


def keyframes_by_camera(keys: Sequence[CameraKeyframe]) -> list[tuple[Camera, list[CameraKeyframe]]]:
    """The keys of each lens, in the order in which the lenses come; lenses of the same numbers are one."""
    lenses: dict[tuple[str, int, int, bytes], tuple[Camera, list[CameraKeyframe]]] = {}
    for key in keys:
        lens = key.camera
        same = (lens.model, lens.width, lens.height, lens.params.tobytes())
        lenses.setdefault(same, (lens, []))[1].append(key)
    return list(lenses.values())


def object_matrix(placed: PlacedObject, transform: MetricTransform) -> FloatArray:
    """(4, 4) from the model's file (its own metres) to the metric frame: turned, sized and moved."""
    low, high = placed.model.bounds if placed.playback is None else placed.playback.bounds
    foot = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
    matrix = np.eye(4)
    matrix[:3, :3] = placed.size.factor * transform.rotation @ placed.turn
    matrix[:3, 3] = transform(placed.placement.position[None])[0] - matrix[:3, :3] @ foot
    return matrix


def _key(frame: Frame, view: View, time_s: float, transform: MetricTransform) -> CameraKeyframe:
    matrix = np.eye(4)
    # COLMAP's camera looks along +z with y down
    matrix[:3, :3] = transform.rotation @ view.rotation.T @ np.diag([1.0, -1.0, -1.0])
    matrix[:3, 3] = transform(view.centre[None])[0]
    return CameraKeyframe(frame.name, time_s, view.camera, matrix)
