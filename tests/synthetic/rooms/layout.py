"""Footprints that must not overlap: rectangles in the ground plane and the separating-axis test."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from metric_base.arrays import FloatArray

__all__ = ["Footprint", "apart", "distance_to", "inside"]


@dataclass(frozen=True, slots=True, eq=False)
class Footprint:
    """A rectangle: centre (2,), half sides (2,), yaw in radians from +x."""

    centre: FloatArray
    half: FloatArray
    yaw: float

    @property
    def axes(self) -> FloatArray:
        """(2, 2) unit rows along the sides."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([[c, s], [-s, c]])

    @property
    def corners(self) -> FloatArray:
        """(4, 2) corners."""
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        return np.asarray(self.centre + (signs * self.half) @ self.axes)


def apart(a: Footprint, b: Footprint, gap: float = 0.0) -> bool:
    """Whether two rectangles keep at least `gap` metres along some axis that separates them."""
    for axis in np.concatenate([a.axes, b.axes]):
        first, second = a.corners @ axis, b.corners @ axis
        if first.min() > second.max() + gap or second.min() > first.max() + gap:
            return True
    return False


def inside(inner: Footprint, outer: Footprint) -> bool:
    """Whether a rectangle lies wholly within another."""
    local = (inner.corners - outer.centre) @ outer.axes.T
    return bool(np.all(np.abs(local) <= outer.half + 1e-9))


def distance_to(print_: Footprint, points: FloatArray) -> FloatArray:
    """(n,) distance of ground points (n, 2) from a rectangle, zero inside."""
    local = np.abs((points - print_.centre) @ print_.axes.T) - print_.half
    return np.asarray(np.linalg.norm(np.maximum(local, 0), axis=1))
