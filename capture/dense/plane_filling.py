"""Fill plain surfaces, which correlation leaves empty, with planes through the depths around them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import BoolArray, FloatArray

FloatImage = NDArray[np.float32]

#: Maximum standard deviation of grey levels over a window of a plain surface, which has noise and shading only.
MAX_PLAIN_STD, WINDOW = 6.0, 7
#: Minimum number of pixels of a surface that is filled, and of its border with known depth.
MIN_AREA, MIN_BORDER = 60, 40
#: Width in pixels of the border that determines the plane.
BORDER_WIDTH = 9
#: Maximum relative distance of depths from their plane.
TOLERANCE = 0.012
#: Minimum relative difference between depths of two objects.
MIN_OBJECT_STEP = 0.05
#: Minimum fraction of the border on the plane, and maximum fraction behind it: a plane occludes what is behind it,
#: whereas objects in front of it may touch its border.
MIN_ON_PLANE, MAX_BEHIND = 0.5, 0.1
#: Number of planes that are tried through three points of the border.
N_TRIALS = 60


def fill_planes(depth: FloatImage, grey: FloatImage) -> FloatImage:
    """Return a depth map (h, w) with plain surfaces filled if the known depths around them lie on one plane.

    A plane of the world is linear in inverse depth over the image: 1 / z = a x + b y + c. It is drawn only within the
    convex hull of the border's pixels that it fits, and not where the nearest pixel with known depth belongs to another
    object: one in front may be as plain as the surface behind it.

    Parameters
    ----------
    depth : (h, w) ndarray of float32
        Along the optical axis, NaN if unknown.
    grey : (h, w) ndarray of float32
        Grey levels.
    """
    mean = cv2.boxFilter(grey, -1, (WINDOW, WINDOW))
    square = cv2.boxFilter(grey * grey, -1, (WINDOW, WINDOW))
    deviation = np.sqrt(np.maximum(square - mean * mean, 0))
    plain = (~np.isfinite(depth) & (deviation < MAX_PLAIN_STD)).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(plain, connectivity=4)
    filled = depth.copy()
    generator = np.random.default_rng(0)
    for number in range(1, count):
        x, y, width, height, area = stats[number]
        if area < MIN_AREA:
            continue
        rows = slice(max(y - BORDER_WIDTH, 0), y + height + BORDER_WIDTH)
        columns = slice(max(x - BORDER_WIDTH, 0), x + width + BORDER_WIDTH)
        box = rows, columns
        inside = labels[box] == number
        plane = _plane_depth(inside, depth[box], generator)
        if plane is not None:
            filled[box] = np.where(inside & np.isfinite(plane), plane, filled[box])
    return filled


def _plane_depth(inside: BoolArray, depth: FloatImage, generator: np.random.Generator) -> FloatImage | None:
    """Return the depth (h, w) of the plane around a surface, a mask (h, w), by depths (h, w); None without a plane."""
    known = np.isfinite(depth)
    kernel = np.ones((2 * BORDER_WIDTH + 1, 2 * BORDER_WIDTH + 1), np.uint8)
    ys, xs = np.nonzero((cv2.dilate(inside.astype(np.uint8), kernel) > 0) & known)
    if len(xs) < MIN_BORDER:
        return None
    pixels = np.column_stack([xs, ys, np.ones(len(xs))]).astype(np.float64)
    inverse = 1 / depth[ys, xs].astype(np.float64)
    plane = _fitted_plane(pixels, inverse, generator)
    if plane is None:
        return None
    ratio = pixels @ plane / inverse
    on = np.abs(ratio - 1) < TOLERANCE
    if on.mean() < MIN_ON_PLANE or (ratio > 1 + 2 * TOLERANCE).mean() > MAX_BEHIND:  # above 1 the plane is closer
        return None

    hull = np.zeros(depth.shape, dtype=np.uint8)
    cv2.fillConvexPoly(hull, cv2.convexHull(pixels[on, :2].astype(np.int64).astype(np.int32)), 1)
    rows, columns = np.indices(depth.shape)
    inverse = plane[0] * columns + plane[1] * rows + plane[2]
    drawn = np.where((hull > 0) & (inverse > 0), 1 / np.maximum(inverse, 1e-12), np.nan).astype(np.float32)
    _, labels = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    with np.errstate(invalid="ignore"):
        is_other = np.abs(drawn / depth - 1) > MIN_OBJECT_STEP  # False if either is unknown
    of_label = np.zeros(labels.max() + 1, dtype=bool)
    of_label[labels[known]] = is_other[known]
    return np.where(of_label[labels], np.float32(np.nan), drawn)


def _fitted_plane(pixels: FloatArray, inverse: FloatArray, generator: np.random.Generator) -> FloatArray | None:
    """Return a, b, c (3,) of the plane that fits most of the border: pixels (n, 3) as x, y, 1, inverse depths (n,)."""
    best = np.zeros(len(pixels), dtype=bool)
    for _ in range(N_TRIALS):
        three = generator.choice(len(pixels), 3, replace=False)
        if abs(np.linalg.det(pixels[three])) < 1.0:  # collinear
            continue
        on = np.abs(pixels @ np.linalg.solve(pixels[three], inverse[three]) / inverse - 1) < TOLERANCE
        best = on if on.sum() > best.sum() else best
    if best.sum() < MIN_BORDER:
        return None
    return np.asarray(np.linalg.lstsq(pixels[best], inverse[best], rcond=None)[0])
