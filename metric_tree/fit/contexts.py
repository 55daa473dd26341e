"""Fit of the model of regions and years (`metric_tree.context`), and the contexts of classes and inner nodes.

The five parameters of the model maximise the leave-one-source-out prediction: the density of the means that a source
states for its regions and years, given the other sources of the class, over all classes. The covariance between sources
is estimated by `metric_tree.fit.evidence_model` and only divided here. The joint likelihood of all sources is not used:
the years of one manufacturer differ more than the sources of a class, so that it would attribute everything to region
and year.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_tree.context import Context, ContextModel, ContextSimilarity
from metric_tree.fit.random_effects import CERTAIN_ROWS
from metric_tree.prior import Prior

#: Years per context: a car model is sold for about six years, and shorter periods have fewer rows.
YEAR_SPAN = 5

#: Kinds of evidence that are objects in use at the time and in the region of the row.
KINDS = frozenset({"product", "measured", "standard", "statistic"})

#: Maximum number of contexts of a class in the fit, the contexts with the most rows.
MAX_CONTEXTS = 30

#: Minimum fraction of the weight of a node that a source must cover to be a context of the node, 0 to 1.
MIN_WEIGHT_FRACTION = 0.2

#: Decimals of a published offset: 0.001 %.
DECIMALS = 5

#: Minimum sampling variance of a context in the fit, as a fraction of B.
MIN_NOISE = 1e-4

#: Candidate values of each parameter of the model.
GRIDS: Mapping[str, tuple[float, ...]] = {
    "region": (0.0, 0.025, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6),
    "year": (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6),
    "own": (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5),
    "kin": (0.1, 0.3, 0.5, 0.7, 0.9),
    "years": (5.0, 8.0, 12.0, 20.0, 30.0, 50.0),
}

#: Maximum sum of the fractions of region, year and context; the remainder is the effect of the source.
MAX_EXPLAINED = 0.95

#: Number of iterations over the grids; the third changes nothing.
ROUNDS = 2

#: Start of the fit, and the model if no class has two contexts.
START = ContextModel(region=0.2, year=0.1, own=0.1, kin=0.5, years=12.0)


@dataclass(frozen=True, slots=True, eq=False)
class ContextMean:
    """Mean of the rows of one source, region and span of years."""

    source: str
    region: str | None
    year: float | None
    mean: FloatArray  #: (d,) of ln size, NaN if not stated.
    rows: FloatArray  #: (d,) effective number of rows.


def context_means(
    x: FloatArray,
    source: NDArray[np.str_],
    kind: NDArray[np.str_],
    region: Sequence[str | None],
    year: Sequence[int | None],
    weight: FloatArray,
) -> tuple[ContextMean, ...]:
    """Compute the mean of each source, region and span of years of a class; rows without region and year are ignored.

    Parameters
    ----------
    x : (n, d) float
        ln size, NaN if not stated.
    source, kind : (n,) str
        Source and kind of evidence of each row.
    region, year : (n,) sequence
        Region and year of each row, None if unknown.
    weight : (n,) float
        Reciprocal of the number of rows of the class in the scene of the row.
    """
    groups: dict[tuple[str, str, int], list[int]] = {}
    for row in np.flatnonzero(np.isin(kind, sorted(KINDS))).tolist():
        if region[row] not in (None, "world") or year[row] is not None:
            when = year[row]
            span = -1 if when is None else when // YEAR_SPAN
            groups.setdefault((str(source[row]), region[row] or "", span), []).append(row)
    means = []
    for (name, place, _), members in sorted(groups.items()):
        rows = np.array(members)
        parts = np.where(np.isnan(x[rows]), 0.0, weight[rows, None])  # (k, d)
        mass = parts.sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = (parts * np.nan_to_num(x[rows])).sum(axis=0) / mass
            effective = mass**2 / (parts**2).sum(axis=0)
        certain = np.where(kind[rows[0]] == "statistic", CERTAIN_ROWS, 1.0)
        years = [when for row in members if (when := year[row]) is not None]
        mean_year = float(np.mean(years)) if years else None
        mean = np.where(mass > 0, mean, np.nan)
        means.append(ContextMean(name, place or None, mean_year, mean, np.nan_to_num(effective) * certain))
    return tuple(means)


def class_contexts(prior: Prior, axes: Sequence[str], means: Sequence[ContextMean], within: FloatArray) -> Prior:
    """Return the prior of a class with its contexts.

    Parameters
    ----------
    prior : Prior
        Prior of the class.
    axes : (d,) sequence of str
        Axes of the context means.
    means : sequence of ContextMean
        Means of the contexts.
    within : (d,) float
        Variances within a source, ln size.
    """
    chosen = [list(axes).index(dim) for dim in prior.dims]
    centre = prior.weights @ prior.means
    contexts = []
    for one in means:
        rows = one.rows[chosen]
        if (rows > 0).any():
            offset = np.where(rows > 0, one.mean[chosen] - centre, np.nan)
            variance = within[chosen] / np.maximum(rows, 1e-9)
            contexts.append(Context(one.source, one.region, one.year, *_round_context(offset, variance)))
    return replace(prior, contexts=tuple(contexts))


def inner_contexts(
    children: Sequence[Prior], share: FloatArray, shared: FloatArray, plain: Prior | None = None
) -> tuple[Context, ...]:
    """Return the contexts of a node: the contexts of its children with the same source, region and span, combined.

    The objects to which a source gives the plain name of the node represent the complete node, for example all cars of
    a street. Contexts of `plain` are therefore contexts of the node, and have precedence.

    Parameters
    ----------
    children : (c,) sequence of Prior
        Priors of the children over the dimensions of the node.
    share : (c,) float
        Weights of the children, sum 1.
    shared : (d,) float
        Variances of B.
    plain : Prior, optional
        Prior of the leaf `<id>/other` over the dimensions of the node.
    """
    complete = plain.contexts if plain is not None else ()
    covered = {(one.source, one.region) for one in complete}
    groups: dict[tuple[str, str, int], list[tuple[float, Context]]] = {}
    for child, part in zip(children, share.tolist(), strict=True):
        if plain is not None and child.node_id == plain.node_id:
            continue
        for one in child.contexts:
            span = -1 if one.year is None else int(one.year // YEAR_SPAN)
            groups.setdefault((one.source, one.region or "", span), []).append((part, one))
    combined = [combined_context(members, shared) for _, members in sorted(groups.items())]
    return (*complete, *(one for one in combined if one is not None and (one.source, one.region) not in covered))


def combined_context(members: Sequence[tuple[float, Context]], shared: FloatArray) -> Context | None:
    """Combine contexts of children with the same source, region and span by the weights of the children.

    A source that covers the fraction q of the weight of a node determines the mean of this fraction. The variance of
    its error for the complete node is (1 - q) / q of B.

    Parameters
    ----------
    members : sequence of (float, Context)
        Weight of a child in its node, 0 to 1, and its context.
    shared : (d,) float
        Variances of B.

    Returns
    -------
    Context or None
        None if the members cover less than `MIN_WEIGHT_FRACTION` on every axis.
    """
    offsets = np.array([one.offset for _, one in members])  # (c, d)
    weights = np.where(np.isnan(offsets), 0.0, np.array([part for part, _ in members])[:, None])
    part = weights.sum(axis=0)
    if part.max() < MIN_WEIGHT_FRACTION:
        return None
    stated = np.maximum(part, 1e-9)
    offset = (weights * np.nan_to_num(offsets)).sum(axis=0) / stated
    variances = np.nan_to_num(np.array([one.variance for _, one in members]))
    variance = (weights**2 * variances).sum(axis=0) / stated**2 + np.maximum(1 - part, 0) / stated * shared
    years = [(weight, one.year) for weight, one in members if one.year is not None]
    year = sum(weight * when for weight, when in years) / sum(weight for weight, _ in years) if years else None
    offset = np.where(part >= MIN_WEIGHT_FRACTION, offset, np.nan)
    return Context(members[0][1].source, members[0][1].region, year, *_round_context(offset, variance))


def _round_context(offset: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Round offset (d,) and variance (d,) for publication; a variance of zero would make the source exact."""
    min_variance = 10.0 ** -(DECIMALS + 1)
    known = np.where(np.isnan(offset), np.nan, np.maximum(np.round(variance, DECIMALS + 1), min_variance))
    return np.round(offset, DECIMALS), known


