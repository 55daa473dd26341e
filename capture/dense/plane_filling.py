"""Depth of plain surfaces, which correlation leaves empty: planes through the depths around them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import BoolArray, FloatArray, IntArray

FloatPicture = NDArray[np.float32]

#: Standard deviation of grey levels over a window below which a surface is plain: noise and shading, no texture.
PLAIN = 6.0
WINDOW = 7
#: Pixels of a surface that is filled, at least, and of its border with known depth.
LEAST_AREA, LEAST_BORDER = 60, 40
#: Width in pixels of the border whose depths decide.
BORDER = 9
#: Depths lie on a plane within this share.
TOLERANCE = 0.012
#: Depths that differ by more than this share are of another object.
ELSEWHERE = 0.05
#: Of the border, the share on the plane at least, and the share behind it at most: a plane hides what is behind it,
#: while objects in front of it may stand at its border.
ON_PLANE, BEHIND = 0.5, 0.1
#: Planes that are tried through three points of the border.
TRIALS = 60


def fill_planes(depth: FloatPicture, grey: FloatPicture) -> FloatPicture:
    """(h, w) depth with plain surfaces filled where the known depths around them lie on one plane.

    depth : (h, w) along the optical axis, NaN where unknown; grey : (h, w) grey levels.

    A plane of the world is linear in inverse depth over the picture: 1 / z = a x + b y + c. It is drawn only within the
    convex hull of the border's pixels that it fits, and not where the nearest pixel with known depth is of another
    object: one in front may be as plain as what is behind it.
    """
    import cv2

    known = np.isfinite(depth)
    plain = (~known & (_deviation(grey) < PLAIN)).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(plain, connectivity=4)
    filled = depth.copy()
    generator = np.random.default_rng(0)
    for number in range(1, count):
        x, y, width, height, area = stats[number]
        if area < LEAST_AREA:
            continue
        box = np.s_[max(y - BORDER, 0) : y + height + BORDER, max(x - BORDER, 0) : x + width + BORDER]
        inside = labels[box] == number
        here = _plane_depth(inside, depth[box], generator)
        filled[box] = np.where(inside & np.isfinite(here), here, filled[box])
    return filled


def _plane_depth(inside: BoolArray, depth: FloatPicture, generator: np.random.Generator) -> FloatPicture:
    """(h, w) depth of the plane around a surface, its mask (h, w), by the depths (h, w); NaN where there is none."""
    import cv2

    none = np.full(depth.shape, np.nan, dtype=np.float32)
    kernel = np.ones((2 * BORDER + 1, 2 * BORDER + 1), np.uint8)
    border = (cv2.dilate(inside.astype(np.uint8), kernel) > 0) & np.isfinite(depth)
    ys, xs = np.nonzero(border)
    if len(xs) < LEAST_BORDER:
        return none
    places = np.column_stack([xs, ys, np.ones(len(xs))]).astype(np.float64)
    inverse = 1 / depth[ys, xs].astype(np.float64)
    plane = _fitted_plane(places, inverse, generator)
    if plane is None:
        return none
    ratio = places @ plane / inverse
    on = np.abs(ratio - 1) < TOLERANCE
    if on.mean() < ON_PLANE or (ratio > 1 + 2 * TOLERANCE).mean() > BEHIND:  # above 1 the plane is the nearer one
        return none
    drawn = _drawn(plane, places[on, :2].astype(np.int64), depth.shape)
    return np.where(_nearest_elsewhere(drawn, depth), none, drawn)


def _nearest_elsewhere(drawn: FloatPicture, depth: FloatPicture) -> BoolArray:
    """(h, w) whether the nearest pixel with known depth (h, w) is of another object than the drawn plane (h, w)."""
    import cv2

    known = np.isfinite(depth)
    _, labels = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    with np.errstate(invalid="ignore"):
        elsewhere = np.abs(drawn / depth - 1) > ELSEWHERE  # False where either is unknown
    of_label = np.zeros(labels.max() + 1, dtype=bool)
    of_label[labels[known]] = elsewhere[known]
    return np.asarray(of_label[labels])


def _fitted_plane(places: FloatArray, inverse: FloatArray, generator: np.random.Generator) -> FloatArray | None:
    """(3,) a, b, c of the plane that most of the border fits: places (n, 3) as x, y, 1, inverse depths (n,)."""
    best = np.zeros(len(places), dtype=bool)
    for _ in range(TRIALS):
        three = generator.choice(len(places), 3, replace=False)
        if abs(np.linalg.det(places[three])) < 1.0:  # three pixels in a line
            continue
        on = np.abs(places @ np.linalg.solve(places[three], inverse[three]) / inverse - 1) < TOLERANCE
        best = on if on.sum() > best.sum() else best
    if best.sum() < LEAST_BORDER:
        return None
    return np.asarray(np.linalg.lstsq(places[best], inverse[best], rcond=None)[0])


def _drawn(plane: FloatArray, corners: IntArray, shape: tuple[int, ...]) -> FloatPicture:
    """(h, w) depth of a plane (3,) within the convex hull of pixels (n, 2), NaN elsewhere."""
    import cv2

    hull = np.zeros(shape, dtype=np.uint8)
    cv2.fillConvexPoly(hull, cv2.convexHull(corners.astype(np.int32)), 1)
    ys, xs = np.indices(shape)
    inverse = plane[0] * xs + plane[1] * ys + plane[2]
    return np.where((hull > 0) & (inverse > 0), 1 / np.maximum(inverse, 1e-12), np.nan).astype(np.float32)


def _deviation(grey: FloatPicture) -> FloatPicture:
    """(h, w) standard deviation of the grey levels over the window about each pixel."""
    import cv2

    mean = cv2.boxFilter(grey, -1, (WINDOW, WINDOW))
    square = cv2.boxFilter(grey * grey, -1, (WINDOW, WINDOW))
    return np.asarray(np.sqrt(np.maximum(square - mean * mean, 0)))
