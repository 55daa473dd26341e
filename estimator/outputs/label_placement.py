"""Place labels close to their objects, so that they cover neither each other nor the objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from metric_base.arrays import FloatArray

#: Number of rings of candidate positions around the centre of an object; farther out, a label is not associated with
#: it.
_N_RINGS = 16
#: Number of candidates of a ring.
_N_PER_RING = 24
#: Distance between rings in pixels.
_RING_STEP_PX = 24.0
#: Ratio of the width of a ring to its height.
_RING_ASPECT = 1.6
#: Cost of a square pixel of overlap with another label, compared with a pixel of distance.
_OVERLAP_COST = 3.0
#: Cost of covering a complete object, compared with a pixel of distance.
_COVER_COST = 110.0


def place_labels(
    objects: FloatArray,
    sizes: FloatArray,
    canvas: tuple[float, float],
    *,
    step: float = _RING_STEP_PX,
    cover_cost: float = _COVER_COST,
) -> FloatArray:
    """Place labels by a greedy search, the largest label first, over positions on rings around their objects.

    Parameters
    ----------
    objects : (n, 4) ndarray of float
        Left, top, right and bottom of the object of each label, in pixels.
    sizes : (n, 2) ndarray of float
        Width and height of each label.
    canvas : (width, height)
    step : float
        Distance between rings, in pixels.
    cover_cost : float
        Cost of covering a complete object.

    Returns
    -------
    (n, 2) ndarray of float
        Upper left corners of the labels.
    """
    corners = np.zeros((len(sizes), 2))
    taken: list[FloatArray] = []
    for row in np.argsort(-sizes.prod(axis=1), kind="stable"):
        # Candidates are on rings around the centre of the object, moved into the canvas.
        size, centre = sizes[row], (objects[row, :2] + objects[row, 2:]) / 2
        angles = np.linspace(-np.pi / 2, 1.5 * np.pi, _N_PER_RING, endpoint=False)
        around = np.column_stack([_RING_ASPECT * np.cos(angles), np.sin(angles)])
        radii = step * np.arange(_N_RINGS)
        centres = centre + (radii[:, None, None] * around).reshape(-1, 2)
        candidates = np.asarray(np.clip(centres - size / 2, 0, np.maximum(np.array(canvas) - size, 0)))
        labels = np.hstack([candidates, candidates + size])
        cost = np.linalg.norm(candidates + size / 2 - centre, axis=1)
        cost += _OVERLAP_COST * _shared_area(labels, taken).sum(axis=1)
        area = np.maximum((objects[:, 2:] - objects[:, :2]).prod(axis=1), 1.0)
        cost += cover_cost * (_shared_area(labels, objects) / area).sum(axis=1)
        best = int(cost.argmin())
        corners[row] = candidates[best]
        taken.append(labels[best])
    return corners


def _shared_area(labels: FloatArray, others: Sequence[FloatArray] | FloatArray) -> FloatArray:
    """Return the areas (c, k) of the intersections of c boxes and k other boxes."""
    boxes = np.asarray(others, dtype=np.float64).reshape(-1, 4)
    low = np.maximum(labels[:, None, :2], boxes[None, :, :2])
    high = np.minimum(labels[:, None, 2:], boxes[None, :, 2:])
    return np.asarray(np.maximum(high - low, 0).prod(axis=2))
