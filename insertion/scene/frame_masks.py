"""Masks of frames that nobody annotated: carried over from the annotated view that is nearest.

An object's points give its inverse depth as a plane over its mask, 1 / z = a + b u + c v, which is exact for flat
objects and near enough for others over a small step of the camera. Its outline goes through that depth into the new
frame.

Masks of people and objects that move: the reconstruction knows nothing of them, so their feet say how far they are.

A mask's lowest pixels are taken to stand on the ground. The object is then an upright plane through that place, facing
the camera; what is hidden by it is decided pixel by pixel.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.projection.cameras import pixels_in_view, project
from estimator.records.objects import SupportPlane
from estimator.records.scene import Instance, Scene, View
from insertion.footage.footage import Shot
from insertion.scene.camera_rays import camera_rays, normalized_pixels, ray_through
from insertion.scene.pixel_box import PixelBox, mask_in_box
from insertion.scene.point_cloud import Cloud, FrontPoints, front_points
from metric_base.arrays import BoolArray, FloatArray

#: Points that an object's depth rests on.
MIN_POINTS = 6
#: Beyond this angle between two cameras' axes, or this share of the median depth between them, an object shows another
#: side, and its outline does not carry.
MAX_TURN_DEG, MAX_STEP = 25.0, 0.35
#: Of a mask's height, its lowest part shows the feet.
FEET_SHARE = 0.04
#: A ray that meets the ground under a flatter angle than this (sine) says nothing of the distance.
GRAZING = 0.01


class MaskCarrier:
    """The masks of any view of a scene with some annotated views."""

    def __init__(self, scene: Scene, by_view: Mapping[int, Sequence[Instance]], cloud: Cloud) -> None:
        self._scene, self._by_view, self._cloud = scene, by_view, cloud
        self._depths: dict[int, list[FloatArray | None]] = {}
        self._reach = _median_depth(scene, cloud)

    def masks(self, row: int | None, view: View) -> Sequence[Instance]:
        """The masks of a view: its own (`row` of the scene), or those of the nearest annotated view, carried over."""
        if row is not None and row in self._by_view:
            return self._by_view[row]
        source = self._nearest(view)
        if source is None:
            return ()
        depths = self._depths.setdefault(source, self._planes(source))
        carried = [
            _carry(item, self._scene.views[source], view, plane)
            for item, plane in zip(self._by_view[source], depths, strict=True)
            if plane is not None
        ]
        return [item for item in carried if item is not None]

    def _nearest(self, view: View) -> int | None:
        best, least = None, 1.0
        for row in self._by_view:
            other = self._scene.views[row]
            turn = np.degrees(np.arccos(np.clip(float(other.rotation[2] @ view.rotation[2]), -1, 1)))
            step = float(np.linalg.norm(other.centre - view.centre)) / self._reach
            cost = max(turn / MAX_TURN_DEG, step / MAX_STEP)
            if cost < least:
                best, least = row, cost
        return best

    def _planes(self, row: int) -> list[FloatArray | None]:
        """(3,) inverse depth a, b, c over normalized coordinates, of each instance of a view; None without points."""
        view = self._scene.views[row]
        front = front_points(view, self._cloud)
        flat = normalized_pixels(view.camera, front.pixels)
        return [_inverse_depth(item, front.pixels, flat, front.depths) for item in self._by_view[row]]


def _inverse_depth(item: Instance, pixels: FloatArray, flat: FloatArray, depths: FloatArray) -> FloatArray | None:
    """(3,) plane of inverse depth a + b x + c y through the points in the mask; None of too few."""
    at = np.floor(pixels - item.origin).astype(np.int64)
    inside = np.all((at >= 0) & (at < item.mask.shape[::-1]), axis=1)
    rows = np.flatnonzero(inside)
    rows = rows[item.mask[at[rows, 1], at[rows, 0]]]
    if len(rows) < MIN_POINTS:
        return None
    inverse = 1 / depths[rows]
    middle = np.median(inverse)
    kept = rows[np.abs(inverse - middle) < 0.3 * middle]  # what shines through the mask is left out
    if len(kept) < MIN_POINTS:
        return np.array([middle, 0.0, 0.0])
    centre = flat[kept].mean(axis=0)
    system = np.column_stack([np.ones(len(kept)), flat[kept] - centre])
    # a small object has no slope that its few points could tell
    ridge = np.diag([0.0, 1.0, 1.0]) * 1e-3 * len(kept)
    a, b, c = np.linalg.solve(system.T @ system + ridge, system.T @ (1 / depths[kept]))
    return np.array([a - b * centre[0] - c * centre[1], b, c])


def _carry(item: Instance, source: View, view: View, plane: FloatArray) -> Instance | None:
    """The instance as the other view shows it, its surface the `plane` (3,); None if out of the picture."""
    import cv2

    outlines, _ = cv2.findContours(item.mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    moved = [_move_outline(line[:, 0] + np.array(item.origin) + 0.5, source, view, plane) for line in outlines]
    kept = [line for line in moved if line is not None]
    if not kept or len(kept) < len(moved):
        return None
    corners = np.concatenate(kept)
    size = np.array([view.camera.width, view.camera.height])
    low = np.clip(np.floor(corners.min(axis=0)), 0, size).astype(int)
    high = np.clip(np.ceil(corners.max(axis=0)) + 1, 0, size).astype(int)
    if (high - low < 2).any():
        return None
    mask = np.zeros((high[1] - low[1], high[0] - low[0]), np.uint8)
    cv2.fillPoly(mask, [np.rint((line - low - 0.5) * 16).astype(np.int32) for line in kept], 1, shift=4)
    return replace(item, mask=mask.astype(bool), origin=(int(low[0]), int(low[1])))


def _move_outline(outline: NDArray[np.floating], source: View, view: View, plane: FloatArray) -> FloatArray | None:
    """(n, 2) pixels in the other view of an outline (n, 2) on the plane (3,) of inverse depth; None if behind."""
    flat = normalized_pixels(source.camera, np.asarray(outline, dtype=np.float64))
    inverse = plane[0] + flat @ plane[1:]
    if (inverse <= 0).any():
        return None
    local = np.column_stack([flat, np.ones(len(flat))]) / inverse[:, None]
    scene = (local - source.translation) @ source.rotation
    pixels = project(view.camera, scene @ view.rotation.T + view.translation)
    return pixels if np.isfinite(pixels).all() else None


def _median_depth(scene: Scene, cloud: Cloud) -> float:
    if not len(scene.views) or not len(cloud.points):
        return 1.0
    view = scene.views[len(scene.views) // 2]
    depths = front_points(view, cloud).depths
    return float(np.median(depths)) if len(depths) else 1.0


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

    from estimator.instances.instance_reader import read_instances

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
