"""How sources of one class disagree: a random effect per source and its covariance (docs/explanation/priors.md).

Rows of source s scatter around mu + e_s with covariance W; e_s ~ N(0, B). For any weights a_s of the source means,
with A = sum a_s and n_s the rows of a source (DerSimonian and Laird 1986, in matrix form),

    E[ sum_s a_s (m_s - mu)(m_s - mu)' ] = B (A - sum a_s^2 / A) + W sum_s (a_s - a_s^2 / A) / n_s

B follows by the method of moments, entry by entry over the sources that state both axes, then made positive. A class
of few sources leans on what classes of several say: B = share W + spread^2 C, with both numbers by restricted maximum
likelihood over the source means of all classes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from metric_base.arrays import FloatArray
from metric_tree.fit.evidence import KIND_WEIGHT

__all__ = ["Disagreement", "SharedModel", "disagreement", "shared_covariance", "shared_model", "source_effects"]

#: Rows at which a source's mean has half of its largest weight among the source means. The disagreement between
#: sources is about a third to a half of the spread within, so that a handful of rows already places a source.
MEAN_HALF = 5.0

#: A class's own estimate of B counts as many sources as it has, less one; the model of all classes counts this many.
#: Chosen by leaving sources out (`benchmarks/metric_tree/priors.py --sources`).
MODEL_SOURCES = 4.0

#: Correlation of the part of the disagreement that does not follow the class's spread: size more than proportion.
CORRELATION = 0.5

#: Kinds whose disagreement the model learns from. A museum's pieces differ from a shop's by age and rank, which says
#: nothing of two shops or of a shop and a room.
MODEL_KINDS = frozenset({"product", "measured", "standard", "asset"})

#: Share of classes that are two things under one name, and the disagreement (as ln) that they are allowed.
MIXED_SHARE, MIXED_SD = 0.05, 1.0

#: Least standard deviation of ln size within a source, along any direction: a hundredth.
LEAST_SD = 0.01

#: Below this many classes of two sources or more the default of `SharedModel` holds.
MODEL_CLASSES = 8


@dataclass(frozen=True, slots=True, eq=False)
class Disagreement:
    """Of one class, over ln mm.

    sources : (s,) names; kinds : (s,) of their rows; means : (s, d), NaN where unstated; rows : (s, d) effective rows;
    within : (d, d) covariance within a source; between : (d, d) covariance between sources; freedom : sources less one.
    """

    sources: tuple[str, ...]
    kinds: tuple[str, ...]
    means: FloatArray
    rows: FloatArray
    within: FloatArray
    between: FloatArray
    freedom: float


@dataclass(frozen=True, slots=True)
class SharedModel:
    """B of a class by its spread: share x W + spread^2 C. The default is what the sources of 2026 gave, rounded."""

    share: float = 0.35
    spread: float = 0.06

    def covariance(self, within: FloatArray) -> FloatArray:
        """B (d, d) of a class whose covariance within a source is W (d, d)."""
        d = len(within)
        common = CORRELATION + (1 - CORRELATION) * np.eye(d)
        return np.asarray(self.share * within + self.spread**2 * common)


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
    means[per_axis <= 0] = np.nan
    rows[per_axis <= 0] = 0.0
    within = _within(x, known, mass, np.nan_to_num(means)[code], rows, spread)
    own_kinds = tuple(kinds[row] for row in first)
    between = _moments(means, rows, np.array([KIND_WEIGHT[kind] for kind in own_kinds]), within)
    freedom = max(float((rows > 0).sum(axis=0).max()) - 1, 0.0)
    return Disagreement(tuple(map(str, names)), own_kinds, means, rows, within, between, freedom)


def shared_model(classes: Iterable[Disagreement]) -> SharedModel:
    """The model that makes the source means of all classes likeliest; the default where too few classes have two."""
    usable = [means for one in classes if (means := _model_means(one)) is not None]
    if len(usable) < MODEL_CLASSES:
        return SharedModel()
    grid = [
        SharedModel(share, spread) for share in np.geomspace(0.02, 1.5, 14) for spread in np.geomspace(0.01, 0.3, 14)
    ]
    best = max(grid, key=lambda model: sum(_likelihood(model, *one) for one in usable))
    return SharedModel(round(float(best.share), 4), round(float(best.spread), 4))


def shared_covariance(one: Disagreement, model: SharedModel) -> FloatArray:
    """B of one class, (d, d): its own estimate and that of the model, each by the sources it counts."""
    expected = model.covariance(one.within)
    return np.asarray((one.freedom * one.between + MODEL_SOURCES * expected) / (one.freedom + MODEL_SOURCES))


def source_effects(one: Disagreement, shared: FloatArray) -> FloatArray:
    """Best linear prediction of e_s, (s, d): B (B + W / n_s)^-1 (m_s - mu) over the axes that the source states."""
    effects = np.zeros_like(one.means)
    trust = np.array([KIND_WEIGHT[kind] for kind in one.kinds])[:, None]
    weight = trust * one.rows / (1 + one.rows / MEAN_HALF)
    with np.errstate(invalid="ignore", divide="ignore"):
        centre = np.nansum(weight * one.means, axis=0) / weight.sum(axis=0)
    for s, rows in enumerate(one.rows):
        axes = np.flatnonzero(rows > 0)
        if len(axes):
            block = np.ix_(axes, axes)
            noise = one.within[block] / np.sqrt(np.outer(rows[axes], rows[axes]))
            gain = np.linalg.solve(shared[block] + noise, (one.means[s] - centre)[axes])
            effects[s] = shared[:, axes] @ gain
    return effects


def _model_means(one: Disagreement) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Means (s, d), rows (s, d) and W (d, d) over the axes that two sources of the model's kinds state."""
    chosen = np.array([kind in MODEL_KINDS for kind in one.kinds])
    rows = one.rows[chosen]
    axes = np.flatnonzero((rows >= 1).sum(axis=0) >= 2)
    whole = (rows[:, axes] >= 1).all(axis=1)
    if len(axes) == 0 or whole.sum() < 2:
        return None
    return one.means[chosen][whole][:, axes], rows[whole][:, axes], one.within[np.ix_(axes, axes)]


