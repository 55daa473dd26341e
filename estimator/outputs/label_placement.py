"""Where to put labels so that each is near its object, and none lies over another or over what it speaks of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from metric_base.arrays import FloatArray

#: Rings of places tried around the middle of an object; further out a label no longer belongs to it.
_RINGS, _PER_RING = 16, 24
#: Distance between rings in pixels, and how much wider than high they are, as labels are.
_STEP_PX, _FLATTENED = 24.0, 1.6
#: What it costs beside a pixel of distance: a pixel of overlap with another label, and an object wholly covered.
_OVERLAP_COST, _COVER_COST = 3.0, 110.0


def place_labels(
    objects: FloatArray,
    sizes: FloatArray,
    canvas: tuple[float, float],
    *,
    step: float = _STEP_PX,
    cover_cost: float = _COVER_COST,
) -> FloatArray:
    """(n, 2) upper left corners of labels on a canvas (width, height).

    objects : (n, 4) left, top, right, bottom of what each label speaks of; sizes : (n, 2) width and height of the
    labels. Greedy, the largest label first: of the places on rings around the object, `step` pixels
    apart, the one that costs least; `cover_cost` is what it costs to cover a whole object.
    """
    corners = np.zeros((len(sizes), 2))
    taken: list[FloatArray] = []
    for row in np.argsort(-sizes.prod(axis=1), kind="stable"):
        places = _candidates(objects[row], sizes[row], canvas, step)  # (c, 2)
        labels = np.hstack([places, places + sizes[row]])
        middle = (objects[row, :2] + objects[row, 2:]) / 2
        cost = np.linalg.norm(places + sizes[row] / 2 - middle, axis=1)
        cost += _OVERLAP_COST * _shared_area(labels, taken).sum(axis=1)
        area = np.maximum((objects[:, 2:] - objects[:, :2]).prod(axis=1), 1.0)
        cost += cover_cost * (_shared_area(labels, objects) / area).sum(axis=1)
        best = int(cost.argmin())
        corners[row] = places[best]
        taken.append(labels[best])
    return corners


def _candidates(bounds: FloatArray, size: FloatArray, canvas: tuple[float, float], step: float) -> FloatArray:
    """(c, 2) corners that centre the label on rings around the object, kept inside the canvas."""
    angles = np.linspace(-np.pi / 2, 1.5 * np.pi, _PER_RING, endpoint=False)
    around = np.column_stack([_FLATTENED * np.cos(angles), np.sin(angles)])
    radii = step * np.arange(_RINGS)
    centres = (bounds[:2] + bounds[2:]) / 2 + (radii[:, None, None] * around).reshape(-1, 2)
    return np.asarray(np.clip(centres - size / 2, 0, np.maximum(np.array(canvas) - size, 0)))


def _shared_area(labels: FloatArray, others: Sequence[FloatArray] | FloatArray) -> FloatArray:
    """(c, k) area that each of c boxes shares with each of k others."""
    boxes = np.asarray(others, dtype=np.float64).reshape(-1, 4)
    low = np.maximum(labels[:, None, :2], boxes[None, :, :2])
    high = np.minimum(labels[:, None, 2:], boxes[None, :, 2:])
    return np.asarray(np.maximum(high - low, 0).prod(axis=2))
