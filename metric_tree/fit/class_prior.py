"""The prior of one class from its rows: weights, the class's centre, components by BIC, borrowing where it is thin.

The order of a fit: one Gaussian by EM over all rows (which resolves missing axes and hidden axis order), the sources'
means, the centre from all of them by what their kinds are worth, the rows less their source's predicted effect, a
mixture of one to four components, moved onto the centre. Ranges and means of many things speak as sources for the
centre, and their spread takes the place of what is believed of the parent's children.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_tree.fit.centre import class_centre, shared_covariance
from metric_tree.fit.disagreement import Disagreement, disagreement, with_statements
from metric_tree.fit.em import SPREAD_FLOOR, Belief, Fitted, Mixture, Rows, complete_rows, fit_mixture, raise_to_floor
from metric_tree.fit.evidence import STATEMENTS, row_weights, shares
from metric_tree.fit.kinds import KindModel
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

#: Rows that the spread of a stated range counts in place of the parent's: two and a half times as many, for it is of
#: the class itself.
STATED_ROWS = 20.0

#: Part of a stated range's variance that objects of one scene share: the range holds everything that a class may be.
STATED_SHARED = 0.35

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
    range_sd : (n, 3) standard deviation of ln size that a row states, NaN elsewhere; n : items that the rows stand for,
    ranges and means not counted; scene_share : (n,) one over the rows of the class in the row's scene.
    """

    node_id: str
    axes: tuple[str, ...]
    x: FloatArray
    owner: NDArray[np.intp]
    sources: tuple[str, ...]
    kinds: tuple[str, ...]
    range_sd: FloatArray
    n: int
    scene_share: FloatArray | None = None

    @property
    def is_stated(self) -> bool:
        """Whether nothing but ranges and means is known of the class."""
        return set(self.kinds) <= STATEMENTS

    @property
    def weights(self) -> FloatArray:
        """Weight of each row in the shape of the class, (n,)."""
        first = self.x[np.searchsorted(self.owner, np.arange(len(self.sources)))]
        stated = (~np.isnan(first)).sum(axis=1)
        return row_weights(self.sources, self.kinds, self.scene_share, stated, bool((self.range_sd > 0).any()))

    @property
    def worth(self) -> float:
        """How much a row says of the spread on average, 0 to 1; one where products and measurements alone count."""
        weights = self.weights
        counting = weights > 0
        if not counting.any():
            return 1.0
        plain = row_weights(self.sources, ["product"] * len(self.kinds), self.scene_share)
        return float(min(1.0, weights[counting].sum() / plain[counting].sum()))


@dataclass(frozen=True, slots=True, eq=False)
class Statements:
    """What ranges and means say, source by source: names, kinds (s,), means and sd (s, 3) of ln mm, NaN unstated."""

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    means: FloatArray
    sd: FloatArray

    @property
    def spread(self) -> FloatArray:
        """Standard deviation of ln size that is stated of each axis, (3,), NaN of none."""
        return _nanmean(self.sd)


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
    """The moments of a class from its own rows alone, for its parent and for the model of kinds."""
    statements = _statements(rows)
    belief = _own_belief(VAGUE, statements)
    if rows.is_stated:
        mean = _nanmean(statements.means)
        known = (~np.isnan(statements.means)).sum(axis=0).astype(float)
        between = with_statements(_nothing(belief.covariance), statements.names, statements.kinds, statements.means)
        return Moments(
            rows.node_id, rows.axes, np.where(np.isnan(mean), VAGUE.mean, mean), belief.covariance, known, between
        )
    weighed, sources, kinds = _weighted_rows(rows)
    single = fit_mixture(weighed, 1, belief).mixture
    x, known = complete_rows(weighed, single)
    between = disagreement(x, known, weighed.weights, sources, kinds, single.covariances[0])
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


