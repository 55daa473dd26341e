"""Boxes of pixels, and the masks of instances over them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import Instance
from metric_base.arrays import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class PixelBox:
    """Pixels x0 to x1 and y0 to y1 of an image, without the ends."""

    x0: int
    y0: int
    x1: int
    y1: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.y1 - self.y0, self.x1 - self.x0

    @property
    def slices(self) -> tuple[slice, slice]:
        """Slices of the box in an array (h, w, ...)."""
        return slice(self.y0, self.y1), slice(self.x0, self.x1)

    def union(self, other: PixelBox | None) -> PixelBox:
        """Return the smallest box that contains both."""
        if other is None:
            return self
        return PixelBox(min(self.x0, other.x0), min(self.y0, other.y0), max(self.x1, other.x1), max(self.y1, other.y1))

    def enlarged(self, margin: int, shape: tuple[int, ...]) -> PixelBox:
        """Return the box with a margin in pixels, within an image of a shape (h, w, ...)."""
        height, width = shape[:2]
        low = max(self.x0 - margin, 0), max(self.y0 - margin, 0)
        return PixelBox(*low, min(self.x1 + margin, width), min(self.y1 + margin, height))

    def overlap(self, other: PixelBox) -> PixelBox | None:
        """Return the intersection; None if it is empty."""
        part = PixelBox(max(self.x0, other.x0), max(self.y0, other.y0), min(self.x1, other.x1), min(self.y1, other.y1))
        return part if part.x0 < part.x1 and part.y0 < part.y1 else None

    def within(self, outer: PixelBox) -> tuple[slice, slice]:
        """Return the slices of this box in an array over `outer`, which contains it."""
        return (slice(self.y0 - outer.y0, self.y1 - outer.y0), slice(self.x0 - outer.x0, self.x1 - outer.x0))


def mask_in_box(item: Instance, box: PixelBox) -> NDArray[np.bool_] | None:
    """Return the mask (h, w) of an instance over a box; None if they do not overlap."""
    x, y = item.origin
    height, width = item.mask.shape
    mask_box = PixelBox(x, y, x + width, y + height)
    common = mask_box.overlap(box)
    if common is None:
        return None
    mask = np.zeros(box.shape, dtype=bool)
    mask[common.within(box)] = item.mask[common.within(mask_box)]
    return mask


def labels_in_box(instances: Sequence[Instance], box: PixelBox) -> NDArray[np.int32]:
    """Return labels (h, w): one plus the index of the last instance whose mask contains the pixel, 0 without one."""
    labels = np.zeros(box.shape, dtype=np.int32)
    for label, item in enumerate(instances, start=1):
        mask = mask_in_box(item, box)
        if mask is not None:
            labels[mask] = label
    return labels


def pixels_in_mask(item: Instance, pixels: FloatArray) -> BoolArray:
    """Return which of the pixels (n, 2) are in the mask of an instance."""
    index = np.floor(pixels - item.origin).astype(np.int64)
    rows = np.flatnonzero(((index >= 0) & (index < item.mask.shape[::-1])).all(axis=1))
    inside = np.zeros(len(pixels), dtype=bool)
    inside[rows] = item.mask[index[rows, 1], index[rows, 0]]
    return inside
