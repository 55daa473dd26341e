"""The scale between two sets of matched points, robust against wrong ones."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from metric_base.arrays import BoolArray, FloatArray, IntArray

#: Minimal samples that are tried, and the seed that makes an answer the same every time.
TRIALS, SEED = 500, 0
#: Parts in which they are tried, for the memory of many pairs.
ALIGNMENT_PARTS = 10

#: A pair is an inlier within this many times the median residual of the best sample, and never under a millionth of
#: the extent.
INLIER_TIMES = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """target ~ scale rotation source + translation over the inliers.

    scale : target units per source unit; sd_log : its standard deviation; residual : standard deviation of a target
    coordinate; extent : root mean square distance of the target's inliers from their middle; inliers : (n,) bool;
    rotation : (3, 3).
    """

    scale: float
    sd_log: float
    residual: float
    extent: float
    inliers: BoolArray
    rotation: FloatArray


def align(source: FloatArray, target: FloatArray) -> Alignment | None:
    """The similarity from source (n, 3) to target (n, 3) by least median of squares, refined on its inliers.

    pycolmap's LO-RANSAC (`estimate_sim3d_robust`, 4.2.1) gives none where the target is exactly flat, as a marker is
    and as GPS with one altitude is, and wants a bound for inliers, which nobody knows before.

    Umeyama 1991: with centred points X, Y and the singular values S of Y' X, scale = tr(S D) / |X|^2. None where fewer
    than three pairs are there or one of the sets has no extent.
    """
    n = len(source)
    if n < 3:
        return None
    best, least = None, math.inf
    samples = _samples(n)
    for part in np.array_split(samples, min(ALIGNMENT_PARTS, len(samples))):
        squares = _residuals(source, target, source[part], target[part])
        middle = np.median(squares, axis=1)
        row = int(np.argmin(middle))
        if middle[row] < least:
            best, least = squares[row], float(middle[row])
    if best is None:
        return None
    floor = 1e-6 * float(np.ptp(target, axis=0).max())
    inliers = np.sqrt(best) <= max(INLIER_TIMES * math.sqrt(least), floor)
    return least_squares(source, target, inliers)


def _samples(n: int) -> IntArray:
    """(t, 3) rows of minimal samples, three different ones of n each."""
    if n == 3:
        return np.array([[0, 1, 2]])
    drawn = np.random.default_rng(SEED).integers(n, size=(TRIALS, 3))
    one, two, three = drawn.T
    return np.asarray(drawn[(one != two) & (two != three) & (one != three)])


def least_squares(source: FloatArray, target: FloatArray, inliers: BoolArray) -> Alignment | None:
    """The alignment of source (n, 3) with target (n, 3) by least squares over the inliers (n,); None of under three."""
    own, aim = source[inliers], target[inliers]
    m = len(own)
    if m < 3:
        return None
    (scale,), (rotation,), _ = _similarities(own[None], aim[None])
    if not scale > 0:
        return None
    residual = math.sqrt(float(_residuals(own, aim, own[None], aim[None]).sum()) / max(3 * m - 7, 1))
    centred = aim - aim.mean(axis=0)
    extent = math.sqrt(float((centred**2).sum()) / m)
    # d ln(scale) = sum(x . noise) / sum(|x|^2) over the centred points
    return Alignment(float(scale), residual / (extent * math.sqrt(m)), residual, extent, inliers, rotation)


def _residuals(source: FloatArray, target: FloatArray, fit_source: FloatArray, fit_target: FloatArray) -> FloatArray:
    """(t, n) squared distances after each of the similarities of t sets (t, k, 3); infinite for a set that has none."""
    scale, rotation, translation = _similarities(fit_source, fit_target)
    placed = scale[:, None, None] * (source @ rotation.transpose(0, 2, 1)) + translation[:, None]
    squares = ((placed - target) ** 2).sum(axis=2)
    squares[~(scale > 0)] = np.inf
    return np.asarray(squares)


def _similarities(source: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Scales (t,), rotations (t, 3, 3), translations (t, 3) of t sets (t, k, 3); scale 0 where there is none."""
    middle, aim = source.mean(axis=1), target.mean(axis=1)
    x, y = source - middle[:, None], target - aim[:, None]
    power = (x**2).sum(axis=(1, 2))
    left, values, right = np.linalg.svd(y.transpose(0, 2, 1) @ x)
    signs = np.ones_like(values)
    signs[:, 2] = np.sign(np.linalg.det(left @ right))
    rotation = (left * signs[:, None]) @ right
    scale = np.divide((values * signs).sum(axis=1), power, out=np.zeros_like(power), where=power > 0)
    scale = np.where((y**2).sum(axis=(1, 2)) > 0, np.maximum(scale, 0), 0)
    return scale, rotation, aim - scale[:, None] * (rotation @ middle[:, :, None])[:, :, 0]
