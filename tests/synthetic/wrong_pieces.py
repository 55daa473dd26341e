"""Move parts of a reconstruction, as a mapper does that registers frames at wrong positions."""

from __future__ import annotations

from typing import Any

import numpy as np

from estimator.reconstructions.pycolmap_library import pycolmap
from metric_base.arrays import FloatArray

__all__ = ["lengthen_steps", "move_frames"]


def move_frames(model: Any, names: set[str], turn: FloatArray, shift: float, factor: float) -> None:
    """Move some frames of a model by a common transform, without their points.

    turn, factor : rotation (3, 3) and scale about the centre of the first of the frames.
    shift : translation along the viewing direction of the first frame, relative to the extent of all camera centres.
    """
    moved = sorted((image for image in model.images.values() if image.name in names), key=lambda image: image.name)
    centres = np.array([image.projection_center() for image in model.images.values() if image.has_pose])
    extent = float(np.sqrt(((centres - centres.mean(axis=0)) ** 2).sum(axis=1).mean()))
    hub, ahead = moved[0].projection_center(), moved[0].cam_from_world().matrix()[2, :3]
    for image in moved:
        pose = image.cam_from_world().matrix()
        rotation = pose[:, :3] @ turn.T
        centre = hub + factor * turn @ (image.projection_center() - hub) + shift * extent * ahead
        image.frame.set_cam_from_world(
            image.camera_id,
            pycolmap.Rigid3d(np.column_stack([rotation, -rotation @ centre])),
        )


def lengthen_steps(model: Any, names: set[str], factor: float) -> None:
    """Multiply the steps that end at these frames by `factor`, and move all later frames. Points are not moved."""
    placed = sorted((image for image in model.images.values() if image.has_pose), key=lambda image: image.name)
    centres = np.array([image.projection_center() for image in placed])
    factors = np.array([factor if image.name in names else 1.0 for image in placed[1:]])
    path = np.vstack([centres[:1], centres[0] + np.cumsum(factors[:, None] * np.diff(centres, axis=0), axis=0)])
    for image, centre in zip(placed, path, strict=True):
        rotation = image.cam_from_world().matrix()[:, :3]
        pose = pycolmap.Rigid3d(np.column_stack([rotation, -rotation @ centre]))
        image.frame.set_cam_from_world(image.camera_id, pose)
