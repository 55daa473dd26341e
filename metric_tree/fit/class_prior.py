"""The prior of one class from its rows: weights, sources' own offsets, components by BIC, borrowing where it is thin.

The order of a fit: one Gaussian by EM over everything (which resolves missing axes and hidden axis order), the sources'
means and how they disagree, the rows less their source's predicted offset, then a mixture of one to four components.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_tree.fit.disagreement import Disagreement, SharedModel, disagreement, shared_covariance, source_effects
from metric_tree.fit.em import Belief, Fitted, Mixture, Rows, complete_rows, fit_mixture, raise_to_floor
from metric_tree.fit.evidence import row_weights, shares
from metric_tree.prior import Prior

__all__ = ["VAGUE", "ClassRows", "Moments", "class_prior", "extent_moments", "heldout_log_density", "moments"]

#: Largest number of components: sizes of one category fall into a few kinds (a hatchback, a saloon, a van).
COMPONENTS = 4

#: Effective rows that a component must have: one and a half for each of its ten numbers (mean 3, covariance 6, weight).
COMPONENT_ROWS = 15.0

#: An axis is published where at least this many rows state it, in expectation over hidden axis orders.
KNOWN_ROWS = 0.5

#: Degrees of freedom above which Student's t is published as one Gaussian: the 99 % points differ by 4 %.
GAUSSIAN_FREEDOM = 30.0

#: Normal components that stand for a Student's t.
T_COMPONENTS = 3

#: Half-width of a curated range in standard deviations: the range holds nine of ten.
RANGE_SD = 1.645

#: A person's range is stated from memory: its log spread is widened by half (people's 90 % ranges hold about two
#: thirds of the truth: Alpert and Raiffa 1982, which a factor 1.6 would mend).
CURATED_WIDENING = 1.5

#: Correlation between the axes of a class before any class is seen: a larger one is larger on all axes.
CORRELATION = 0.6

#: Spread of ln size within a class before any class is seen: a third, the median over everyday classes.
VAGUE_SD = 0.33

#: Rows that the vague belief of the first pass counts: enough to hold an axis that nobody states, no more.
VAGUE_ROWS = 2.0

#: Folds of the published held-out log density, and the complete rows below which none is published.
FOLDS = 5
HELDOUT_ROWS = 10


@dataclass(frozen=True, slots=True, eq=False)
class ClassRows:
    """Rows of one class in one frame of axes, duplicates already collapsed.

    x : (m, 3) candidates in ln mm, NaN where missing; owner : (m,) the row of each; sources, kinds : (n,) of the rows;
    range_sd : (n, 3) spread of ln size that a curated row states, NaN elsewhere; n : items that the rows stand for,
    curated ones not counted.
    """

    node_id: str
    axes: tuple[str, ...]
    x: FloatArray
    owner: NDArray[np.intp]
    sources: tuple[str, ...]
    kinds: tuple[str, ...]
    range_sd: FloatArray
    n: int

    @property
    def is_curated(self) -> bool:
        """Whether nothing but curated ranges is known of the class."""
        return set(self.kinds) == {"curated"}


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """First and second moments of a class: mean (3,) of ln mm, within (3, 3) a source, known (3,) effective rows."""

    node_id: str
    axes: tuple[str, ...]
    mean: FloatArray
    within: FloatArray
    known: FloatArray
    disagreement: Disagreement | None


def correlated_covariance(sd: FloatArray, correlation: float = CORRELATION) -> FloatArray:
    """Covariance (d, d) of equal correlation from standard deviations (d,)."""
    return np.outer(sd, sd) * (correlation + (1 - correlation) * np.eye(len(sd)))


#: What is believed of any class before the tree is seen; its mean, a foot or so, weighs nothing.
VAGUE = Belief(np.full(3, math.log(300.0)), 0.01, correlated_covariance(np.full(3, VAGUE_SD)), VAGUE_ROWS)


def moments(rows: ClassRows) -> Moments:
    """The moments of a class from its own rows alone, for its parent and for the pool of disagreements."""
    if rows.is_curated:
        mixture, known = _curated_mixture(rows)
        return Moments(rows.node_id, rows.axes, mixture.means[0], mixture.covariances[0], known, None)
    weighed, sources, kinds = _weighted_rows(rows)
    single = fit_mixture(weighed, 1, VAGUE).mixture
    x, known = complete_rows(weighed, single)
    between = disagreement(x, known, weighed.weights, sources, kinds, single.covariances[0])
    effective = known.sum(axis=0) * weighed.effective / len(weighed)
    return Moments(rows.node_id, rows.axes, single.means[0], raise_to_floor(between.within), effective, between)


def extent_moments(rows: ClassRows) -> Moments:
    """The moments over sorted extents, straight from the rows that state all three: nothing is open there."""
    whole = ~np.isnan(rows.x).any(axis=1)
    weights = row_weights(rows.sources, rows.kinds)[rows.owner[whole]]
    x = rows.x[whole]
    if not weights.sum() > 0:
        return Moments(rows.node_id, rows.axes, VAGUE.mean, VAGUE.covariance, np.zeros(3), None)
    mean = weights @ x / weights.sum()
    typical = VAGUE.covariance_rows * float((weights**2).sum() / weights.sum())
    scatter = np.einsum("n,ni,nj->ij", weights, x - mean, x - mean) + typical * VAGUE.covariance
    effective = np.full(3, weights.sum() ** 2 / (weights**2).sum())
    return Moments(rows.node_id, rows.axes, mean, raise_to_floor(scatter / (weights.sum() + typical)), effective, None)


def class_prior(rows: ClassRows, belief: Belief, model: SharedModel, seed: int, heldout: bool = True) -> Prior:
    """The prior of a class over the axes that its rows state.

    Parameters
    ----------
    belief : the parent's moments; model : disagreement of sources over all classes; heldout : whether to score it
    """
    if rows.is_curated:
        mixture, known = _curated_mixture(rows)
        return _prior(
            rows,
            mixture,
            model.covariance(mixture.covariances[0]),
            known,
            borrowed=0.0,
            n_sources=len(set(rows.sources)),
            weights=None,
        )
    weighed, sources, kinds = _weighted_rows(rows)
    single = fit_mixture(weighed, 1, belief)
    x, known = complete_rows(weighed, single.mixture)
    between = disagreement(x, known, weighed.weights, sources, kinds, single.mixture.covariances[0])
    shared = shared_covariance(between, model)
    code = np.searchsorted(np.asarray(between.sources), np.asarray(sources))
    centred = weighed.shift(source_effects(between, shared)[code])
    best, components = _components(centred, belief, seed)
    mass = known.sum(axis=0)
    borrowed = belief.covariance_rows / (belief.covariance_rows + weighed.effective) if components == 1 else 0.0
    prior = _prior(rows, best, shared, mass, borrowed, len(between.sources), row_weights(rows.sources, rows.kinds))
    if not heldout:
        return prior
    score = heldout_log_density(centred, components, belief, shared, published_axes(mass), seed)
    return replace(prior, heldout_log_density=score)


def heldout_log_density(
    rows: Rows, components: int, belief: Belief, shared: FloatArray, axes: NDArray[np.intp], seed: int
) -> float | None:
    """Mean log density over log mm of rows that the fit did not see, by cross-validation; None of too few.

    Scored are the rows that state all of `axes`, under the density of an object of unknown source.
    """
    single = rows.candidates == 1
    complete = single & ~np.isnan(rows.x[rows.starts][:, axes]).any(axis=1)
    if complete.sum() < HELDOUT_ROWS:
        return None
    fold = np.random.default_rng(seed).permutation(len(rows)) % FOLDS
    total = 0.0
    for held in range(FOLDS):
        seen = rows.subset(np.flatnonzero(fold != held))
        mixture = _predictive(fit_mixture(seen, components, belief, seed), belief, seen.effective)
        prior = Prior("", _placeholders(axes), mixture.weights, *_marginal(mixture, shared, axes), 0, 0, {}, 0.0)
        scored = np.flatnonzero(complete & (fold == held))
        if len(scored):
            total += float(prior.log_density(np.exp(rows.x[rows.starts[scored]][:, axes])).sum())
    return total / int(complete.sum())


def published_axes(known: FloatArray) -> NDArray[np.intp]:
    """Axes that at least `KNOWN_ROWS` rows state, in expectation; the likeliest one where a lone number may be any."""
    return np.flatnonzero(known >= min(KNOWN_ROWS, float(known.max())))


def _placeholders(axes: NDArray[np.intp]) -> tuple[str, ...]:
    """Placeholder names of axes, for a prior that is only scored."""
    return tuple(f"axis{axis}" for axis in axes)


def _weighted_rows(rows: ClassRows) -> tuple[Rows, list[str], list[str]]:
    """The rows that count, with their weights, and the source and kind of each."""
    weights = row_weights(rows.sources, rows.kinds)
    counting = np.flatnonzero(weights > 0)
    sources, kinds = ([names[row] for row in counting] for names in (rows.sources, rows.kinds))
    return Rows(rows.x, rows.owner, weights).subset(counting), sources, kinds


def _components(rows: Rows, belief: Belief, seed: int) -> tuple[Mixture, int]:
    """The mixture of the smallest BIC, as the predictive density of a further object of the same source."""
    effective = rows.effective
    largest = max(1, min(COMPONENTS, int(effective // COMPONENT_ROWS)))
    best = single = fit_mixture(rows, 1, belief, seed)
    for k in range(2, largest + 1):
        fit = fit_mixture(rows, k, belief, seed, single)
        if fit.bic(effective) >= best.bic(effective) and k > len(best.mixture.weights) + 1:
            break  # two more components in vain: a third is not tried
        best = min(best, fit, key=lambda one: one.bic(effective))
    return _predictive(best, belief, effective), len(best.mixture.weights)


def _predictive(fit: Fitted, belief: Belief, effective: float) -> Mixture:
    """Of one component: the predictive Student's t of the normal-inverse-Wishart, as a mixture of Gaussians."""
    if len(fit.mixture.weights) > 1:
        return fit.mixture
    kappa, rows = belief.mean_rows + effective, belief.covariance_rows + effective
    covariance = fit.mixture.covariances[0] * (1 + 1 / kappa)  # of the t, were it to exist; see Gelman et al. 3.6
    variances = _t_variances(rows + 2)
    k = len(variances)
    return Mixture(np.full(k, 1 / k), np.repeat(fit.mixture.means, k, axis=0), variances[:, None, None] * covariance)


