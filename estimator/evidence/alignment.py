"""The scale between two sets of matched points, robust against wrong ones."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from metric_base.arrays import BoolArray, FloatArray

__all__ = ["Alignment", "align"]

#: Minimal samples that are tried, and the seed that makes an answer the same every time.
TRIALS, SEED = 500, 0

#: A pair is an inlier within this many times the median residual of the best sample, and never under a millionth of
#: the extent.
INLIER_TIMES = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """target ~ scale rotation source + translation over the inliers.

    scale : target units per source unit; sd_log : its standard deviation; residual : standard deviation of a target
    coordinate; extent : root mean square distance of the target's inliers from their middle; inliers : (n,) bool.
    """

    scale: float
    sd_log: float
    residual: float
    extent: float
    inliers: BoolArray


def align(source: FloatArray, target: FloatArray) -> Alignment | None:
    """The similarity from source (n, 3) to target (n, 3) by least median of squares, refined on its inliers.

    Umeyama 1991: with centred points X, Y and the singular values S of Y' X, scale = tr(S D) / |X|^2. None where fewer
    than three pairs are there or one of the sets has no extent.
    """
    n = len(source)
    if n < 3:
        return None
    generator = np.random.default_rng(SEED)
    best, least = None, math.inf
    for _ in range(TRIALS if n > 3 else 1):
        chosen = generator.choice(n, 3, replace=False) if n > 3 else np.arange(3)
        squares = _residuals(source, target, source[chosen], target[chosen])
        if squares is not None and float(np.median(squares)) < least:
            best, least = squares, float(np.median(squares))
    if best is None:
        return None
    floor = 1e-6 * float(np.ptp(target, axis=0).max())
    inliers = np.sqrt(best) <= max(INLIER_TIMES * math.sqrt(least), floor)
    return _refine(source, target, inliers)


def _refine(source: FloatArray, target: FloatArray, inliers: BoolArray) -> Alignment | None:
    squares = _residuals(source[inliers], target[inliers], source[inliers], target[inliers])
    scale = _similarity(source[inliers], target[inliers])
    m = int(inliers.sum())
    if squares is None or scale is None or m < 3:
        return None
    residual = math.sqrt(float(squares.sum()) / max(3 * m - 7, 1))
    centred = target[inliers] - target[inliers].mean(axis=0)
    extent = math.sqrt(float((centred**2).sum()) / m)
    # d ln(scale) = sum(x . noise) / sum(|x|^2) over the centred points
    return Alignment(scale[0], residual / (extent * math.sqrt(m)), residual, extent, inliers)


def _residuals(
    source: FloatArray, target: FloatArray, fit_source: FloatArray, fit_target: FloatArray
) -> FloatArray | None:
    """(n,) squared distances after the similarity of the fitted pairs, or None where there is none."""
    similarity = _similarity(fit_source, fit_target)
    if similarity is None:
        return None
    scale, rotation, translation = similarity
    return np.asarray(((scale * source @ rotation.T + translation - target) ** 2).sum(axis=1))


def _similarity(source: FloatArray, target: FloatArray) -> tuple[float, FloatArray, FloatArray] | None:
    middle, aim = source.mean(axis=0), target.mean(axis=0)
    x, y = source - middle, target - aim
    power = float((x**2).sum())
    if not power > 0 or not (y**2).sum() > 0:
        return None
    left, values, right = np.linalg.svd(y.T @ x)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = (left * signs) @ right
    scale = float((values * signs).sum()) / power
    return (scale, rotation, aim - scale * rotation @ middle) if scale > 0 else None
