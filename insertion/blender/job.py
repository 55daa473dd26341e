"""The job for Blender: models, shadow catchers, environment and cameras, in metres with +y up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.records.scene import Camera
from insertion.exports.metric_frame import MetricTransform, camera_keyframes, metric_transform, object_matrix
from insertion.footage.footage import Frame
from insertion.light.environment_map import Environment
from insertion.placement.placed_object import PlacedObject
from insertion.render.layers import window_behind
from insertion.scene.camera_rays import Window, focal_lengths
from insertion.scene.pixel_box import PixelBox
from metric_base.arrays import FloatArray
from metric_base.images import write_image
from models3d.gltf.model_writer import write_gltf_model

#: Number of samples per pixel; a denoiser removes the remaining noise.
SAMPLES = 32
#: Half the side of a shadow catcher relative to the size of the object.
CATCHER_SIZES = 8.0
#: Maximum difference in height of objects on the same shadow catcher, in metres.
MAX_LEVEL_DIFFERENCE_M = 0.01


def full_window(camera: Camera) -> Window:
    """Return the window of the undistorted image that contains the complete image."""
    return window_behind(camera, PixelBox(0, 0, camera.width, camera.height))


def ideal_window(camera: Camera) -> Window:
    """Return a window without lens distortion, with the size, focal lengths and principal point of the image."""
    return Window(*focal_lengths(camera), 0, 0, camera.width, camera.height)


def insertion_job(
    objects: Sequence[PlacedObject],
    frames: Sequence[Frame],
    environment: Environment,
    folder: Path,
    window_of: Callable[[Camera], Window] = full_window,
) -> dict[str, Any]:
    """Return the job for objects on shadow catchers in an environment, without outputs (`out`, `blend`).

    Parameters
    ----------
    objects : sequence of PlacedObject
        The objects. Those with animations are written to `folder` in their current pose.
    frames : sequence of Frame
        Frames; those with a pose have a camera.
    environment : Environment
        The light.
    folder : Path
        Folder for the models and the environment.
    window_of : callable, optional
        Returns the window of a camera: with the margin that distortion needs (default), or `ideal_window`.
    """
    transform = metric_transform(objects)
    keys, models = camera_keyframes(frames, transform), []
    albedo = support_albedo(environment)
    for index, item in enumerate(objects):
        file = item.request.model
        if item.model.animations:  # the pose of the first frame
            file = folder / f"model{index}.glb"
            write_gltf_model(file, item.model)
        models.append({"file": str(file.resolve()), "matrix": object_matrix(item, transform).tolist()})
    return {
        "objects": models,
        "catchers": [{"corners": corners.tolist(), **albedo} for corners in catcher_corners(objects, transform)],
        "environment": str(write_environment(environment, folder / "environment.hdr")),
        "window": _window(window_of(keys[0].camera)),
        "keys": [
            {
                "stem": f"{index:06d}",
                "time_s": key.time_s,
                "matrix": key.matrix.tolist(),
                "window": _window(window_of(key.camera)),
            }
            for index, key in enumerate(keys)
        ],
        "start_s": 0.0,
        "samples": SAMPLES,
    }


def catcher_corners(objects: Sequence[PlacedObject], transform: MetricTransform) -> list[FloatArray]:
    """Return corners (4, 3) in the metric frame of a rectangle for each height at which objects stand.

    Above the floor, a rectangle is limited to the visible extent of the surface; beyond, it would shade lower objects.
    Objects at one height share a rectangle unless it would be above a lower object, which it would cut.
    """
    levels: dict[int, list[FloatArray]] = {}  # x and y of two corners, and the height, by the height in steps
    axes, min_drop = objects[0].placement.basis, MAX_LEVEL_DIFFERENCE_M / transform.scale
    for item in objects:
        x, y, height = axes @ item.placement.position
        reach = CATCHER_SIZES * item.body.unit
        lower = [other for other in objects if axes[2] @ other.placement.position < height - min_drop]
        for other in lower:
            distance = float(np.abs(axes[:2] @ (other.placement.position - item.placement.position)).max())
            reach = min(reach, max(distance - other.body.unit / 2, item.body.unit / 2))
        low, high = np.array([x, y]) - reach, np.array([x, y]) + reach
        if item.placement.plane != 0 and item.surface is not None and item.surface.solid.any():
            cells = np.argwhere(item.surface.solid)
            low = np.maximum(low, item.surface.origin + cells.min(axis=0) * item.surface.cell)
            high = np.minimum(high, item.surface.origin + (cells.max(axis=0) + 1) * item.surface.cell)
        level = levels.setdefault(round(height / min_drop), [])
        old = level[-1] if level else np.array([*low, *high, height])
        union = np.array([*np.minimum(old[:2], low), *np.maximum(old[2:4], high), old[4]])
        feet = np.array([axes[:2] @ other.placement.position for other in lower]).reshape(-1, 2)
        radii = np.array([other.body.unit / 2 for other in lower])[:, None]
        is_above = ((feet > union[:2] - radii) & (feet < union[2:4] + radii)).all(axis=1).any()
        level[-1:] = [*level[-1:], np.array([*low, *high, height])] if level and is_above else [union]
    return [
        transform(np.array([[a, b, h], [c, b, h], [c, d, h], [a, d, h]]) @ axes)
        for level in levels.values()
        for a, b, c, d, h in level
    ]


def _window(window: Window) -> dict[str, float]:
    """Return an undistorted camera in pixels relative to the corner of its window."""
    return {
        "width": window.width, "height": window.height, "fx": window.fx, "fy": window.fy,
        "cx": window.cx - window.x0, "cy": window.cy - window.y0,
    }  # fmt: skip


def support_albedo(environment: Environment) -> dict[str, list[float]]:
    """Return the albedo (3,) of the support by the radiance below the object, 0.05 to 0.9, and per unit of radiance."""
    per_radiance = np.pi / np.maximum(environment.irradiance(environment.basis[2]), 1e-6)
    albedo = np.clip(per_radiance * environment.radiance[-8:].mean(axis=(0, 1)), 0.05, 0.9)
    return {"albedo": albedo.tolist(), "albedo_per_radiance": per_radiance.tolist()}


def write_environment(environment: Environment, file: Path) -> Path:
    """Write the environment as a Radiance image, mirrored because Blender has the opposite azimuth; return the file."""
    write_image(file, np.ascontiguousarray(environment.radiance[:, ::-1, ::-1]))
    return file
