"""Fragments: an object that another one of its category contains is a part of it, and not a second object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimator.records.measured_object import Box, MeasuredObject

__all__ = ["without_fragments"]

# An object is a fragment when so much of its box is within the box of another of its category that more views show,
# which is taken a little larger: boxes of neighbours touch, and nothing stands within another chair.
CONTAINED_SHARE, LARGER = 0.6, 1.1
# Points along each side of a box that say how much of it is within another.
GRID = 5


def without_fragments(objects: Sequence[MeasuredObject]) -> tuple[MeasuredObject, ...]:
    """The objects, fragments skipped with the reason."""
    ranked = sorted(range(len(objects)), key=lambda row: (-objects[row].views, -objects[row].points))
    whole: list[MeasuredObject] = []
    after = list(objects)
    for row in ranked:
        item = objects[row]
        if item.skipped is not None or item.box is None:
            continue
        if any(other.category == item.category and _is_within(item.box, other.box) for other in whole):
            after[row] = replace(item, skipped=f"a part of another {item.category}")
        else:
            whole.append(item)
    return tuple(after)


def _is_within(part: Box, whole: Box | None) -> bool:
    """Whether most of one box is within another."""
    if whole is None:
        return False
    steps = (np.arange(GRID) + 0.5) / GRID - 0.5
    unit = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    points = unit * part.extents @ part.axes + part.centre
    local = np.abs((points - whole.centre) @ whole.axes.T)
    inside = (local <= LARGER * whole.extents / 2).all(axis=1)
    return bool(inside.mean() > CONTAINED_SHARE)
