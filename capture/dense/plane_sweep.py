"""Depth of a view by a plane sweep (Collins 1996), smoothed along four paths (Hirschmueller 2008).

The views are ideal cameras: their images are undistorted, at the size in which depth is computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.projection.cameras import project
from estimator.records.scene import View
from metric_base.arrays import FloatArray
from metric_base.images import checked_image

FloatImage = NDArray[np.float32]

#: Longer side in pixels of a depth map.
DEPTH_SIDE = 640
#: Number of planes, evenly spaced in inverse depth.
N_PLANES = 96
#: Side of the window in which images are compared, by normalised cross-correlation.
WINDOW = 7
#: Number of sources that count, the best ones: a point may be occluded in the others.
N_BEST_SOURCES = 2
#: Costs of a step of one plane, and of any other step, between neighbours; correlation costs 0 to 2.
SMALL_STEP, LARGE_STEP = 0.06, 0.45
#: Minimum correlation of a pixel with a depth, and minimum variance of grey levels of its window.
MIN_CORRELATION, MIN_VARIANCE = 0.5, 4.0
#: Ratio of depths within a window beyond which they belong to two objects.
EDGE_RATIO = 1.04


@dataclass(frozen=True, slots=True, eq=False)
class PinholeView:
    """A view without distortion, with the pose of a `View`."""

    grey: FloatImage  #: (h, w) grey levels.
    colour: NDArray[np.uint8]  #: (h, w, 3) RGB.
    matrix: FloatArray  #: (3, 3) K in OpenCV's pixels.
    rotation: FloatArray
    translation: FloatArray


def pinhole_view(view: View, images: Path) -> PinholeView:
    """Return a view with its image in a folder, undistorted; raises InputError if the image cannot be read."""
    camera = view.camera
    image = checked_image(images / view.name, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    factor = min(1.0, DEPTH_SIDE / max(camera.width, camera.height))
    width, height = round(camera.width * factor), round(camera.height * factor)
    focal = camera.focal_px * factor
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    rays = np.column_stack([(x.ravel() + 0.5 - width / 2) / focal, (y.ravel() + 0.5 - height / 2) / focal])
    pixels = project(camera, np.column_stack([rays, np.ones(len(rays))])) - 0.5
    pixels *= [image.shape[1] / camera.width, image.shape[0] / camera.height]  # the image may have another size
    sampled = np.nan_to_num(pixels, nan=-1e4).reshape(height, width, 2).astype(np.float32)
    colour = cv2.cvtColor(cv2.remap(image, sampled, None, cv2.INTER_LINEAR), cv2.COLOR_BGR2RGB)
    matrix = np.array([[focal, 0, width / 2 - 0.5], [0, focal, height / 2 - 0.5], [0, 0, 1.0]])
    grey = cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return PinholeView(grey, np.asarray(colour, dtype=np.uint8), matrix, view.rotation, view.translation)


def swept_depth(view: PinholeView, sources: Sequence[PinholeView], nearest: float, furthest: float) -> FloatImage:
    """Return the depth (h, w) along the optical axis in scene units, NaN if it is not reliable.

    Parameters
    ----------
    view : PinholeView
    sources : sequence of PinholeView
        Views to compare with.
    nearest, furthest : float
        Range of depths in scene units.
    """
    inverse = np.linspace(1 / furthest, 1 / nearest, N_PLANES)
    moments = _window_moments(view.grey)
    cost = np.empty((*view.grey.shape, N_PLANES), dtype=np.float32)
    for number, plane_depth in enumerate(1 / inverse):
        scores = np.stack([_correlation(moments, view, source, float(plane_depth)) for source in sources])
        scores.sort(axis=0)
        cost[:, :, number] = 1 - scores[-N_BEST_SOURCES:].mean(axis=0)

    total = np.zeros_like(cost)  # along paths from above, below, left and right
    for is_swapped in (False, True):
        lines = cost.swapaxes(0, 1) if is_swapped else cost
        sums = total.swapaxes(0, 1) if is_swapped else total
        for order in (range(len(lines)), range(len(lines) - 1, -1, -1)):
            path: FloatImage | None = None
            for line in order:
                path = lines[line].copy() if path is None else _next_cost(path, lines[line])
                sums[line] += path

    plane = total.argmin(axis=2)
    rows, columns = np.indices(plane.shape)
    inner = np.clip(plane, 1, N_PLANES - 2)  # the minimum by a parabola through three costs, within half a plane
    before, at, after = (total[rows, columns, inner + step] for step in (-1, 0, 1))
    bend = before - 2 * at + after
    offset = np.where(bend > 1e-6, (before - after) / (2 * np.maximum(bend, 1e-6)), 0)
    best = plane.astype(np.float32) + np.clip(offset, -0.5, 0.5).astype(np.float32)
    depth = 1 / np.interp(best, np.arange(N_PLANES), inverse)
    # the outermost planes collect all pixels that fit no other
    unsure = (1 - cost[rows, columns, plane] < MIN_CORRELATION) | (plane == 0) | (plane == N_PLANES - 1)
    unsure |= moments[1] < MIN_VARIANCE
    # a window enlarges a closer object by half its own width
    behind = cv2.dilate(depth.astype(np.float32), np.ones((WINDOW, WINDOW), np.uint8))
    unsure |= behind > EDGE_RATIO * depth
    return np.where(unsure, np.nan, depth).astype(np.float32)


def _window_moments(grey: FloatImage) -> tuple[FloatImage, FloatImage]:
    """Return mean and variance (h, w) of the window about each pixel."""
    mean = cv2.boxFilter(grey, -1, (WINDOW, WINDOW))
    return mean, np.maximum(cv2.boxFilter(grey * grey, -1, (WINDOW, WINDOW)) - mean * mean, 0)


def _correlation(
    moments: tuple[FloatImage, FloatImage], view: PinholeView, source: PinholeView, depth: float
) -> FloatImage:
    """Return the correlation (h, w) with a source if the view showed the plane at `depth`; -1 outside the source.

    x_source ~ K_s (R + t n^T / depth) K^-1 x, with the plane's normal n = (0, 0, 1) in the view's frame; `moments` are
    those of the view.
    """
    rotation = source.rotation @ view.rotation.T
    translation = source.translation - rotation @ view.translation
    motion = rotation.copy()
    motion[:, 2] += translation / depth
    homography = source.matrix @ motion @ np.linalg.inv(view.matrix)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = (view.grey.shape[1], view.grey.shape[0])
    warped = cv2.warpPerspective(source.grey, homography, size, flags=flags, borderValue=-1000.0)
    mean, variance = _window_moments(warped)
    product = cv2.boxFilter(view.grey * warped, -1, (WINDOW, WINDOW))
    covariance = product - moments[0] * mean
    score = covariance / np.sqrt(np.maximum(moments[1] * variance, MIN_VARIANCE))
    score[(variance > 1e4) | (mean < 0)] = -1.0  # the window extends beyond the source's border
    return np.asarray(score, dtype=np.float32)


def _next_cost(path: FloatImage, cost: FloatImage) -> FloatImage:
    """Return the next step (n, d) of a path: cost + min(same plane, one plane off + small, any + large) - min."""
    lowest = path.min(axis=1, keepdims=True)
    reached = np.minimum(path, lowest + LARGE_STEP)
    np.minimum(reached[:, 1:], path[:, :-1] + SMALL_STEP, out=reached[:, 1:])
    np.minimum(reached[:, :-1], path[:, 1:] + SMALL_STEP, out=reached[:, :-1])
    return np.asarray(cost + reached - lowest)
