"""First and second moments of a class from its own rows: for its parent, and for the model of kinds of evidence."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from metric_base.arrays import FloatArray
from metric_tree.fit.mixture import Belief, complete_rows, fit_mixture, raise_to_floor
from metric_tree.fit.random_effects import SourceMeans, no_source_means, source_means, with_statements
from metric_tree.fit.rows import ClassRows, nanmean, own_belief, statements_of, weighted_rows

#: Correlation between the axes of a class before any class is seen: a larger one is larger on all axes.
CORRELATION = 0.6

#: Spread of ln size within a class before any class is seen: a third, the median over everyday classes.
VAGUE_SD = 0.33

#: Rows that the vague belief of the first pass counts: enough to hold an axis that nobody states, no more.
VAGUE_ROWS = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """First and second moments of a class: mean (3,) of ln mm, within (3, 3) a source, known (3,) effective rows."""

    node_id: str
    axes: tuple[str, ...]
    mean: FloatArray
    within: FloatArray
    known: FloatArray
    disagreement: SourceMeans | None


def correlated_covariance(sd: FloatArray, correlation: float = CORRELATION) -> FloatArray:
    """Covariance (d, d) of equal correlation from standard deviations (d,)."""
    return np.outer(sd, sd) * (correlation + (1 - correlation) * np.eye(len(sd)))


#: What is believed of any class before the tree is seen; its mean, a foot or so, weighs nothing.
VAGUE = Belief(np.full(3, math.log(300.0)), 0.01, correlated_covariance(np.full(3, VAGUE_SD)), VAGUE_ROWS)


def moments(rows: ClassRows) -> Moments:
    """The moments of a class from its own rows alone, for its parent and for the model of kinds."""
    statements = statements_of(rows)
    belief = own_belief(VAGUE, statements)
    if rows.is_stated:
        mean = nanmean(statements.means)
        known = (~np.isnan(statements.means)).sum(axis=0).astype(float)
        between = with_statements(
            no_source_means(belief.covariance), statements.names, statements.kinds, statements.means
        )
        return Moments(
            rows.node_id, rows.axes, np.where(np.isnan(mean), VAGUE.mean, mean), belief.covariance, known, between
        )
    weighed, sources, kinds = weighted_rows(rows)
    single = fit_mixture(weighed, 1, belief).mixture
    x, known = complete_rows(weighed, single)
    between = source_means(x, known, weighed.weights, sources, kinds, single.covariances[0])
    effective = known.sum(axis=0) * weighed.effective / len(weighed)
    both = with_statements(between, statements.names, statements.kinds, statements.means)
    return Moments(rows.node_id, rows.axes, single.means[0], raise_to_floor(both.within, belief.floor), effective, both)


def extent_moments(rows: ClassRows) -> Moments:
    """The moments over sorted extents, straight from the rows that state all three: nothing is open there."""
    whole = ~np.isnan(rows.x).any(axis=1)
    weights = (np.ones(len(rows.kinds)) if rows.is_stated else rows.weights)[rows.owner[whole]]
    x = rows.x[whole]
    if not weights.sum() > 0:
        return Moments(rows.node_id, rows.axes, VAGUE.mean, VAGUE.covariance, np.zeros(3), None)
    mean = weights @ x / weights.sum()
    typical = VAGUE.covariance_rows * float((weights**2).sum() / weights.sum())
    scatter = np.einsum("n,ni,nj->ij", weights, x - mean, x - mean) + typical * VAGUE.covariance
    effective = np.full(3, weights.sum() ** 2 / (weights**2).sum())
    return Moments(rows.node_id, rows.axes, mean, raise_to_floor(scatter / (weights.sum() + typical)), effective, None)