def class_prior(
    rows: ClassRows, belief: Belief, model: KindModel, family: str = "", seed: int = 0, heldout: bool = True
) -> Prior:
    """The prior of a class over the axes that its rows state.

    Parameters
    ----------
    belief : the parent's moments; model : what kinds of evidence are worth; family : of the class; heldout : whether to
        score it
    """
    statements = _statements(rows)
    belief = _own_belief(belief, statements)
    belief = replace(belief, covariance_rows=belief.covariance_rows / rows.worth)
    if rows.is_stated:
        return _stated_prior(rows, statements, belief, model, family)
    weighed, sources, kinds = _weighted_rows(rows)
    single = fit_mixture(weighed, 1, belief)
    x, known = complete_rows(weighed, single.mixture)
    between = disagreement(x, known, weighed.weights, sources, kinds, single.mixture.covariances[0])
    between = with_statements(between, statements.names, statements.kinds, statements.means)
    shared = _within_range(shared_covariance(between, model, family), statements)
    centre = class_centre(between, shared, model, family)
    code = np.array([between.sources.index(name) for name in sources])
    centred = _scale_spread(weighed.shift(centre.effects[code]), centre.mean, kinds, model)
    best, components = _components(centred, belief, seed, rows.worth)
    best = _move_to_mean(best, centred, x - centre.effects[code], known, centre.mean)
    mass = known.sum(axis=0) + (~np.isnan(statements.means)).sum(axis=0)
    borrowed = belief.covariance_rows / (belief.covariance_rows + weighed.effective) if components == 1 else 0.0
    stated = bool((~np.isnan(statements.spread)).any())
    known_sd = np.sqrt(np.where(np.isfinite(centre.variance), centre.variance, 0.0))
    total = _within_range(shared + correlated_covariance(known_sd), statements)
    prior = _prior(
        rows, best, total, mass, 0.0 if stated else borrowed, len(between.sources), _shares(rows, statements, borrowed)
    )
    if not heldout:
        return prior
    score = heldout_log_density(centred, components, belief, shared, published_axes(mass), seed)
    return replace(prior, heldout_log_density=score)


def heldout_log_density(
    rows: Rows, components: int, belief: Belief, shared: FloatArray, axes: NDArray[np.intp], seed: int
) -> float | None:
    """Mean log density over log mm of rows that the fit did not see, by cross-validation; None of too few.

    shared : B (d, d). The rows that state all of `axes` (k,) are scored, as of an object of unknown source.
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
    """Axes (k,) that at least `KNOWN_ROWS` rows state, by the expected counts `known` (d,); else the likeliest."""
    return np.flatnonzero(known >= min(KNOWN_ROWS, float(known.max())))


def _placeholders(axes: NDArray[np.intp]) -> tuple[str, ...]:
    """Placeholder names of axes (k,), for a prior that is only scored."""
    return tuple(f"axis{axis}" for axis in axes)


def _weighted_rows(rows: ClassRows) -> tuple[Rows, list[str], list[str]]:
    """The rows that count, with their weights, and the source and kind of each."""
    weights = rows.weights
    counting = np.flatnonzero(weights > 0)
    sources, kinds = ([names[row] for row in counting] for names in (rows.sources, rows.kinds))
    return Rows(rows.x, rows.owner, weights).subset(counting), sources, kinds


def _components(rows: Rows, belief: Belief, seed: int, worth: float = 1.0) -> tuple[Mixture, int]:
    """The mixture of the smallest BIC, as the predictive density of a further object of the same source."""
    effective = rows.effective
    largest = max(1, min(COMPONENTS, int(worth * _whole_rows(rows) // COMPONENT_ROWS)))
    best = single = fit_mixture(rows, 1, belief, seed)
    for k in range(2, largest + 1):
        fit = fit_mixture(rows, k, belief, seed, single)
        if fit.bic(effective) >= best.bic(effective) and k > len(best.mixture.weights) + 1:
            break  # two more components in vain: a third is not tried
        best = min(best, fit, key=lambda one: one.bic(effective))
    return _predictive(best, belief, effective), len(best.mixture.weights)


def _predictive(fit: Fitted, belief: Belief, effective: float) -> Mixture:
    """Of one component: Student's t of an uncertain covariance, as a mixture of Gaussians (Gelman et al. 3.6).

    How well the mean is known is the business of the class's centre.
    """
    if len(fit.mixture.weights) > 1:
        return fit.mixture
    variances = _t_variances(belief.covariance_rows + effective + 2)
    k = len(variances)
    covariances = variances[:, None, None] * fit.mixture.covariances[0]
    return Mixture(np.full(k, 1 / k), np.repeat(fit.mixture.means, k, axis=0), covariances)


def _t_variances(freedom: float) -> FloatArray:
    """(c,) variances of equally likely Gaussians that stand for a t of unit variance: quantiles of its gamma."""
    if freedom > GAUSSIAN_FREEDOM:
        return np.ones(1)
    from scipy.special import gammaincinv  # fits only: a query must not load SciPy

    middle = (np.arange(T_COMPONENTS) + 0.5) / T_COMPONENTS
    variances = np.sort(1 / gammaincinv(freedom / 2, middle))
    return np.asarray(variances / variances.mean())


def _statements(rows: ClassRows) -> Statements:
    """The ranges and means among the rows, those of one source together; a row of open axes states nothing."""
    first = rows.x[np.searchsorted(rows.owner, np.arange(len(rows.sources)))]  # (n, 3)
    plain = np.bincount(rows.owner, minlength=len(rows.sources)) == 1
    stating = np.array([kind in STATEMENTS for kind in rows.kinds], dtype=bool) & plain
    names = sorted({name for name, states in zip(rows.sources, stating, strict=True) if states})
    own = [stating & (np.asarray(rows.sources) == name) for name in names]
    return Statements(
        tuple(names),
        tuple(rows.kinds[int(np.flatnonzero(mask)[0])] for mask in own),
        np.array([_nanmean(first[mask]) for mask in own]).reshape(-1, 3),
        np.array([_nanmean(rows.range_sd[mask]) for mask in own]).reshape(-1, 3),
    )


def _nanmean(values: FloatArray) -> FloatArray:
    """Mean over the rows of (n, 3), NaN where none is known."""
    known = (~np.isnan(values)).sum(axis=0)
    return np.asarray(np.where(known > 0, np.nansum(values, axis=0) / np.maximum(known, 1), np.nan))


def _own_belief(belief: Belief, statements: Statements) -> Belief:
    """The parent's belief, with the spread that is stated of the class itself in place of the parent's."""
    stated = ~np.isnan(statements.spread)
    if not stated.any():
        return belief
    own = np.sqrt(np.diagonal(belief.covariance))
    part = math.sqrt(1 - STATED_SHARED)
    scale = np.where(stated, part * statements.spread, own) / own
    covariance = belief.covariance * np.outer(scale, scale)
    floor = min(SPREAD_FLOOR, float(np.nanmin(statements.spread)) / 2)
    return replace(belief, covariance=covariance, covariance_rows=STATED_ROWS, floor=floor)


def _nothing(within: FloatArray) -> Disagreement:
    """A class without rows; `within` is W (d, d)."""
    none = np.empty((0, len(within)))
    return Disagreement((), (), none, none, within, 0 * within, 0.0, np.empty(0))


def _stated_prior(rows: ClassRows, statements: Statements, belief: Belief, model: KindModel, family: str) -> Prior:
    """The prior of a class of which only ranges and means are known: the stated variance, parted into W and B."""
    between = with_statements(_nothing(belief.covariance), statements.names, statements.kinds, statements.means)
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


def _within_range(shared: FloatArray, statements: Statements) -> FloatArray:
    """B (3, 3), on no axis with more than its part of a stated range's variance."""
    bound = np.sqrt(STATED_SHARED) * np.nan_to_num(statements.spread, nan=np.inf)
    sd = np.sqrt(np.diagonal(shared))
    scale = np.minimum(1.0, bound / np.maximum(sd, 1e-12))
    return np.asarray(shared * np.outer(scale, scale))


