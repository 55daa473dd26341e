"""Intraclass correlation of ln size over rooms: the fraction of variance that objects of one room have in common.

One-way random effects on ln size, ln x_ri = mu + a_r + e_ri over rooms r, with the intraclass correlation
t = Var(a) / (Var(a) + Var(e)). With the mean squares between and within rooms and n_0 the effective objects of a room
(Searle, Casella and McCulloch 1992, Variance Components, 3.6),

    t = (MSB - MSW) / (MSB + (n_0 - 1) MSW)
    Var(t) = 2 (N - 1) (1 - t)^2 (1 + (n_0 - 1) t)^2 / (n_0^2 (N - k) (k - 1))

for N objects in k rooms (Swiger and others 1964). Classes are shrunk towards their common mean by a random-effects
model (DerSimonian and Laird 1986). Releases call the correlation `sameness`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_base.statistics import robust_sigma

#: Minimum number of rooms with two objects or more for an estimate.
MIN_SCENES = 8

#: Robust standard deviations at which a size is clipped: a box that includes a wall is no evidence of variety.
CLIP_SIGMAS = 3.0

#: Minimum robust standard deviation of ln size for the clipping.
MIN_CLIP_SD = 0.02

#: Mean and standard deviation over the classes of ScanNet, rounded: for a tree without known rooms.
DEFAULT_MEAN, DEFAULT_SD = 0.45, 0.2

#: Minimum number of classes for an estimate of their common mean.
MIN_CLASSES = 3

#: Minimum standard deviation of the correlation between classes.
MIN_BETWEEN_SD = 0.05

#: Maximum correlation of an estimate; the variance formula is zero at 1.
MAX_CORRELATION = 0.99


@dataclass(frozen=True, slots=True)
class IntraclassCorrelation:
    """An intraclass correlation with its standard deviation."""

    value: float  #: 0 to 1.
    sd: float


def class_correlation(x: FloatArray, source: NDArray[np.str_], scene: NDArray[np.str_]) -> IntraclassCorrelation | None:
    """Estimate the intraclass correlation of one class; None if fewer than `MIN_SCENES` rooms have several objects.

    Only the source with the most objects in known rooms is used, because data sets of the same rooms contain the same
    objects.

    Parameters
    ----------
    x : (n, d) float
        ln size, NaN if not stated.
    source, scene : (n,) str
        Names; a scene is empty if unknown.
    """
    known = scene != ""
    if not known.any():
        return None
    names, counts = np.unique(source[known], return_counts=True)
    chosen = known & (source == names[np.argmax(counts)])
    parts = [part for column in x.T if (part := axis_correlation(column[chosen], scene[chosen])) is not None]
    if not parts:
        return None
    precision = np.array([1 / part.sd**2 for part in parts])
    value = float(precision @ [part.value for part in parts] / precision.sum())
    return IntraclassCorrelation(value, float(np.sqrt(1 / precision.max())))  # axes of one object are dependent


def axis_correlation(x: FloatArray, scene: NDArray[np.str_]) -> IntraclassCorrelation | None:
    """Estimate the intraclass correlation on one axis: x (n,) ln size, NaN if not stated, scene (n,) names."""
    known = ~np.isnan(x)
    x, scene = x[known], scene[known]
    if len(x) == 0:
        return None
    centre, limit = np.median(x), CLIP_SIGMAS * max(robust_sigma(x), MIN_CLIP_SD)
    x = np.clip(x, centre - limit, centre + limit)
    _, code, counts = np.unique(scene, return_inverse=True, return_counts=True)
    n, k = len(x), len(counts)
    if (counts >= 2).sum() < MIN_SCENES:
        return None
    means = np.bincount(code, x) / counts
    between = float(counts @ (means - x.mean()) ** 2) / (k - 1)
    within = float(((x - means[code]) ** 2).sum()) / (n - k)
    per_room = (n - (counts**2).sum() / n) / (k - 1)
    if between + within <= 0:
        return None
    value = float(np.clip((between - within) / (between + (per_room - 1) * within), 0.0, MAX_CORRELATION))
    variance = 2 * (n - 1) * (1 - value) ** 2 * (1 + (per_room - 1) * value) ** 2 / (per_room**2 * (n - k) * (k - 1))
    return IntraclassCorrelation(value, float(np.sqrt(max(variance, 1e-4))))


def shrunk_correlations(
    classes: Mapping[str, IntraclassCorrelation],
) -> tuple[dict[str, IntraclassCorrelation], IntraclassCorrelation]:
    """Shrink the classes to their common mean (DerSimonian and Laird 1986); also return the prior of a further class.

    With fewer than `MIN_CLASSES` classes none is returned, and the prior is the default.
    """
    if len(classes) < MIN_CLASSES:
        return {}, IntraclassCorrelation(DEFAULT_MEAN, DEFAULT_SD)
    value = np.array([one.value for one in classes.values()])
    variance = np.array([one.sd**2 for one in classes.values()])
    weight = 1 / variance
    mean = weight @ value / weight.sum()
    excess = weight @ (value - mean) ** 2 - (len(value) - 1)
    between = max(float(excess / (weight.sum() - (weight**2).sum() / weight.sum())), MIN_BETWEEN_SD**2)
    weight = 1 / (variance + between)
    mean = float(weight @ value / weight.sum())
    shrunk = {
        name: IntraclassCorrelation(
            float(np.clip((one.value / one.sd**2 + mean / between) / (1 / one.sd**2 + 1 / between), 0.0, 1.0)),
            float(np.sqrt(1 / (1 / one.sd**2 + 1 / between))),
        )
        for name, one in classes.items()
    }
    return shrunk, IntraclassCorrelation(mean, float(np.sqrt(between + 1 / weight.sum())))
