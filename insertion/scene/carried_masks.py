"""Masks of frames that nobody annotated: carried over from the annotated view that is nearest.

An object's points give its inverse depth as a plane over its mask, 1 / z = a + b u + c v, which is exact for flat
objects and near enough for others over a small step of the camera. Its outline goes through that depth into the new
frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimator.projection.cameras import project
from estimator.records.scene import Instance, Scene, View
from insertion.scene.point_cloud import Cloud, front_points
from insertion.scene.rays import normalized_pixels
from metric_base.arrays import FloatArray

__all__ = ["MaskCarrier"]

#: Points that an object's depth rests on.
MIN_POINTS = 6
#: Beyond this angle between two cameras' axes, or this share of the median depth between them, an object shows another
#: side, and its outline does not carry.
MAX_TURN_DEG, MAX_STEP = 25.0, 0.35


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
