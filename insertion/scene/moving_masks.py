"""Masks of people and objects that move: the reconstruction knows nothing of them, so their feet say how far they are.

A mask's lowest pixels are taken to stand on the ground. The object is then an upright plane through that place, facing
the camera; what is hidden by it is decided pixel by pixel.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.geometry.planes import SupportPlane
from estimator.projection.cameras import pixels_in_view
from estimator.records.scene import Instance, Scene, View
from insertion.footage.footage import Shot
from insertion.scene.pixel_box import PixelBox, mask_in_box
from insertion.scene.point_cloud import Cloud, FrontPoints
from insertion.scene.rays import camera_rays, ray_through
from metric_base.arrays import BoolArray, FloatArray

__all__ = ["Upright", "cloud_beside", "moving_masks", "points_beside", "uprights"]

#: Of a mask's height, its lowest part shows the feet.
FEET_SHARE = 0.04
#: A ray that meets the ground under a flatter angle than this (sine) says nothing of the distance.
GRAZING = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Upright:
    """An object that moves, in one picture; depth : along the optical axis is offset / (direction . ray)."""

    item: Instance
    direction: FloatArray
    offset: float

    def hides(self, box: PixelBox, view: View, behind: NDArray[np.float32]) -> BoolArray:
        """(h, w) pixels of a box in which it is nearer than `behind` (h, w)."""
        mask = mask_in_box(self.item, box)
        if mask is None:
            return np.zeros(box.shape, dtype=bool)
        rays = camera_rays(view.camera)[box.slices]
        along = rays[..., 0] * self.direction[0] + rays[..., 1] * self.direction[1] + self.direction[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(mask & (along > 0) & (self.offset / along < behind))


def moving_masks(file: Path, scene: Scene, shots: Sequence[Shot]) -> Mapping[int, tuple[Instance, ...]]:
    """The masks of a file by the number of the shot that each is of; the file names the frames as the shots are named.

    Raises InputError where it cannot be read, or names no frame.
    """
    from dataclasses import replace

    from estimator.reconstructions.scene_reader import read_instances

    posed = [shot for shot in shots if shot.view is not None]
    views = tuple(replace(shot.view, name=shot.name) for shot in posed if shot.view is not None)
    masks: dict[int, list[Instance]] = defaultdict(list)
    for item in read_instances(file, replace(scene, views=views)):
        masks[posed[item.view].index].append(item)
    return {index: tuple(items) for index, items in masks.items()}


def uprights(items: Sequence[Instance], view: View, ground: SupportPlane) -> list[Upright]:
    """What each mask is in the view; one whose feet are above the horizon is left out."""
    objects = [_upright(item, view, ground) for item in items]
    return [one for one in objects if one is not None]


def _upright(item: Instance, view: View, ground: SupportPlane) -> Upright | None:
    rows = np.flatnonzero(item.mask.any(axis=1))
    if not len(rows):
        return None
    bottom = int(rows[-1])
    high = max(1, round(FEET_SHARE * (bottom - int(rows[0]) + 1)))
    columns = np.nonzero(item.mask[max(bottom - high + 1, 0) : bottom + 1])[1]
    x, y = item.origin[0] + float(np.median(columns)) + 0.5, item.origin[1] + bottom + 1.0
    up, ray = ground.basis[2], ray_through(view, x, y)
    toward = float(ray @ up)
    if toward > -GRAZING * float(np.linalg.norm(ray)):
        return None
    depth = (ground.height - float(view.centre @ up)) / toward
    if depth <= 0:
        return None
    level = ray - toward * up  # the horizontal way to it
    facing = view.rotation @ (level / max(float(np.linalg.norm(level)), 1e-12))  # in the camera
    foot = depth * (view.rotation @ ray)
    return Upright(item, facing, float(foot @ facing))


def cloud_beside(cloud: Cloud, moving: Mapping[int, Sequence[Instance]], shots: Sequence[Shot]) -> Cloud:
    """The cloud without the points that are on what moves: where they are is wrong.

    A point is left out if it is in the masks of most of the shots that have masks and that it is in the picture of.
    """
    inside, shown = np.zeros(len(cloud.points), np.int64), np.zeros(len(cloud.points), np.int64)
    for shot in shots:
        if shot.view is None or not moving.get(shot.index):
            continue
        pixels = pixels_in_view(shot.view, cloud.points)[0]
        seen = np.isfinite(pixels).all(axis=1)
        shown += seen
        inside[seen] += _in_masks(pixels[seen], moving[shot.index])
    return cloud.subset(2 * inside <= shown)


def points_beside(front: FrontPoints, items: Sequence[Instance]) -> FrontPoints:
    """The points that a picture shows where nothing that moves stands before them."""
    free = ~_in_masks(front.pixels, items)
    return front if free.all() else front.kept(free)


def _in_masks(pixels: FloatArray, items: Sequence[Instance]) -> BoolArray:
    """(n,) whether each of the pixels (n, 2) is in one of the masks."""
    inside = np.zeros(len(pixels), dtype=bool)
    for item in items:
        at = np.floor(pixels - item.origin).astype(np.int64)
        rows = np.flatnonzero(((at >= 0) & (at < item.mask.shape[::-1])).all(axis=1))
        inside[rows[item.mask[at[rows, 1], at[rows, 0]]]] = True
    return inside
