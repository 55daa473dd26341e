"""What Blender is asked to do, in metres with +y up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.records.scene import Camera
from insertion.exports.metric_frame import CameraKeyframe, MetricTransform, object_matrix
from insertion.light.environment_map import Environment
from insertion.placement.placed_object import PlacedObject
from insertion.render.layers import window_behind
from insertion.scene.camera_rays import Window, focal_lengths
from insertion.scene.pixel_box import PixelBox
from metric_base.arrays import FloatArray
from metric_base.images import write_picture
from models3d.gltf.model_writer import write_gltf_model

#: Paths a pixel; the denoiser does the rest.
SAMPLES = 32
#: Half the side of the square that catches shadows, in sizes of the object.
CATCHER_SIZES = 8.0
#: Objects whose feet differ by less stand on one surface.
SAME_LEVEL_M = 0.01


def full_window(camera: Camera) -> Window:
    """The ideal picture behind the whole picture."""
    return window_behind(camera, PixelBox(0, 0, camera.width, camera.height))


def ideal_window(camera: Camera) -> Window:
    """The picture without its lens: the same size, focal lengths and principal point."""
    return Window(*focal_lengths(camera), 0, 0, camera.width, camera.height)


def insertion_job(
    objects: Sequence[PlacedObject],
    keys: Sequence[CameraKeyframe],
    transform: MetricTransform,
    environment: Environment,
    folder: Path,
    window_of: Callable[[Camera], Window] = full_window,
) -> dict[str, Any]:
    """Objects on shadow catchers under the environment; nothing is written yet (`out`, `blend`).

    window_of : what is seen by a camera: a picture with a margin that a lens is then bent over, or `ideal_window`.
    """
    return {
        "objects": [_object(item, transform, folder / f"model{number}.glb") for number, item in enumerate(objects)],
        "catchers": [
            {"corners": corners.tolist(), "albedo": support_albedo(environment)}
            for corners in _catchers(objects, transform)
        ],
        "environment": str(write_environment(environment, folder / "environment.hdr")),
        "window": _window(window_of(keys[0].camera)),
        "keys": [
            {
                "stem": f"{number:06d}",
                "time_s": key.time_s,
                "matrix": key.matrix.tolist(),
                "window": _window(window_of(key.camera)),
            }
            for number, key in enumerate(keys)
        ],
        "start_s": 0.0,
        "samples": SAMPLES,
    }


def _catchers(objects: Sequence[PlacedObject], transform: MetricTransform) -> list[FloatArray]:
    """(4, 3) corners in the metric frame of a rectangle under each object, one for all that stand equally high.

    That of a table is no larger than what was seen of it: beyond, it would shade what stands below.
    """
    levels: dict[int, FloatArray] = {}  # by the height in steps of SAME_LEVEL_M: x and y of two corners, and the height
    axes = objects[0].placement.basis
    for item in objects:
        x, y, height = axes @ item.placement.position
        reach = min([CATCHER_SIZES * item.body.unit, *(_as_far_as(item, other, axes) for other in objects)])
        low, high = np.array([x, y]) - reach, np.array([x, y]) + reach
        if item.placement.plane != 0 and item.surface is not None and item.surface.solid.any():
            cells = np.argwhere(item.surface.solid)
            low = np.maximum(low, item.surface.origin + cells.min(axis=0) * item.surface.cell)
            high = np.minimum(high, item.surface.origin + (cells.max(axis=0) + 1) * item.surface.cell)
        key = round(height * transform.scale / SAME_LEVEL_M)
        old = levels.get(key, np.array([*low, *high, height]))
        levels[key] = np.array([*np.minimum(old[:2], low), *np.maximum(old[2:4], high), old[4]])
    return [
        transform(np.array([[a, b, h], [c, b, h], [c, d, h], [a, d, h]]) @ axes) for a, b, c, d, h in levels.values()
    ]


def _as_far_as(item: PlacedObject, other: PlacedObject, axes: FloatArray) -> float:
    """How far the catcher under an object may reach, so that it does not cut into another that stands lower by little.

    axes : (3, 3) rows two horizontal axes and up. The result is in scene units.
    """
    way = axes @ (other.placement.position - item.placement.position)
    if not 0 < -way[2] < other.body.unit:
        return np.inf
    return max(float(np.abs(way[:2]).max()) - other.body.unit / 2, item.body.unit / 2)


def _window(window: Window) -> dict[str, float]:
    """An ideal camera in pixels counted from the corner of its window."""
    return {
        "width": window.width, "height": window.height, "fx": window.fx, "fy": window.fy,
        "cx": window.cx - window.x0, "cy": window.cy - window.y0,
    }  # fmt: skip


def _object(item: PlacedObject, transform: MetricTransform, posed: Path) -> dict[str, Any]:
    """A model with its matrix; one with animations is written to `posed` as it stands."""
    file = item.request.model
    if item.model.animations:
        write_gltf_model(posed, item.model)
        file = posed
    return {"file": str(file.resolve()), "matrix": object_matrix(item, transform).tolist()}


def support_albedo(environment: Environment) -> list[float]:
    """(3,) what the support reflects: the radiance below the object over the irradiance above it, 0.05 to 0.9."""
    below = environment.radiance[-8:].mean(axis=(0, 1))
    above = environment.irradiance(environment.basis[2])
    return [float(v) for v in np.clip(np.pi * below / np.maximum(above, 1e-6), 0.05, 0.9)]


def write_environment(environment: Environment, file: Path) -> Path:
    """The environment as a Radiance picture; Blender counts the azimuth the other way."""
    write_picture(file, np.ascontiguousarray(environment.radiance[:, ::-1, ::-1]))
    return file