def _likelihood(model: SharedModel, means: FloatArray, rows: FloatArray, within: FloatArray) -> float:
    """Restricted log likelihood of source means, a few classes being mixed.

    With V_s = B + W / n_s and r_s = m_s - mu: -(sum ln|V_s| + ln|sum V_s^-1| + sum r_s' V_s^-1 r_s) / 2.
    """
    noise = within / np.sqrt(rows[:, :, None] * rows[:, None, :])  # (s, d, d)
    plain = _restricted_likelihood(means, model.covariance(within) + noise)
    mixed = _restricted_likelihood(means, model.covariance(within) + noise + MIXED_SD**2 * np.eye(len(within)))
    return float(np.logaddexp(np.log(1 - MIXED_SHARE) + plain, np.log(MIXED_SHARE) + mixed))


def _restricted_likelihood(means: FloatArray, variances: FloatArray) -> float:
    precisions = np.linalg.inv(variances)  # (s, d, d)
    total = precisions.sum(axis=0)
    mu = np.linalg.solve(total, np.einsum("sij,sj->i", precisions, means))
    offset = means - mu
    squares = np.einsum("si,sij,sj->", offset, precisions, offset)
    return float(-0.5 * (np.linalg.slogdet(variances)[1].sum() + np.linalg.slogdet(total)[1] + squares))


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
    return _positive((own + typical * spread) / ((per_source * free).sum(axis=0) + typical), LEAST_SD**2)


def _moments(means: FloatArray, rows: FloatArray, trust: FloatArray, within: FloatArray) -> FloatArray:
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
    """The symmetric matrix with no eigenvalue under `least`; entries from different rows need not fit together."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.maximum(values, least)) @ vectors.T)
