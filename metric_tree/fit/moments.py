"""First and second moments of a class from its rows, for its parent and for the model of the kinds of evidence."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from metric_base.arrays import FloatArray
from metric_tree.fit.mixture import NormalInverseWishart, complete_rows, fit_mixture, raise_to_floor
from metric_tree.fit.random_effects import SourceMeans, no_source_means, source_means, with_statements
from metric_tree.fit.rows import ClassRows, class_belief, nanmean, statements_of, weighted_rows

#: Prior correlation between the axes of a class: a larger object is larger on all axes.
CORRELATION = 0.6

#: Prior standard deviation of ln size within a class, the median over everyday classes.
VAGUE_SD = 0.33

#: Weight of the prior covariance of the first pass, in rows. It only determines axes that no row states.
VAGUE_ROWS = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """First and second moments of a class over ln mm."""

    node_id: str
    axes: tuple[str, ...]
    mean: FloatArray  #: (3,)
    within: FloatArray  #: (3, 3) covariance within a source.
    known: FloatArray  #: (3,) effective number of rows that state the axis.
    by_source: SourceMeans | None  #: Means of the sources; None over sorted extents.


def correlated_covariance(sd: FloatArray, correlation: float = CORRELATION) -> FloatArray:
    """Return the covariance (d, d) with equal correlations from standard deviations (d,)."""
    return np.outer(sd, sd) * (correlation + (1 - correlation) * np.eye(len(sd)))


#: Prior of any class without a tree; the weight of its mean, 300 mm, is negligible.
VAGUE = NormalInverseWishart(np.full(3, math.log(300.0)), 0.01, correlated_covariance(np.full(3, VAGUE_SD)), VAGUE_ROWS)


def moments(rows: ClassRows) -> Moments:
    """Estimate the moments of a class from its rows only, with EM for missing axes and hidden axis orders."""
    statements = statements_of(rows)
    belief = class_belief(VAGUE, statements)
    if rows.is_stated:
        mean = nanmean(statements.means)
        known = (~np.isnan(statements.means)).sum(axis=0).astype(float)
        by_source = with_statements(no_source_means(belief.covariance), statements)
        mean = np.where(np.isnan(mean), VAGUE.mean, mean)
        return Moments(rows.node_id, rows.axes, mean, belief.covariance, known, by_source)
    weighted, sources, kinds = weighted_rows(rows)
    single = fit_mixture(weighted, 1, belief).mixture
    x, known = complete_rows(weighted, single)
    by_source = source_means(x, known, weighted.weights, sources, kinds, single.covariances[0])
    effective = known.sum(axis=0) * weighted.effective_size / len(weighted)
    by_source = with_statements(by_source, statements)
    within = raise_to_floor(by_source.within, belief.floor)
    return Moments(rows.node_id, rows.axes, single.means[0], within, effective, by_source)


def extent_moments(rows: ClassRows) -> Moments:
    """Compute the moments over sorted extents from the rows with all three; their axis order is known."""
    is_complete = ~np.isnan(rows.x).any(axis=1)
    weights = (np.ones(len(rows.kinds)) if rows.is_stated else rows.weights)[rows.owner[is_complete]]
    x = rows.x[is_complete]
    if not weights.sum() > 0:
        return Moments(rows.node_id, rows.axes, VAGUE.mean, VAGUE.covariance, np.zeros(3), None)
    mean = weights @ x / weights.sum()
    prior_weight = VAGUE.covariance_rows * float((weights**2).sum() / weights.sum())
    scatter = np.einsum("n,ni,nj->ij", weights, x - mean, x - mean) + prior_weight * VAGUE.covariance
    effective = np.full(3, weights.sum() ** 2 / (weights**2).sum())
    within = raise_to_floor(scatter / (weights.sum() + prior_weight))
    return Moments(rows.node_id, rows.axes, mean, within, effective, None)
