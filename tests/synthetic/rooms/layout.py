"""Rectangular footprints in the ground plane, with a separating-axis test for overlap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from metric_base.arrays import FloatArray

__all__ = ["Footprint", "apart", "distance_to", "inside"]


@dataclass(frozen=True, slots=True, eq=False)
class Footprint:
    """A rectangle with centre (2,), half sides (2,) and yaw in radians from +x."""

    centre: FloatArray
    half: FloatArray
    yaw: float

    @property
    def axes(self) -> FloatArray:
        """Unit vectors (2, 2) along the sides, one per row."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([[c, s], [-s, c]])

    @property
    def corners(self) -> FloatArray:
        """Corners (4, 2)."""
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        return np.asarray(self.centre + (signs * self.half) @ self.axes)


def apart(a: Footprint, b: Footprint, gap: float = 0.0) -> bool:
    """Return True if the projections of two rectangles on an axis are at least `gap` metres apart."""
    for axis in np.concatenate([a.axes, b.axes]):
        first, second = a.corners @ axis, b.corners @ axis
        if first.min() > second.max() + gap or second.min() > first.max() + gap:
            return True
    return False


def inside(inner: Footprint, outer: Footprint) -> bool:
    """Return True if a rectangle is completely inside another."""
    local = (inner.corners - outer.centre) @ outer.axes.T
    return bool(np.all(np.abs(local) <= outer.half + 1e-9))


def distance_to(print_: Footprint, points: FloatArray) -> FloatArray:
    """Return the distance (n,) of ground points (n, 2) from a rectangle; 0 inside."""
    local = np.abs((points - print_.centre) @ print_.axes.T) - print_.half
    return np.asarray(np.linalg.norm(np.maximum(local, 0), axis=1))
