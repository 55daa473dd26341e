"""Instance masks over a box of a picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import Instance
from insertion.composite.boxes import Box

__all__ = ["mask_in_box"]


def mask_in_box(item: Instance, box: Box) -> NDArray[np.bool_] | None:
    """(h, w) the instance's mask over the box, None where they do not meet."""
    x, y = item.origin
    height, width = item.mask.shape
    left, top, right, bottom = max(x, box.x0), max(y, box.y0), min(x + width, box.x1), min(y + height, box.y1)
    if left >= right or top >= bottom:
        return None
    mask = np.zeros(box.shape, dtype=bool)
    part = item.mask[top - y : bottom - y, left - x : right - x]
    mask[top - box.y0 : bottom - box.y0, left - box.x0 : right - box.x0] = part
    return mask
