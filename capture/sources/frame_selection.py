"""Choose frames of a video evenly along the motion of the camera, the sharpest one of each stretch."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray, IntArray

Grey = NDArray[np.uint8]

#: Default number of frames. Of a synthetic video of 100 frames, 45 give all poses as well as 100 do, in 0.4 of the
#: time (docs/evidence/videos.md).
DEFAULT_FRAMES = 50
#: Maximum motion between chosen frames, relative to the longer side; features are lost at about half of the side. A
#: long path has more than DEFAULT_FRAMES frames for this, up to MAX_FRAMES.
MAX_STEP, MAX_FRAMES = 0.25, 300
#: Minimum motion between chosen frames: frames that hardly differ add time and no baseline. A camera that hardly moves
#: keeps MIN_FRAMES, whose matches show that.
MIN_STEP, MIN_FRAMES = 0.014, 12
#: Longer side in pixels of the images in which motion and sharpness are measured.
MOTION_SIDE = 320
#: Number of corners that are tracked from frame to frame, and minimum number for a median.
N_CORNERS, MIN_CORNERS = 150, 15
#: Assumed motion between frames whose tracking fails, at a cut or a motion blur: a whole step between chosen frames.
BROKEN_STEP = MAX_STEP
#: Longer side in pixels of the images in which edges are measured.
EDGE_SIDE = 640
#: Minimum step of an edge in grey levels, and side of the window about it in pixels.
MIN_EDGE_LEVELS, EDGE_WINDOW = 24, 13
#: Number of directions of edges, and minimum number of edges in a direction.
N_DIRECTIONS, MIN_EDGES = 4, 30


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Measurements of the n frames of a video."""

    times_s: FloatArray  #: (n,) presentation times.
    step: FloatArray  #: (n,) median motion since the frame before, relative to the longer side; 0 for the first.
    sharpness: FloatArray  #: (n,) variance of the Laplacian.


def motion_of(frames: Iterable[tuple[float, NDArray[np.uint8]]]) -> Motion:
    """Measure frames given as (time, (h, w, 3) RGB) in order, one at a time."""
    import cv2

    times, steps, sharpness = [], [], []
    before: Grey | None = None
    for time_s, colour in frames:
        height, width = colour.shape[:2]
        factor = min(1.0, MOTION_SIDE / max(height, width))
        size = (max(round(width * factor), 16), max(round(height * factor), 16))
        grey = np.asarray(cv2.cvtColor(cv2.resize(colour, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY))
        times.append(time_s)
        sharpness.append(float(cv2.Laplacian(grey, cv2.CV_64F).var()))
        steps.append(0.0 if before is None else _step(before, grey))
        before = grey
    return Motion(*(np.asarray(values, dtype=np.float64) for values in (times, steps, sharpness)))


def _step(before: Grey, grey: Grey) -> float:
    """Return the median motion of corners between two images (h, w), relative to the longer side."""
    import cv2

    corners = cv2.goodFeaturesToTrack(before, N_CORNERS, 0.01, 6)
    if corners is None or len(corners) < MIN_CORNERS:
        return BROKEN_STEP
    moved, found, _ = cv2.calcOpticalFlowPyrLK(before, grey, corners, None, winSize=(15, 15), maxLevel=3)
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(grey, before, moved, None, winSize=(15, 15), maxLevel=3)
    keep = (found[:, 0] == 1) & (found_back[:, 0] == 1) & (np.linalg.norm(back - corners, axis=2)[:, 0] < 1.0)
    if keep.sum() < MIN_CORNERS:
        return BROKEN_STEP
    return float(np.median(np.linalg.norm(moved - corners, axis=2)[keep, 0]) / max(grey.shape))


def chosen_frames(motion: Motion, wanted: int | None = None) -> IntArray:
    """Return the indices (k,) of the frames to reconstruct from, ascending.

    The path of the camera is cut into stretches of equal motion; of each the sharpest frame is taken.

    Parameters
    ----------
    motion : Motion
    wanted : int, optional
        Number of frames, by default the number that the motion requires.
    """
    n = len(motion.step)
    path = np.cumsum(motion.step)
    count = wanted or min(max(int(path[-1] / MIN_STEP), MIN_FRAMES), DEFAULT_FRAMES)
    if wanted is None and path[-1] > DEFAULT_FRAMES * MAX_STEP:
        count = min(int(np.ceil(path[-1] / MAX_STEP)), MAX_FRAMES)
    if count >= n:
        return np.arange(n)
    # time has a small weight, which orders the stretches of a camera that does not move
    along = path / max(path[-1], 1e-9) + 1e-3 * np.arange(n) / n
    along = (along - along[0]) / (along[-1] - along[0])
    stretch = np.minimum((along * count).astype(np.int64), count - 1)
    order = np.lexsort((-motion.sharpness, stretch))
    _, first = np.unique(stretch[order], return_index=True)
    return np.sort(order[first])


def edge_sharpness(colour: NDArray[np.uint8]) -> tuple[float, float]:
    """Return the lowest and the highest steepness of the edges over four directions; NaN without edges.

    The steepness of an edge is its slope per pixel over the step of grey levels about it: about 0.35 for an ideal
    edge, 0.2 in a sharp textured image, and 0.1 in an image with a motion blur of ten pixels. Motion blur leaves only
    the edges along its own direction sharp, so directions are measured separately.

    Parameters
    ----------
    colour : (h, w, 3) ndarray of uint8
        RGB.
    """
    import cv2

    grey = cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)
    factor = min(1.0, EDGE_SIDE / max(grey.shape))
    if factor < 1:
        grey = cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    smooth = cv2.GaussianBlur(grey, (0, 0), 0.8).astype(np.float32)  # suppresses the noise of the sensor
    along_x = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3) / 8
    along_y = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3) / 8
    slope = np.hypot(along_x, along_y)
    window = np.ones((EDGE_WINDOW, EDGE_WINDOW), np.uint8)
    step = cv2.dilate(smooth, window) - cv2.erode(smooth, window)
    edges = (slope >= cv2.dilate(slope, np.ones((3, 3), np.uint8))) & (step > MIN_EDGE_LEVELS)
    steepness = slope[edges] / step[edges]
    angle = np.mod(np.arctan2(along_y[edges], along_x[edges]), np.pi)
    direction = np.rint(angle / np.pi * N_DIRECTIONS).astype(np.int64) % N_DIRECTIONS
    groups = [steepness[direction == number] for number in range(N_DIRECTIONS)]
    values = [float(np.quantile(group, 0.75)) for group in groups if len(group) >= MIN_EDGES]
    return (min(values), max(values)) if values else (float("nan"), float("nan"))
