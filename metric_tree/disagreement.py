"""How sources of one class disagree: a random effect per source and its covariance (methods.md, "Priors").

Rows of source s scatter around mu + e_s with covariance W; e_s ~ N(0, B). For any weights a_s of the source means,
with A = sum a_s and n_s the rows of a source (DerSimonian and Laird 1986, in matrix form),

    E[ sum_s a_s (m_s - mu)(m_s - mu)' ] = B (A - sum a_s^2 / A) + W sum_s (a_s - a_s^2 / A) / n_s

B follows by the method of moments, entry by entry over the sources that state both axes, then made positive.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from metric_tree.prior import FloatArray

__all__ = ["Disagreement", "disagreement", "pooled_covariance", "shared_covariance", "source_effects"]

#: Rows at which a source's mean has half of its largest weight among the source means. The disagreement between
#: sources is about a third to a half of the spread within, so that a handful of rows already places a source.
MEAN_HALF = 5.0

#: A class's own estimate of B counts as many sources as it has, less one; the pooled default counts this many.
POOLED_SOURCES = 4.0

#: Disagreement that is assumed before any class is seen, as a standard deviation of ln size, and the classes it counts.
#: Makers of the same thing differ by a tenth or so; replaced by the data as soon as some classes have three sources.
ASSUMED_SD = 0.12
ASSUMED_SOURCES = 5.0

#: Correlation of the assumed disagreement between axes: sources differ in size more than in proportion.
ASSUMED_CORRELATION = 0.5

#: Largest variance that one class may bring to the pool: a disagreement of a factor 1.65 is a mixed class.
LARGEST_SD = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Disagreement:
    """Of one class, over ln mm.

    sources : (s,) names; means : (s, d), NaN where unstated; rows : (s, d) effective rows; within : (d, d) covariance
    within a source; between : (d, d) covariance between sources; freedom : sources less one.
    """

    sources: tuple[str, ...]
    means: FloatArray
    rows: FloatArray
    within: FloatArray
    between: FloatArray
    freedom: float


def disagreement(
    x: FloatArray, known: FloatArray, weights: FloatArray, sources: Sequence[str], spread: FloatArray
) -> Disagreement:
    """Source means of a class and the method-of-moments covariance between them.

    Parameters
    ----------
    x : (n, d) ln mm, completed; known : (n, d) probability that the axis was stated; weights : (n,)
    sources : (n,) names; spread : (d, d) covariance of the class, used within a source where one row is all it has
    """
    names, code = np.unique(np.asarray(sources), return_inverse=True)
    mass = (np.arange(len(names))[:, None] == code) * weights  # (s, n)
    per_axis = mass @ known  # (s, d)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = (mass @ (known * x)) / per_axis
        rows = per_axis**2 / (mass**2 @ known**2)
    means[per_axis <= 0] = np.nan
    rows[per_axis <= 0] = 0.0
    within = _within(x, known, mass, np.nan_to_num(means)[code], rows, spread)
    between = _moments(means, rows, within)
    freedom = max(float((rows > 0).sum(axis=0).max()) - 1, 0.0)
    return Disagreement(tuple(map(str, names)), means, rows, within, between, freedom)


def pooled_covariance(classes: Iterable[Disagreement]) -> FloatArray:
    """Default of B over classes of one frame, (d, d), each weighted by its sources less one."""
    d = 3
    assumed = ASSUMED_SD**2 * (ASSUMED_CORRELATION + (1 - ASSUMED_CORRELATION) * np.eye(d))
    total, mass = assumed * ASSUMED_SOURCES, ASSUMED_SOURCES
    for found in classes:
        if found.freedom >= 2:
            largest = max(float(np.diag(found.between).max()), 1e-12)
            total = total + found.freedom * found.between * min(1.0, LARGEST_SD**2 / largest)
            mass += found.freedom
    return np.asarray(total / mass)


def shared_covariance(found: Disagreement, pooled: FloatArray) -> FloatArray:
    """B of one class, (d, d): its own estimate and the pooled default, each by the sources it counts."""
    return np.asarray((found.freedom * found.between + POOLED_SOURCES * pooled) / (found.freedom + POOLED_SOURCES))


def source_effects(found: Disagreement, shared: FloatArray) -> FloatArray:
    """Best linear prediction of e_s, (s, d): B (B + W / n_s)^-1 (m_s - mu) over the axes that source states."""
    effects = np.zeros_like(found.means)
    weight = found.rows / (1 + found.rows / MEAN_HALF)
    with np.errstate(invalid="ignore", divide="ignore"):
        centre = np.nansum(weight * found.means, axis=0) / weight.sum(axis=0)
    for s, rows in enumerate(found.rows):
        axes = np.flatnonzero(rows > 0)
        if len(axes):
            block = np.ix_(axes, axes)
            noise = found.within[block] / np.sqrt(np.outer(rows[axes], rows[axes]))
            gain = np.linalg.solve(shared[block] + noise, (found.means[s] - centre)[axes])
            effects[s] = shared[:, axes] @ gain
    return effects


def _within(
    x: FloatArray, known: FloatArray, mass: FloatArray, centre: FloatArray, rows: FloatArray, spread: FloatArray
) -> FloatArray:
    """Pooled covariance within a source; a source's own mean takes one of its effective rows."""
    weights = mass.sum(axis=0)  # (n,)
    offset = known * (x - centre)
    own = (weights[:, None] * offset).T @ offset
    per_source = np.einsum("sn,ni,nj->sij", mass, known, known)
    free = 1 - 1 / np.maximum(np.sqrt(rows[:, :, None] * rows[:, None, :]), 1)
    # one row's worth of the class's own spread: sources of one row have no scatter, which is no evidence of none
    typical = float((weights**2).sum() / weights.sum())
    return np.asarray((own + typical * spread) / ((per_source * free).sum(axis=0) + typical))


def _moments(means: FloatArray, rows: FloatArray, within: FloatArray) -> FloatArray:
    d = means.shape[1]
    between = np.zeros((d, d))
    for i, j in zip(*np.triu_indices(d), strict=True):
        usable = (rows[:, i] > 0) & (rows[:, j] > 0)
        n = np.sqrt(rows[usable, i] * rows[usable, j])
        a = n / (1 + n / MEAN_HALF)
        if usable.sum() >= 2:
            total, two = a.sum(), means[usable][:, [i, j]]
            offset = two - (a @ two) / total
            moment = float(a @ offset.prod(axis=1)) - within[i, j] * float(((a - a**2 / total) / n).sum())
            between[i, j] = between[j, i] = moment / (total - (a**2).sum() / total)
    return _positive(between)


def _positive(matrix: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
