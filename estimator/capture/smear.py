"""Whether a picture is smeared: how steep its edges are, in the direction in which they are least steep."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["edge_sharpness"]

#: Longer side in pixels at which edges are looked at.
SIDE = 640
#: An edge is a step of at least so many grey levels within a window of so many pixels.
LEAST_STEP, WINDOW = 24, 13
#: Directions that edges are sorted into, and the fewest edges that say something of a direction.
DIRECTIONS, LEAST_EDGES = 4, 30


def edge_sharpness(colour: NDArray[np.uint8]) -> tuple[float, float]:
    """Steepness of the edges in the least and the most steep of four directions; NaN without edges.

    colour : (h, w, 3) red, green, blue.

    The steepness of an edge is its slope per pixel over the step of grey levels about it: about 0.35 for an ideal
    edge, 0.2 in a sharp textured picture, 0.1 where it is smeared over ten pixels. A smear leaves edges along its
    own direction alone, hence the directions.
    """
    import cv2

    grey = cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)
    factor = min(1.0, SIDE / max(grey.shape))
    if factor < 1:
        grey = cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    smooth = cv2.GaussianBlur(grey, (0, 0), 0.8).astype(np.float32)  # the sensor's noise is no edge
    along_x = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3) / 8
    along_y = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3) / 8
    slope = np.hypot(along_x, along_y)
    window = np.ones((WINDOW, WINDOW), np.uint8)
    step = cv2.dilate(smooth, window) - cv2.erode(smooth, window)
    edges = (slope >= cv2.dilate(slope, np.ones((3, 3), np.uint8))) & (step > LEAST_STEP)
    steepness = slope[edges] / step[edges]
    angle = np.mod(np.arctan2(along_y[edges], along_x[edges]), np.pi)
    direction = np.rint(angle / np.pi * DIRECTIONS).astype(np.int64) % DIRECTIONS
    groups = [steepness[direction == number] for number in range(DIRECTIONS)]
    values = [float(np.quantile(group, 0.75)) for group in groups if len(group) >= LEAST_EDGES]
    return (min(values), max(values)) if values else (float("nan"), float("nan"))
