"""Depth of one view by sweeping planes through it (Collins 1996), smoothed along four paths (Hirschmueller 2008).

Views as ideal cameras: their pictures without the lens's distortion, at the size that depth is computed in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.projection.cameras import project
from estimator.records.scene import View
from metric_base.arrays import FloatArray
from metric_base.errors import InputError, Unquoted

#: Longer side in pixels.
SIDE = 640
FloatPicture = NDArray[np.float32]
#: Planes, evenly spaced in inverse depth.
PLANES = 96
#: Side of the window in which pictures are compared, by normalised cross-correlation.
WINDOW = 7
#: Of the sources the best two count: an object hidden in the others costs nothing.
BEST = 2
#: Costs of a step of one plane, and of any other step, between neighbours; correlation costs 0 to 2.
SMALL_STEP, LARGE_STEP = 0.06, 0.45
#: Correlation below which a pixel has no depth, and variance of grey levels below which it has none to correlate.
LEAST_CORRELATION = 0.5
LEAST_VARIANCE = 4.0
#: Depths within a window that differ by this factor are of two objects.
EDGE = 1.04


@dataclass(frozen=True, slots=True, eq=False)
class PinholeView:
    """grey : (h, w) grey levels; colour : (h, w, 3) RGB; matrix : (3, 3) K for OpenCV's pixels; pose as of a `View`."""

    grey: NDArray[np.float32]
    colour: NDArray[np.uint8]
    matrix: FloatArray
    rotation: FloatArray
    translation: FloatArray


