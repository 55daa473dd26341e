"""Which frames of a video to reconstruct from: evenly along the camera's motion, the sharpest of each stretch."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray, IntArray

Grey = NDArray[np.uint8]

#: Frames by default. Of a synthetic video of 100 frames, 45 give all poses as well as 100 do, for 0.4 of the time
#: (docs/evidence/videos.md).
DEFAULT_FRAMES = 50
#: More only where the picture would move on by more than this share of its longer side from frame to frame, for
#: features are lost at about half.
MAX_STEP = 0.25
MOST_FRAMES = 300
#: Fewer where it moves on by less: frames that hardly differ add time and no baseline.
MIN_STEP = 0.014
#: As many are kept of a camera that hardly moves, so that its matches can say so.
LEAST_FRAMES = 12
#: Longer side in pixels of the pictures that motion and sharpness are measured in.
SIDE = 320
#: Corners tracked from frame to frame; a median of fewer than a tenth of them says nothing.
CORNERS = 150
LEAST_CORNERS = 15
#: Motion credited where the tracking breaks, at a cut or a smear: as much as a whole step between chosen frames.
BROKEN_STEP = MAX_STEP


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What is measured of n frames.

    times_s : (n,); step : (n,) median motion since the frame before as a share of the longer side, 0 for the first;
    sharpness : (n,) variance of the Laplacian; spread : (n,) median distance of
    corners from where they were in the first frame, as a share of the longer side, NaN once too few are left.
    """

    times_s: FloatArray
    step: FloatArray
    sharpness: FloatArray
    spread: FloatArray


def motion_of(frames: Iterable[tuple[float, NDArray[np.uint8]]]) -> Motion:
    """Measure frames given as (time, (h, w, 3) RGB) in order; one of them is held at a time."""
    times, steps, sharpness, spread = [], [], [], []
    before: Grey | None = None
    anchor: tuple[Grey, FloatArray] | None = None
    for time_s, colour in frames:
        grey = _small_grey(colour)
        times.append(time_s)
        sharpness.append(_sharpness(grey))
        steps.append(0.0 if before is None else _step(before, grey))
        anchor = anchor or (grey, _corners(grey))
        spread.append(_median_motion(anchor[0], grey, anchor[1]))
        before = grey
    return Motion(*(np.asarray(values, dtype=np.float64) for values in (times, steps, sharpness, spread)))


def chosen_frames(motion: Motion, wanted: int | None = None, times: int = 1) -> IntArray:
    """Indices (k,) of the frames to reconstruct from, ascending.

    wanted : how many, by default so many `times` as many as the motion asks for. The path of the camera is cut into
    stretches of equal motion; of each the sharpest frame is taken.
    """
    n = len(motion.step)
    path = np.cumsum(motion.step)
    count = min(wanted if wanted is not None else min(times * _count(float(path[-1])), MOST_FRAMES), n)
    if count >= n:
        return np.arange(n)
    # a still camera has no motion to divide by: a little of the time's share keeps the stretches ordered
    along = path / max(path[-1], 1e-9) + 1e-3 * np.arange(n) / n
    along = (along - along[0]) / (along[-1] - along[0])
    stretch = np.minimum((along * count).astype(np.int64), count - 1)
    order = np.lexsort((-motion.sharpness, stretch))
    _, first = np.unique(stretch[order], return_index=True)
    return np.sort(order[first])


def _count(path: float) -> int:
    if path > DEFAULT_FRAMES * MAX_STEP:
        return min(int(np.ceil(path / MAX_STEP)), MOST_FRAMES)
    return min(max(int(path / MIN_STEP), LEAST_FRAMES), DEFAULT_FRAMES)


def _small_grey(colour: NDArray[np.uint8]) -> Grey:
    """(h, w) grey, of at most SIDE pixels to a side, of a picture (h, w, 3)."""
    import cv2

    height, width = colour.shape[:2]
    factor = min(1.0, SIDE / max(height, width))
    size = (max(round(width * factor), 16), max(round(height * factor), 16))
    return np.asarray(cv2.cvtColor(cv2.resize(colour, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY))


def _sharpness(grey: Grey) -> float:
    """Variance of the Laplacian of a picture (h, w)."""
    import cv2

    return float(cv2.Laplacian(grey, cv2.CV_64F).var())


def _corners(grey: Grey) -> FloatArray:
    """(m, 1, 2) good corners, none in a plain picture."""
    import cv2

    corners = cv2.goodFeaturesToTrack(grey, CORNERS, 0.01, 6)
    return np.empty((0, 1, 2), dtype=np.float32) if corners is None else corners


def _step(before: Grey, grey: Grey) -> float:
    """Motion between two pictures (h, w), as a share of the longer side."""
    moved = _median_motion(before, grey, _corners(before))
    return BROKEN_STEP if np.isnan(moved) else moved


def _median_motion(before: Grey, grey: Grey, corners: FloatArray) -> float:
    """Median distance that corners (n, 1, 2) moved, as a share of the longer side; NaN if too few are tracked."""
    import cv2

    if len(corners) < LEAST_CORNERS:
        return float("nan")
    there, good, _ = cv2.calcOpticalFlowPyrLK(before, grey, corners, None, winSize=(15, 15), maxLevel=3)
    back, again, _ = cv2.calcOpticalFlowPyrLK(grey, before, there, None, winSize=(15, 15), maxLevel=3)
    kept = (good[:, 0] == 1) & (again[:, 0] == 1) & (np.linalg.norm(back - corners, axis=2)[:, 0] < 1.0)
    if kept.sum() < LEAST_CORNERS:
        return float("nan")
    return float(np.median(np.linalg.norm(there - corners, axis=2)[kept, 0]) / max(grey.shape))
