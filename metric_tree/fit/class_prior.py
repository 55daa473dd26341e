"""The prior of one class from its rows: weights, the class's centre, components, borrowing where it is thin.

The order of a fit: one Gaussian by EM over all rows (which resolves missing axes and hidden axis order), the sources'
means, the centre from all of them by what their kinds are worth, the rows less their source's predicted effect, a
mixture of one to four components, moved onto the centre. Ranges and means of many objects speak as sources for the
centre, and their spread takes the place of what is believed of the parent's children.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_tree.fit.centre import class_centre, shared_covariance
from metric_tree.fit.class_rows import (
    STATED_SHARED,
    ClassRows,
    Statements,
    own_belief,
    statements_of,
    weighted_rows,
    within_range,
    without_museums,
)
from metric_tree.fit.component_choice import best_mixture, predictive_mixture
from metric_tree.fit.disagreement import disagreement, no_disagreement, with_statements
from metric_tree.fit.evidence import JUDGED, NORM, shares
from metric_tree.fit.kinds import KindModel
from metric_tree.fit.mixture_em import Belief, Mixture, Rows, complete_rows, fit_mixture
from metric_tree.fit.moments import correlated_covariance
from metric_tree.prior import Prior
from metric_tree.tiers import Evidence, leaf_tier

__all__ = ["NEW_SOURCE", "NewSource", "class_prior", "heldout_log_density"]

#: An axis is published where at least this many rows state it by their weight, in expectation over hidden axis orders:
#: the thickness of one artist's model says nothing of a card whose norm gives length and width.
KNOWN_ROWS = 0.5

#: Least standard deviation of ln size of a norm: a thousandth, the precision of a tape measure.
NORM_FLOOR = 0.001

#: Folds of the published held-out log density, the complete rows below which none is published, and the rows that take
#: part at most: a hundred tell the mean log density to a tenth, and the score is of no fit.
FOLDS = 3
HELDOUT_ROWS, HELDOUT_MOST = 10, 100


@dataclass(frozen=True, slots=True)
class NewSource:
    """How far a source that the fit has not seen lies off, beyond what the known ones say.

    The variance of ln size along each axis grows by min(sd^2, most * variance) / (S + 1) of S sources of real objects:
    `sd` is the offset of a source, and `most` keeps it in proportion where a class is narrow. Both were chosen on half
    of the sources, each left out in turn, and on one list of everyday objects (docs/evidence/release_3.md).
    """

    sd: float = 0.25
    most: float = 2.0

    def factor(self, sources: int, sd: FloatArray | float) -> FloatArray:
        """By what the variance of each axis grows, (d,), 1 or more; sd : (d,) of ln size as fitted."""
        return np.asarray(1 + np.minimum(self.most, np.square(self.sd / sd)) / (sources + 1))

    def widen(self, prior: Prior) -> Prior:
        """The prior as wide as its sources of real objects are few; its components stay where they are."""
        factor = self.factor(prior.evidence.sources if prior.evidence else 0, prior.log_sd())
        scale = np.sqrt(np.outer(factor, factor))
        return replace(prior, covariances=scale * prior.covariances, shared_covariance=scale * prior.shared_covariance)


#: The offset of a source that the fit has not seen, as published.
NEW_SOURCE = NewSource()


def class_prior(
    rows: ClassRows,
    belief: Belief,
    model: KindModel,
    family: str = "",
    seed: int = 0,
    heldout: bool = True,
    new_source: NewSource = NEW_SOURCE,
) -> Prior:
    """The prior of a class over the axes that its rows state.

    Parameters
    ----------
    belief : the parent's moments; model : what kinds of evidence are worth; family : of the class; heldout : whether to
        score it; new_source : by what it is widened
    """
    evidence = rows.evidence
    if NORM in rows.kinds:
        return _norm_prior(rows, evidence)
    rows = without_museums(rows)
    statements = statements_of(rows)
    belief = own_belief(belief, statements)
    belief = replace(belief, covariance_rows=belief.covariance_rows / rows.worth)
    if rows.is_stated:
        return new_source.widen(_with_tier(_stated_prior(rows, statements, belief, model, family), evidence))
    weighed, sources, kinds = weighted_rows(rows)
    single = fit_mixture(weighed, 1, belief)
    x, known = complete_rows(weighed, single.mixture)
    between = disagreement(x, known, weighed.weights, sources, kinds, single.mixture.covariances[0])
    between = with_statements(between, statements.names, statements.kinds, statements.means)
    shared = within_range(shared_covariance(between, model, family), statements)
    centre = class_centre(between, shared, model, family)
    code = np.array([between.sources.index(name) for name in sources])
    centred = _scale_spread(weighed.shift(centre.effects[code]), centre.mean, kinds, model)
    placed = replace(belief, mean=np.where(np.isnan(centre.mean), belief.mean, centre.mean))
    best, components = best_mixture(centred, placed, seed, rows.worth)
    best = _move_to_mean(best, centred, centre.mean)
    mass = weighed.weights @ known + (~np.isnan(statements.means)).sum(axis=0)
    borrowed = belief.covariance_rows / (belief.covariance_rows + weighed.effective) if components == 1 else 0.0
    stated = bool((~np.isnan(statements.spread)).any())
    known_sd = np.sqrt(np.where(np.isfinite(centre.variance), centre.variance, 0.0))
    total = within_range(shared + correlated_covariance(known_sd), statements)
    prior = _prior(
        rows, best, total, mass, 0.0 if stated else borrowed, len(between.sources), _shares(rows, statements, borrowed)
    )
    prior = _with_tier(prior, evidence)
    published = new_source.widen(prior)
    if not heldout:
        return published
    factor = new_source.factor(evidence.sources, prior.log_sd())
    score = heldout_log_density(centred, components, placed, shared, published_axes(mass), seed, factor)
    return replace(published, heldout_log_density=score)


def heldout_log_density(
    rows: Rows,
    components: int,
    belief: Belief,
    shared: FloatArray,
    axes: NDArray[np.intp],
    seed: int,
    widened: FloatArray | float = 1.0,
) -> float | None:
    """Mean log density over log mm of rows that the fit did not see, by cross-validation; None of too few.

    shared : B (d, d); widened : by what the variances of the axes are multiplied, (k,). The rows that state all of
    `axes` (k,) are scored, as of an object of unknown source.
    """
    if len(rows) > HELDOUT_MOST:
        chosen = np.random.default_rng(seed).permutation(len(rows))[:HELDOUT_MOST]
        rows = rows.subset(np.sort(chosen))
    single = rows.candidates == 1
    complete = single & ~np.isnan(rows.x[rows.starts][:, axes]).any(axis=1)
    if complete.sum() < HELDOUT_ROWS:
        return None
    fold = np.random.default_rng(seed).permutation(len(rows)) % FOLDS
    total = 0.0
    for held in range(FOLDS):
        seen = rows.subset(np.flatnonzero(fold != held))
        mixture = predictive_mixture(fit_mixture(seen, components, belief, seed), belief, seen.effective)
        means, covariances, between = _marginal(mixture, shared, axes)
        scale = np.sqrt(np.multiply.outer(widened, widened))
        spreads = (scale * covariances, scale * between)
        prior = Prior("", _placeholders(axes), mixture.weights, means, *spreads, 0, 0, {}, 0.0)
        scored = np.flatnonzero(complete & (fold == held))
        if len(scored):
            total += float(prior.log_density(np.exp(rows.x[rows.starts[scored]][:, axes])).sum())
    return total / int(complete.sum())


def published_axes(known: FloatArray) -> NDArray[np.intp]:
    """Axes (k,) that at least `KNOWN_ROWS` rows state, by the expected weights `known` (d,); else the likeliest."""
    return np.flatnonzero(known >= min(KNOWN_ROWS, float(known.max())))


def _placeholders(axes: NDArray[np.intp]) -> tuple[str, ...]:
    """Placeholder names of axes (k,), for a prior that is only scored."""
    return tuple(f"axis{axis}" for axis in axes)


def _stated_prior(rows: ClassRows, statements: Statements, belief: Belief, model: KindModel, family: str) -> Prior:
    """The prior of a class of which only ranges and means are known: the stated variance, parted into W and B."""
    between = with_statements(no_disagreement(belief.covariance), statements.names, statements.kinds, statements.means)
    shared = STATED_SHARED / (1 - STATED_SHARED) * belief.covariance
    centre = class_centre(between, shared, model, family)
    mean = np.where(np.isnan(centre.mean), belief.mean, centre.mean)
    mixture = Mixture(np.ones(1), mean[None], belief.covariance[None])
    known = (~np.isnan(statements.means)).sum(axis=0).astype(float)
    borrowed = 0.0 if (~np.isnan(statements.spread)).any() else 1.0
    counts = {kind: float(rows.kinds.count(kind)) for kind in set(rows.kinds)}
    total = sum(counts.values())
    by_kind = {kind: counts[kind] / total for kind in sorted(counts)}
    return _prior(rows, mixture, shared, known, borrowed, len(statements.names), by_kind)


def _norm_prior(rows: ClassRows, evidence: Evidence) -> Prior:
    """The prior of a class whose size a standard fixes: each size that it allows, alike, with its own tolerance.

    No kind's bias, no parent and no item moves it. Rows of one class state the same axes.
    """
    first = np.searchsorted(rows.owner, np.arange(len(rows.kinds)))
    chosen = np.array([kind == NORM for kind in rows.kinds])
    means, sd = rows.x[first][chosen], np.maximum(np.nan_to_num(rows.range_sd[chosen]), NORM_FLOOR)
    k = len(means)
    covariances = sd[:, :, None] ** 2 * np.eye(sd.shape[1])  # (k, d, d)
    mixture = Mixture(np.full(k, 1 / k), means, (1 - STATED_SHARED) * covariances)
    stated = (~np.isnan(means)).all(axis=0).astype(float)
    shared = STATED_SHARED * covariances.mean(axis=0)
    prior = _prior(rows, mixture, shared, stated, 0.0, 1, {NORM: 1.0})
    return replace(prior, tier="norm", evidence=evidence)


def _with_tier(prior: Prior, evidence: Evidence) -> Prior:
    """The prior with its counts and its tier."""
    judged = prior.share_by_kind.get(JUDGED, 0.0)
    return replace(prior, tier=leaf_tier(evidence, prior.borrowed, judged), evidence=evidence)


def _scale_spread(rows: Rows, mean: FloatArray, kinds: Sequence[str], model: KindModel) -> Rows:
    """The rows with the spread of their kind brought to that of products, about the centre, mean (d,)."""
    factor = np.exp([-model.ratio.get(kind, 0.0) for kind in kinds])[rows.owner][:, None]
    centre = np.nan_to_num(mean)
    return Rows(centre + (rows.x - centre) * np.where(np.isnan(mean), 1.0, factor), rows.owner, rows.weights)


def _move_to_mean(mixture: Mixture, rows: Rows, mean: FloatArray) -> Mixture:
    """The mixture moved so that the sizes that rows state lie about `mean` (d,), if any row states the axis.

    What EM makes of sizes that are not stated by chance alone stays, and nothing of how far a thin class is drawn to
    its belief.
    """
    x, known = complete_rows(rows, mixture)  # (n, d) each
    whole = rows.weights @ x / rows.weights.sum()  # (d,) of sizes stated and completed
    doubt = KNOWN_ROWS * rows.weights.mean()
    stated = (rows.weights @ (known * x) + doubt * whole) / (rows.weights @ known + doubt)
    lies = stated - whole + mixture.weights @ mixture.means
    offset = np.where(np.isnan(mean), 0.0, mean - lies)
    return Mixture(mixture.weights, mixture.means + offset, mixture.covariances)


def _shares(rows: ClassRows, statements: Statements, borrowed: float) -> dict[str, float]:
    """Share of the fit by kind: a stated range has the share that else the parent has."""
    by_kind = shares(rows.kinds, rows.weights)
    if not (~np.isnan(statements.spread)).any():
        return by_kind
    by_kind = {kind: share * (1 - borrowed) for kind, share in by_kind.items()}
    kind = statements.kinds[int(np.argmax(~np.isnan(statements.sd).all(axis=1)))]
    return by_kind | ({kind: borrowed} if borrowed > 0 else {})


def _prior(
    rows: ClassRows,
    mixture: Mixture,
    shared: FloatArray,
    known: FloatArray,
    borrowed: float,
    n_sources: int,
    by_kind: dict[str, float],
) -> Prior:
    """The prior over the axes that enough rows state: shared (d, d) is B, known (d,) the weight of rows by axis."""
    axes = published_axes(known)
    means, covariances, between = _marginal(mixture, shared, axes)
    return Prior(
        node_id=rows.node_id,
        dims=tuple(rows.axes[axis] for axis in axes),
        weights=mixture.weights,
        means=means,
        covariances=covariances,
        shared_covariance=between,
        n=rows.n,
        n_sources=n_sources,
        share_by_kind=by_kind,
        borrowed=borrowed,
    )


def _marginal(
    mixture: Mixture, shared: FloatArray, axes: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means (k, a), covariances (k, a, a) and B (a, a) on `axes` (a,)."""
    block = (axes[:, None], axes)
    return mixture.means[:, axes], mixture.covariances[:, block[0], block[1]], shared[block]
