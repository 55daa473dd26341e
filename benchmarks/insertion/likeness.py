"""How like the truth an inserted object is: outline, hiding edge, flicker."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import BoolArray, FloatArray, IntArray

__all__ = ["LEAST_PIXELS", "edge_errors", "flicker", "height_inside", "inner"]

Picture = NDArray[np.uint8]
#: An object of fewer pixels says little about its outline.
LEAST_PIXELS = 400
#: A face of fewer pixels has no mean worth comparing.
LEAST_PART = 80
#: The codec's blocks and the lens blend colours across an outline; what is judged is so many pixels inside it.
INSIDE_PX = 3


def height_inside(mask: BoolArray) -> int | None:
    """Rows of an outline (h, w) that is wholly in the picture and large enough, else None."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if mask.sum() < LEAST_PIXELS or not (rows[0] > 1 and rows[-1] < mask.shape[0] - 2):
        return None
    if not (columns[0] > 1 and columns[-1] < mask.shape[1] - 2):
        return None
    return int(np.ptp(rows)) + 1


def inner(mask: BoolArray, pixels: int = INSIDE_PX) -> BoolArray:
    """(h, w) the pixels of a mask (h, w) that are so far inside it."""
    import cv2

    kernel = np.ones((2 * pixels + 1, 2 * pixels + 1), np.uint8)
    return np.asarray(cv2.erode(mask.astype(np.uint8), kernel) > 0)


def flicker(
    ours: Sequence[Picture], true: Sequence[Picture], parts: Sequence[IntArray], masks: Sequence[BoolArray]
) -> tuple[float, float]:
    """Change from frame to frame of the object less that of the true one, in grey levels (rms over a video).

    The first is that of the whole object's mean, the second that of its faces. Ours is scaled beforehand by one factor
    for the whole video, for each face one of its own, so that a constant error of the light does not count.
    parts : (h, w) number of the face, 0 without; masks : (h, w) where both videos show the object.
    """
    greys = [[picture.astype(np.float64).mean(axis=-1) for picture in video] for video in (ours, true)]
    whole = _changes(greys[0], greys[1], list(masks), LEAST_PIXELS)
    steps = [_changes(greys[0], greys[1], [(part == k) & m for part, m in zip(parts, masks, strict=True)], LEAST_PART)
             for k in range(1, max(int(part.max()) for part in parts) + 1)]  # fmt: skip
    return _rms(whole), _rms([step for each in steps for step in each])


def edge_errors(ours: BoolArray, ours_whole: BoolArray, true: BoolArray, true_whole: BoolArray) -> FloatArray:
    """(n,) pixels from each pixel of a hiding edge, ours and the true one, to the nearest of the other's outline.

    ours, true : (h, w) what is seen of the object; the others : its outline without what hides it. A hiding edge is the
    border of what is seen against what is hidden; where the other has no edge there, its outline is what is nearest.
    """
    from scipy.ndimage import distance_transform_edt

    errors = []
    for seen, whole, other in ((true, true_whole, ours), (ours, ours_whole, true)):
        edge = _border(seen) & _grown(whole & ~seen) & inner(whole, 1)
        border = _border(other)
        if edge.any():
            far = float(np.hypot(*seen.shape))
            distance = distance_transform_edt(~border) if border.any() else np.full(seen.shape, far)
            errors.append(np.asarray(distance)[edge])
    return np.concatenate(errors) if errors else np.zeros(0)


def _changes(
    ours: Sequence[FloatArray], true: Sequence[FloatArray], masks: Sequence[BoolArray], least: int
) -> list[float]:
    """Changes of ours less those of the truth between frames that both have `least` pixels; all are (h, w)."""
    means = np.array([[o[m].mean(), t[m].mean()] if m.sum() >= least else [np.nan] * 2
                      for o, t, m in zip(ours, true, masks, strict=True)])  # fmt: skip
    if np.isfinite(means[:, 0]).sum() < 2:
        return []
    factor = np.nanmean(means[:, 1]) / np.nanmean(means[:, 0])
    steps = np.diff(means[:, 0] * factor - means[:, 1])
    return [float(step) for step in steps if np.isfinite(step)]


def _border(mask: BoolArray) -> BoolArray:
    """(h, w) pixels of a mask (h, w) with a neighbour outside it."""
    return np.asarray(mask & _grown(~mask))


def _grown(mask: BoolArray) -> BoolArray:
    import cv2

    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")
