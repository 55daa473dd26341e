"""The blur of a picture, by direction: a lens blurs all edges alike, a moving camera those across its way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["blur_layer", "blur_of", "gradients"]

#: Edges that show the blur: the strongest gradients of each direction, and of these the sharpest.
EDGE_SHARE, SHARPEST = 0.02, 0.3
#: Directions in which it is measured, over half a turn.
DIRECTIONS = 6
#: Blur is believed between these, in pixels (one sigma); the renderer's own is the first.
BLUR_PX = (0.35, 4.0)
#: Fewer pixels of a direction say nothing of it.
MIN_PIXELS = 400
#: One pixel in so many along each side says how strong the strongest edges are.
SAMPLED = 3
#: Pixels that the widest blur reaches.
REACH_PX = 12
_Grey = NDArray[np.float32]


def blur_of(grey: _Grey) -> NDArray[np.float64]:
    """(2, 2) covariance of the blur of a grey picture (h, w) in square pixels, from its strongest edges.

    Zhuo and Sim (2011): a step edge blurred by s has the gradient 1 / (sqrt(2 pi) s); blurred again by s0 it falls by
    the ratio R = sqrt(s^2 + s0^2) / s, so s = s0 / sqrt(R^2 - 1). Edges with the normal n have s^2 = n^T C n.
    """
    import cv2

    first, second = gradients(grey), gradients(cv2.GaussianBlur(grey, (0, 0), 1.0))
    size = cv2.magnitude(*first)
    # which way an edge looks is asked of few pixels for the limit, and of the strong ones
    some = np.s_[::SAMPLED, ::SAMPLED]
    usual, direction = size[some], _direction(first[0][some], first[1][some])
    limits = np.full(DIRECTIONS, np.inf, np.float32)
    for number in range(DIRECTIONS):
        own = usual[direction == number]
        if len(own) * SAMPLED**2 >= MIN_PIXELS:
            limits[number] = np.quantile(own, 1 - EDGE_SHARE)
    strong = np.flatnonzero(size >= limits.min())
    edges = [(across.ravel()[strong], down.ravel()[strong]) for across, down in (first, second)]
    direction, size = _direction(*edges[0]), size.ravel()[strong]
    rows, values = [], []
    for number in map(int, np.flatnonzero(np.isfinite(limits))):
        angle = np.pi * number / DIRECTIONS
        own = (direction == number) & (size >= limits[number])
        c, s = np.cos(angle), np.sin(angle)
        before, after = (np.abs(c * across[own] + s * down[own]) for across, down in edges)
        ratio = before / np.maximum(after, 1e-3)
        sigma = 1.0 / np.sqrt(np.maximum(ratio**2 - 1, 1e-3))
        # a pixel's own area blurs by 0.29, and the gradient's stencil by 0.7
        values.append(float(np.quantile(sigma, SHARPEST)) ** 2 - 0.5)
        rows.append([c * c, 2 * c * s, s * s])
    if len(rows) < 3:
        return np.eye(2) * BLUR_PX[0] ** 2
    xx, xy, yy = np.linalg.lstsq(np.array(rows), np.array(values), rcond=None)[0]
    return _with_widths(np.array([[xx, xy], [xy, yy]]), *BLUR_PX)


def _direction(across: _Grey, down: _Grey) -> NDArray[np.int64]:
    """Number of the direction, of DIRECTIONS over half a turn, that each gradient is nearest to; of any shape."""
    turn = np.arctan2(down, across) * np.float32(DIRECTIONS / np.pi)
    return np.asarray(np.rint(turn).astype(np.int64) % DIRECTIONS)


def blur_layer(layer: _Grey, covariance: NDArray[np.float64]) -> _Grey:
    """A layer (h, w, c) blurred by a picture's blur (2, 2), less the renderer's own."""
    import cv2

    rest = _with_widths(covariance - np.eye(2) * BLUR_PX[0] ** 2, 0.0, BLUR_PX[1])
    widest = float(np.sqrt(np.linalg.eigvalsh(rest)[1]))
    if widest < 0.15:
        return layer
    # a kernel of whole pixels cannot be narrower than this
    sharp = np.linalg.inv(rest + np.eye(2) * 0.15**2)
    reach = int(np.ceil(3 * widest))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    kernel = np.exp(-0.5 * (sharp[0, 0] * x * x + 2 * sharp[0, 1] * x * y + sharp[1, 1] * y * y))
    kernel = (kernel / kernel.sum()).astype(np.float32)
    return np.asarray(cv2.filter2D(layer, -1, kernel, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)


def gradients(grey: _Grey) -> tuple[_Grey, _Grey]:
    """Gradients (h, w) of a grey picture (h, w) in levels per pixel, to the right and down."""
    import cv2

    row = np.array([[-0.5, 0, 0.5]], np.float32)
    across, down = cv2.filter2D(grey, cv2.CV_32F, row), cv2.filter2D(grey, cv2.CV_32F, row.T)
    return np.asarray(across, dtype=np.float32), np.asarray(down, dtype=np.float32)


def _with_widths(covariance: NDArray[np.float64], least: float, most: float) -> NDArray[np.float64]:
    """A covariance (2, 2) whose widths are between two, in pixels."""
    squares, axes = np.linalg.eigh(covariance)
    return np.asarray((axes * np.clip(squares, least**2, most**2)) @ axes.T)