@dataclass(frozen=True, slots=True, eq=False)
class ContextLine:
    """The n context means of one axis of one class."""

    similarity: ContextSimilarity
    sources: tuple[NDArray[np.intp], ...]  #: Indices (k,) of the means of each source.
    means: FloatArray  #: (n,) of ln size.
    noise: FloatArray  #: (n,) sampling variance as a fraction of B.
    between: float  #: B.

    def prediction(self, model: ContextModel) -> float:
        """Return the mean log density of the means of a source given the other sources, summed over the sources.

        With Q = V^-1 - V^-1 1 1' V^-1 / (1' V^-1 1), the prediction error of the means b of a source is
        Q_bb^-1 (Q m)_b with the covariance Q_bb^-1: leave-one-out cross-validation of kriging (Dubrule 1983) by blocks.
        """
        inverse = np.linalg.inv(self.similarity.covariance(model) + np.diag(self.noise))
        weight = inverse.sum(axis=1)
        precision = inverse - np.outer(weight, weight) / weight.sum()
        weighted = precision @ self.means
        total = 0.0
        for rows in self.sources:
            covariance = np.linalg.inv(precision[np.ix_(rows, rows)])
            variance = np.diagonal(covariance)
            squares = (covariance @ weighted[rows]) ** 2
            total -= 0.5 * float(np.mean(np.log(variance) + squares / (variance * self.between)))
        return total


def fit_context_model(classes: Iterable[tuple[Sequence[ContextMean], FloatArray, FloatArray]]) -> ContextModel:
    """Fit the model to the context means, variances (d,) within a source and variances (d,) of B of all classes."""
    lines = [line for means, within, between in classes for line in context_lines(means, within, between)]
    model = START
    if not lines:
        return model
    for _ in range(ROUNDS):
        for name, grid in GRIDS.items():
            candidates = [model._replace(**{name: value}) for value in grid]
            allowed = [one for one in candidates if one.region + one.year + one.own < MAX_EXPLAINED]
            model = max(allowed, key=lambda one: sum(line.prediction(one) for line in lines))
    return model


def context_lines(means: Sequence[ContextMean], within: FloatArray, between: FloatArray) -> list[ContextLine]:
    """Return a line for each axis that two sources or more state, from the variances within (d,) and between (d,)."""
    lines = []
    for axis in range(len(within)):
        stated = sorted((one for one in means if one.rows[axis] > 0), key=lambda one: -one.rows[axis])[:MAX_CONTEXTS]
        names, code = np.unique(np.array([one.source for one in stated], dtype=str), return_inverse=True)
        if len(names) >= 2 and between[axis] > 0:
            noise = np.array([within[axis] / one.rows[axis] for one in stated]) / between[axis]
            lines.append(
                ContextLine(
                    ContextSimilarity.of([(one.source, one.region, one.year) for one in stated]),
                    tuple(np.flatnonzero(code == source) for source in range(len(names))),
                    np.array([one.mean[axis] for one in stated]),
                    np.maximum(noise, MIN_NOISE),
                    float(between[axis]),
                )
            )
    return lines