def _scale_spread(rows: Rows, mean: FloatArray, kinds: Sequence[str], model: KindModel) -> Rows:
    """The rows with the spread of their kind brought to that of products, about the centre, mean (d,)."""
    factor = np.exp([-model.ratio.get(kind, 0.0) for kind in kinds])[rows.owner][:, None]
    centre = np.nan_to_num(mean)
    return Rows(centre + (rows.x - centre) * np.where(np.isnan(mean), 1.0, factor), rows.owner, rows.weights)


def _move_to_mean(mixture: Mixture, rows: Rows, x: FloatArray, known: FloatArray, mean: FloatArray) -> Mixture:
    """The mixture moved so that the stated sizes x (n, d) lie about `mean` (d,), if any row states the axis.

    What EM makes of sizes that are not stated by chance alone stays.
    """
    mass = rows.weights @ known
    with np.errstate(divide="ignore", invalid="ignore"):
        lies = np.where(mass > 0, rows.weights @ (known * x) / mass, mixture.weights @ mixture.means)
    offset = np.where(np.isnan(mean), 0.0, mean - lies)
    return Mixture(mixture.weights, mixture.means + offset, mixture.covariances)


def _whole_rows(rows: Rows) -> float:
    """Effective number of the rows that state as many axes as any."""
    stated = (~np.isnan(rows.x[rows.starts])).sum(axis=1)
    weights = rows.weights[stated >= min(2, int(stated.max()))]
    return float(weights.sum() ** 2 / (weights**2).sum())


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
