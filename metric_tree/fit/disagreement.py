"""How sources of one class disagree: the mean of each source and the covariance between them.

Rows of source s scatter around mu + e_s with covariance W; e_s ~ N(0, B). For any weights a_s of the source means,
with A = sum a_s and n_s the rows of a source (DerSimonian and Laird 1986, in matrix form),

    E[ sum_s a_s (m_s - mu)(m_s - mu)' ] = B (A - sum a_s^2 / A) + W sum_s (a_s - a_s^2 / A) / n_s

B follows by the method of moments, entry by entry over the sources that state both axes, then made positive. Only
products, measurements, norms and statistics of measurements count for B: an artist's model says nothing of how two
shops differ. What all classes together say of B is `metric_tree.fit.kinds`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from metric_base.arrays import FloatArray

__all__ = ["CERTAIN_ROWS", "Disagreement", "disagreement", "no_disagreement", "with_statements"]

#: Rows at which a source's mean has half of its largest weight among the source means. The disagreement between
#: sources is about a third to a half of the spread within, so that a handful of rows already places a source.
MEAN_HALF = 5.0

#: Kinds whose disagreement is that of the sizes of objects in the world.
WORLD_KINDS = frozenset({"product", "measured", "standard", "statistic"})

#: Rows that a statement about many objects stands for: its mean has no sampling error worth the name.
CERTAIN_ROWS = 1e6

#: Rows of a source from which its own spread is known.
SPREAD_ROWS = 8.0

#: Least standard deviation of ln size within a source, along any direction: a hundredth.
LEAST_SD = 0.01

#: Expected rows of a source on an axis below which it states nothing of it: an order of axes that is all but excluded
#: has a probability whose square is zero in floating point.
LEAST_MASS = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Disagreement:
    """Of one class, over ln mm.

    sources : (s,) names; kinds : (s,) of their rows; means : (s, d), NaN where unstated; rows : (s, d) effective rows;
    within : (d, d) covariance within a source; between : (d, d) covariance between sources; freedom : sources of the
    world less one; spreads : (s,) standard deviation within each source, the mean over its axes, NaN of few rows.
    """

    sources: tuple[str, ...]
    kinds: tuple[str, ...]
    means: FloatArray
    rows: FloatArray
    within: FloatArray
    between: FloatArray
    freedom: float
    spreads: FloatArray


def disagreement(
    x: FloatArray,
    known: FloatArray,
    weights: FloatArray,
    sources: Sequence[str],
    kinds: Sequence[str],
    spread: FloatArray,
) -> Disagreement:
    """Source means of a class and the method-of-moments covariance between them.

    Parameters
    ----------
    x : (n, d) ln mm, completed; known : (n, d) probability that the axis was stated; weights : (n,)
    sources, kinds : (n,) names; spread : (d, d) covariance of the class, which stands in where sources have one row
    """
    names, first, code = np.unique(np.asarray(sources), return_index=True, return_inverse=True)
    mass = (np.arange(len(names))[:, None] == code) * weights  # (s, n)
    per_axis = mass @ known  # (s, d)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = (mass @ (known * x)) / per_axis
        rows = per_axis**2 / (mass**2 @ known**2)
    unstated = per_axis <= LEAST_MASS
    means[unstated], rows[unstated] = np.nan, 0.0
    within = _within(x, known, mass, np.nan_to_num(means)[code], rows, spread)
    own_kinds = tuple(kinds[row] for row in first)
    spreads = _spreads(x, known, mass, means, rows)
    return _with_source_covariance(
        Disagreement(tuple(map(str, names)), own_kinds, means, rows, within, within, 0.0, spreads)
    )


def with_statements(one: Disagreement, names: Sequence[str], kinds: Sequence[str], means: FloatArray) -> Disagreement:
    """With sources that state sizes of many objects: norms, ranges, means; means (s, d) in ln mm, NaN unstated."""
    if not len(names):
        return one
    rows = np.where(np.isnan(means), 0.0, CERTAIN_ROWS)
    return _with_source_covariance(
        replace(
            one,
            sources=(*one.sources, *names),
            kinds=(*one.kinds, *kinds),
            means=np.concatenate([one.means, means]),
            rows=np.concatenate([one.rows, rows]),
            spreads=np.concatenate([one.spreads, np.full(len(names), np.nan)]),
        )
    )


def no_disagreement(within: FloatArray) -> Disagreement:
    """A class without rows; `within` (d, d) is what is believed of its spread."""
    none = np.empty((0, len(within)))
    return Disagreement((), (), none, none, within, 0 * within, 0.0, np.empty(0))


def _with_source_covariance(one: Disagreement) -> Disagreement:
    """With the covariance between its sources of the world."""
    trust = np.array([float(kind in WORLD_KINDS) for kind in one.kinds])
    between = _moments(one.means, one.rows, trust, one.within)
    counted = (one.rows[trust > 0] > 0).sum(axis=0)
    return replace(one, between=between, freedom=max(float(counted.max(initial=0)) - 1, 0.0))


def _spreads(x: FloatArray, known: FloatArray, mass: FloatArray, means: FloatArray, rows: FloatArray) -> FloatArray:
    """Standard deviation (s,) within each source, the root mean square over the axes that enough rows state."""
    offset = x[None] - np.nan_to_num(means)[:, None]  # (s, n, d)
    weight = mass[:, :, None] * known[None]
    with np.errstate(invalid="ignore", divide="ignore"):
        variance = (weight * offset**2).sum(axis=1) / weight.sum(axis=1) * rows / (rows - 1)  # (s, d)
    variance[rows < SPREAD_ROWS] = np.nan
    enough = ~np.isnan(variance).all(axis=1)
    spreads = np.full(len(variance), np.nan)
    spreads[enough] = np.sqrt(np.maximum(np.nanmean(variance[enough], axis=1), LEAST_SD**2))
    return spreads


def _within(
    x: FloatArray, known: FloatArray, mass: FloatArray, centre: FloatArray, rows: FloatArray, spread: FloatArray
) -> FloatArray:
    """Pooled covariance (d, d) within a source; a source's own mean takes one of its effective rows.

    x : (n, d) ln mm; known : (n, d); mass : (s, n) weights by source; centre : (n, d) mean of each row's source; rows :
    (s, d) effective rows; spread : (d, d) of the class.
    """
    weights = mass.sum(axis=0)  # (n,)
    offset = known * (x - centre)
    own = (weights[:, None] * offset).T @ offset
    per_source = np.einsum("sn,ni,nj->sij", mass, known, known)
    free = 1 - 1 / np.maximum(np.sqrt(rows[:, :, None] * rows[:, None, :]), 1)
    # one row's worth of the class's own spread: sources of one row have no scatter, which is no evidence of none
    typical = float((weights**2).sum() / weights.sum())
    return _positive((own + typical * spread) / ((per_source * free).sum(axis=0) + typical), LEAST_SD**2)


def _moments(means: FloatArray, rows: FloatArray, trust: FloatArray, within: FloatArray) -> FloatArray:
    """Covariance (d, d) between sources by the method of moments.

    means, rows : (s, d) means in ln mm and effective rows of the sources; trust : (s,); within : (d, d) covariance
    within a source.
    """
    d = means.shape[1]
    between = np.zeros((d, d))
    for i, j in zip(*np.triu_indices(d), strict=True):
        usable = (rows[:, i] > 0) & (rows[:, j] > 0) & (trust > 0)
        n = np.sqrt(rows[usable, i] * rows[usable, j])
        a = trust[usable] * n / (1 + n / MEAN_HALF)
        if usable.sum() >= 2:
            total, two = a.sum(), means[usable][:, [i, j]]
            offset = two - (a @ two) / total
            moment = float(a @ offset.prod(axis=1)) - within[i, j] * float(((a - a**2 / total) / n).sum())
            between[i, j] = between[j, i] = moment / (total - (a**2).sum() / total)
    return _positive(between, 0.0)


def _positive(matrix: FloatArray, least: float) -> FloatArray:
    """The symmetric matrix (d, d) with no eigenvalue under `least`; entries from other rows need not fit together."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.maximum(values, least)) @ vectors.T)