def _t_variances(freedom: float) -> FloatArray:
    """Variances of equally likely Gaussians that stand for a t of unit variance: quantiles of its mixing gamma."""
    if freedom > GAUSSIAN_FREEDOM:
        return np.ones(1)
    from scipy.special import gammaincinv  # fits only: a query must not load SciPy

    middle = (np.arange(T_COMPONENTS) + 0.5) / T_COMPONENTS
    variances = np.sort(1 / gammaincinv(freedom / 2, middle))
    return np.asarray(variances / variances.mean())


def _curated_mixture(rows: ClassRows) -> tuple[Mixture, FloatArray]:
    """One widened Gaussian from curated ranges: typical sizes averaged over the rows, spreads too."""
    first = rows.x[np.searchsorted(rows.owner, np.arange(len(rows.sources)))]  # (n, 3)
    known = (~np.isnan(first)).sum(axis=0).astype(float)
    mean = np.where(known > 0, np.nansum(first, axis=0) / np.maximum(known, 1), VAGUE.mean)
    stated = ~np.isnan(rows.range_sd)
    sd = np.where(stated.any(axis=0), np.nansum(rows.range_sd, axis=0) / np.maximum(stated.sum(axis=0), 1), VAGUE_SD)
    return Mixture(np.ones(1), mean[None], raise_to_floor(correlated_covariance(CURATED_WIDENING * sd))[None]), known


def _prior(
    rows: ClassRows,
    mixture: Mixture,
    shared: FloatArray,
    known: FloatArray,
    borrowed: float,
    n_sources: int,
    weights: FloatArray | None,
) -> Prior:
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
        share_by_kind=shares(rows.kinds, np.ones(len(rows.kinds)) if weights is None else weights),
        borrowed=borrowed,
    )


def _marginal(
    mixture: Mixture, shared: FloatArray, axes: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    block = (axes[:, None], axes)
    return mixture.means[:, axes], mixture.covariances[:, block[0], block[1]], shared[block]
