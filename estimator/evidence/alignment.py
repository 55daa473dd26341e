"""Robust similarity between two sets of matched points."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from metric_base.arrays import BoolArray, FloatArray, IntArray

#: Number of minimal samples, and the seed for reproducible results.
N_SAMPLES = 500
SEED = 0
#: Number of batches of samples, which limits the memory.
SAMPLE_BATCHES = 10
#: Maximum residual of an inlier, relative to the median residual of the best sample.
MAX_INLIER_RESIDUALS = 3.0
#: Minimum of this limit relative to the extent of the target, for exact data.
MIN_INLIER_EXTENT = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """The similarity target = scale rotation source + translation."""

    scale: float  #: Target units per source unit.
    sd_log: float  #: Standard deviation of its natural log.
    residual: float  #: Standard deviation of a target coordinate, in target units.
    extent: float  #: Root mean square distance of the target inliers from their mean, in target units.
    inliers: BoolArray  #: (n,)
    rotation: FloatArray  #: (3, 3)


def align(source: FloatArray, target: FloatArray) -> Alignment | None:
    """Estimate the similarity from source (n, 3) to target (n, 3) by least median of squares, refined on its inliers.

    With centred points X, Y and the singular values S of Y' X, scale = tr(S D) / ``|X|^2`` (Umeyama 1991).

    Returns
    -------
    Alignment or None
        None for fewer than three pairs, or if one of the sets has no extent.

    Notes
    -----
    `estimate_sim3d_robust` of pycolmap 4.2.1 returns None if the target is exactly planar, such as a marker or GPS with
    one altitude, and needs a threshold for inliers, which is unknown.
    """
    n = len(source)
    if n < 3:
        return None
    best, lowest = None, math.inf
    samples = minimal_samples(n)
    for part in np.array_split(samples, min(SAMPLE_BATCHES, len(samples))):
        squares = _residuals(source, target, source[part], target[part])
        median = np.median(squares, axis=1)
        row = int(np.argmin(median))
        if median[row] < lowest:
            best, lowest = squares[row], float(median[row])
    if best is None:
        return None
    min_limit = MIN_INLIER_EXTENT * float(np.ptp(target, axis=0).max())
    inliers = np.sqrt(best) <= max(MAX_INLIER_RESIDUALS * math.sqrt(lowest), min_limit)
    return least_squares(source, target, inliers)


def minimal_samples(n: int) -> IntArray:
    """Return the indices (t, 3) of minimal samples, each of three different ones among n."""
    if n == 3:
        return np.array([[0, 1, 2]])
    drawn = np.random.default_rng(SEED).integers(n, size=(N_SAMPLES, 3))
    one, two, three = drawn.T
    return np.asarray(drawn[(one != two) & (two != three) & (one != three)])


def least_squares(source: FloatArray, target: FloatArray, inliers: BoolArray) -> Alignment | None:
    """Estimate the similarity from source (n, 3) to target (n, 3) by least squares over the inliers (n,).

    None for fewer than three inliers.
    """
    x, y = source[inliers], target[inliers]
    m = len(x)
    if m < 3:
        return None
    (scale,), (rotation,), _ = _similarities(x[None], y[None])
    if not scale > 0:
        return None
    residual = math.sqrt(float(_residuals(x, y, x[None], y[None]).sum()) / max(3 * m - 7, 1))
    centred = y - y.mean(axis=0)
    extent = math.sqrt(float((centred**2).sum()) / m)
    # d ln(scale) = sum(x . noise) / sum(|x|^2) over the centred points.
    return Alignment(float(scale), residual / (extent * math.sqrt(m)), residual, extent, inliers, rotation)


def _residuals(source: FloatArray, target: FloatArray, fit_source: FloatArray, fit_target: FloatArray) -> FloatArray:
    """Return the squared residuals (t, n) of the similarities of t sets (t, k, 3); infinite for a set without one."""
    scale, rotation, translation = _similarities(fit_source, fit_target)
    transformed = scale[:, None, None] * (source @ rotation.transpose(0, 2, 1)) + translation[:, None]
    squares = ((transformed - target) ** 2).sum(axis=2)
    squares[~(scale > 0)] = np.inf
    return np.asarray(squares)


def _similarities(source: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return scales (t,), rotations (t, 3, 3) and translations (t, 3) of t sets (t, k, 3); scale 0 without one."""
    source_mean, target_mean = source.mean(axis=1), target.mean(axis=1)
    x, y = source - source_mean[:, None], target - target_mean[:, None]
    power = (x**2).sum(axis=(1, 2))
    left, values, right = np.linalg.svd(y.transpose(0, 2, 1) @ x)
    signs = np.ones_like(values)
    signs[:, 2] = np.sign(np.linalg.det(left @ right))
    rotation = (left * signs[:, None]) @ right
    scale = np.divide((values * signs).sum(axis=1), power, out=np.zeros_like(power), where=power > 0)
    scale = np.where((y**2).sum(axis=(1, 2)) > 0, np.maximum(scale, 0), 0)
    return scale, rotation, target_mean - scale[:, None] * (rotation @ source_mean[:, :, None])[:, :, 0]
