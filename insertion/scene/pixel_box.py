"""A box of pixels of a picture, and an instance's mask over it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import Instance


@dataclass(frozen=True, slots=True)
class PixelBox:
    """Pixels x0 .. x1, y0 .. y1 of a picture, the ends not included."""

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
        """For arrays (h, w, ...)."""
        return slice(self.y0, self.y1), slice(self.x0, self.x1)

    def union(self, other: PixelBox | None) -> PixelBox:
        """The box about both."""
        if other is None:
            return self
        return PixelBox(min(self.x0, other.x0), min(self.y0, other.y0), max(self.x1, other.x1), max(self.y1, other.y1))

    def overlap(self, other: PixelBox) -> PixelBox | None:
        """What both have in common; None without any pixel."""
        part = PixelBox(max(self.x0, other.x0), max(self.y0, other.y0), min(self.x1, other.x1), min(self.y1, other.y1))
        return part if part.x0 < part.x1 and part.y0 < part.y1 else None

    def within(self, outer: PixelBox) -> tuple[slice, slice]:
        """Slices of this box in an array over `outer`, which contains it."""
        return (slice(self.y0 - outer.y0, self.y1 - outer.y0), slice(self.x0 - outer.x0, self.x1 - outer.x0))


def mask_in_box(item: Instance, box: PixelBox) -> NDArray[np.bool_] | None:
    """(h, w) the instance's mask over the box, None where they do not meet."""
    x, y = item.origin
    height, width = item.mask.shape
    own = PixelBox(x, y, x + width, y + height)
    common = own.overlap(box)
    if common is None:
        return None
    mask = np.zeros(box.shape, dtype=bool)
    mask[common.within(box)] = item.mask[common.within(own)]
    return mask


def labels_in_box(instances: Sequence[Instance], box: PixelBox) -> NDArray[np.int32]:
    """(h, w) one plus the row of the last instance whose mask has the pixel, 0 without one."""
    labels = np.zeros(box.shape, dtype=np.int32)
    for number, item in enumerate(instances, start=1):
        mask = mask_in_box(item, box)
        if mask is not None:
            labels[mask] = number
    return labels