def pinhole_view(view: View, pictures: Path) -> PinholeView:
    """The view with the picture of its name in a folder, undistorted by COLMAP's own camera.

    Raises
    ------
    InputError
        The picture cannot be read.
    """
    import cv2

    camera = view.camera
    picture = cv2.imread(str(pictures / view.name), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if picture is None:
        raise InputError.at(pictures / view.name, "picture", "a picture that OpenCV reads", Unquoted("none"))
    factor = min(1.0, SIDE / max(camera.width, camera.height))
    width, height = round(camera.width * factor), round(camera.height * factor)
    focal = camera.focal_px * factor
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    rays = np.column_stack([(x.ravel() + 0.5 - width / 2) / focal, (y.ravel() + 0.5 - height / 2) / focal])
    pixels = project(camera, np.column_stack([rays, np.ones(len(rays))])) - 0.5
    # the picture may be of another size than its camera
    pixels *= [picture.shape[1] / camera.width, picture.shape[0] / camera.height]
    across = np.nan_to_num(pixels, nan=-1e4).reshape(height, width, 2).astype(np.float32)
    colour = cv2.cvtColor(cv2.remap(picture, across, None, cv2.INTER_LINEAR), cv2.COLOR_BGR2RGB)
    matrix = np.array([[focal, 0, width / 2 - 0.5], [0, focal, height / 2 - 0.5], [0, 0, 1.0]])
    grey = cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return PinholeView(grey, np.asarray(colour, dtype=np.uint8), matrix, view.rotation, view.translation)


@dataclass(frozen=True, slots=True, eq=False)
class _WindowMoments:
    """A picture with its mean and variance over the window about each pixel."""

    grey: FloatPicture
    mean: FloatPicture
    variance: FloatPicture


def swept_depth(view: PinholeView, sources: Sequence[PinholeView], nearest: float, furthest: float) -> FloatPicture:
    """(h, w) depth along the optical axis in scene units, NaN where none is reliable.

    nearest, furthest : the depths swept, in scene units.
    """
    inverse = np.linspace(1 / furthest, 1 / nearest, PLANES)
    cost = _cost_volume(view, sources, 1 / inverse)
    smooth = _aggregate(cost)
    plane = smooth.argmin(axis=2)
    rows, columns = np.indices(plane.shape)
    correlation = 1 - cost[rows, columns, plane]
    best = plane.astype(np.float32) + _parabola(smooth, plane)
    depth = 1 / np.interp(best, np.arange(PLANES), inverse)
    # the outermost planes collect whatever fits nowhere
    unsure = (correlation < LEAST_CORRELATION) | (plane == 0) | (plane == PLANES - 1)
    unsure |= _window(view.grey).variance < LEAST_VARIANCE
    unsure |= _fattening_mask(depth)
    return np.where(unsure, np.nan, depth).astype(np.float32)


def _fattening_mask(depth: FloatArray) -> NDArray[np.bool_]:
    """(h, w) pixels near the edge of a nearer object: the window makes it wider by half of itself."""
    import cv2

    behind = cv2.dilate(depth.astype(np.float32), np.ones((WINDOW, WINDOW), np.uint8))
    return np.asarray(behind > EDGE * depth)


def _cost_volume(view: PinholeView, sources: Sequence[PinholeView], depths: FloatArray) -> FloatPicture:
    """(h, w, d) one minus the mean of the best correlations with the sources at each depth."""
    here = _window(view.grey)
    height, width = view.grey.shape
    volume = np.empty((height, width, len(depths)), dtype=np.float32)
    for number, depth in enumerate(depths):
        scores = np.stack([_correlation(here, view, source, float(depth)) for source in sources])
        scores.sort(axis=0)
        volume[:, :, number] = 1 - scores[-BEST:].mean(axis=0)
    return volume


def _correlation(here: _WindowMoments, view: PinholeView, source: PinholeView, depth: float) -> FloatPicture:
    """(h, w) correlation with a source if the view showed the plane at `depth`; -1 outside the source.

    x_source ~ K_s (R + t n^T / depth) K^-1 x, with the plane's normal n = (0, 0, 1) in the view's frame.
    """
    import cv2

    rotation = source.rotation @ view.rotation.T
    translation = source.translation - rotation @ view.translation
    across = rotation.copy()
    across[:, 2] += translation / depth
    homography = source.matrix @ across @ np.linalg.inv(view.matrix)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = (view.grey.shape[1], view.grey.shape[0])
    warped = cv2.warpPerspective(source.grey, homography, size, flags=flags, borderValue=-1000.0)
    there = _window(warped)
    product = cv2.boxFilter(here.grey * warped, -1, (WINDOW, WINDOW))
    covariance = product - here.mean * there.mean
    score = covariance / np.sqrt(np.maximum(here.variance * there.variance, LEAST_VARIANCE))
    score[(there.variance > 1e4) | (there.mean < 0)] = -1.0  # the window reaches over the source's border
    return np.asarray(score, dtype=np.float32)


def _window(grey: FloatPicture) -> _WindowMoments:
    """Mean and deviation of every window of a picture (h, w)."""
    import cv2

    mean = cv2.boxFilter(grey, -1, (WINDOW, WINDOW))
    return _WindowMoments(grey, mean, np.maximum(cv2.boxFilter(grey * grey, -1, (WINDOW, WINDOW)) - mean * mean, 0))


def _aggregate(cost: FloatPicture) -> FloatPicture:
    """(h, w, d) the cost summed along paths from above, below, left and right."""
    total = np.zeros_like(cost)
    for swapped in (False, True):
        lines = cost.swapaxes(0, 1) if swapped else cost
        sums = total.swapaxes(0, 1) if swapped else total
        for order in (range(len(lines)), range(len(lines) - 1, -1, -1)):
            path: FloatPicture | None = None
            for line in order:
                path = lines[line].copy() if path is None else _next(path, lines[line])
                sums[line] += path
    return total


def _next(path: FloatPicture, cost: FloatPicture) -> FloatPicture:
    """(n, d) the next step: cost + min(same plane, one plane off + small, any + large) - min."""
    least = path.min(axis=1, keepdims=True)
    reached = np.minimum(path, least + LARGE_STEP)
    np.minimum(reached[:, 1:], path[:, :-1] + SMALL_STEP, out=reached[:, 1:])
    np.minimum(reached[:, :-1], path[:, 1:] + SMALL_STEP, out=reached[:, :-1])
    return np.asarray(cost + reached - least)


def _parabola(cost: FloatPicture, plane: NDArray[np.intp]) -> FloatPicture:
    """(h, w) offset of the minimum from its plane, by a parabola through three costs, within half a plane."""
    inner = np.clip(plane, 1, PLANES - 2)
    rows, columns = np.indices(plane.shape)
    before, at, after = (cost[rows, columns, inner + step] for step in (-1, 0, 1))
    bend = before - 2 * at + after
    offset = np.where(bend > 1e-6, (before - after) / (2 * np.maximum(bend, 1e-6)), 0)
    return np.clip(offset, -0.5, 0.5).astype(np.float32)
