"""Gaussian mixtures from rows that lack coordinates or do not say which axis is which (docs/explanation/priors.md).

A row of a table is a weighted set of candidates, one for each assignment of its numbers to the axes that the pose
allows; a coordinate of a candidate that no number was assigned to is missing. With c over the candidates of row i,

    log p(row i) = log sum_c sum_k w_k N(x_c,obs; m_k,obs, S_k,obs) / candidates of i

and the EM of Ghahramani and Jordan (1994, "Supervised learning from incomplete data") extends to the sum over c:
missing coordinates enter the maximisation with their conditional mean and covariance under each component.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_base.statistics import gaussian_log_densities

#: Smallest standard deviation of ln size along any direction. Three per cent is the tolerance of catalogue figures
#: (rounding to a centimetre, a spout or handle counted or not): held-out log density is better with it than without.
SPREAD_FLOOR = 0.03

#: EM stops when a row's mean log likelihood gains less than this, far below what BIC can tell apart.
TOLERANCE = 1e-5
ITERATIONS = 120

#: Starts of a mixture of several components, and steps after which only the best goes on.
STARTS = 3
SHORT_RUN = 8

#: Rows from which a belief's mean settles the order of the axes.
MIN_INFORMATIVE_ROWS = 1.0

#: Of several components each takes this many rows' worth of the whole class's covariance, narrowed by their number: it
#: keeps an axis without data in a component finite and is lost beside the fifteen rows that a component has at least.
STABILISER_ROWS = 0.2


@dataclass(frozen=True, eq=False)
class Rows:
    """Weighted rows over d axes.

    x : (m, d) candidates in ln mm, NaN where missing; owner : (m,) the row of each, ascending; weights : (n,).
    """

    x: FloatArray
    owner: NDArray[np.intp]
    weights: FloatArray

    @classmethod
    def plain(cls, x: FloatArray, weights: FloatArray | None = None) -> Rows:
        """Rows x (n, d) that know their axes, of weights (n,), by default 1: one candidate each."""
        n = len(x)
        return cls(np.asarray(x, dtype=float), np.arange(n), np.ones(n) if weights is None else weights)

    def __len__(self) -> int:
        return len(self.weights)

    @property
    def dimensions(self) -> int:
        """Number of axes d."""
        return int(self.x.shape[1])

    @cached_property
    def starts(self) -> NDArray[np.intp]:
        """(n,) first candidate of each row."""
        return np.searchsorted(self.owner, np.arange(len(self)))

    @cached_property
    def candidates(self) -> NDArray[np.intp]:
        """(n,) candidates of each row."""
        return np.diff(np.append(self.starts, len(self.x)))

    @cached_property
    def patterns(self) -> list[tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]]:
        """Per pattern of missing coordinates: candidates (k,), axes observed (a,), axes missing (d - a,)."""
        observed = ~np.isnan(self.x)
        codes = observed @ (1 << np.arange(self.dimensions))
        return [
            (np.flatnonzero(codes == code), np.flatnonzero(code >> np.arange(self.dimensions) & 1), missing)
            for code in np.unique(codes)
            for missing in [np.flatnonzero(~(code >> np.arange(self.dimensions) & 1).astype(bool))]
        ]

    @property
    def effective(self) -> float:
        """Kish's effective number of rows, (sum w)^2 / sum w^2."""
        return float(self.weights.sum() ** 2 / (self.weights**2).sum()) if len(self) else 0.0

    def subset(self, rows: NDArray[np.intp]) -> Rows:
        """The rows of the given numbers (k,), ascending."""
        kept = np.isin(self.owner, rows)
        return Rows(self.x[kept], np.searchsorted(rows, self.owner[kept]), self.weights[rows])

    def shift(self, offsets: FloatArray) -> Rows:
        """The rows minus offsets (n, d)."""
        return Rows(self.x - offsets[self.owner], self.owner, self.weights)


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """weights (k,), means (k, d), covariances (k, d, d) of ln mm."""

    weights: FloatArray
    means: FloatArray
    covariances: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """What is believed of a class before its own rows: a normal-inverse-Wishart.

    mean (d,) worth `mean_rows` rows, expected covariance (d, d) worth `covariance_rows` rows; floor : least standard
    deviation of ln size of a component in any direction.
    """

    mean: FloatArray
    mean_rows: float
    covariance: FloatArray
    covariance_rows: float
    floor: float = SPREAD_FLOOR


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A mixture with the weighted log likelihood of the rows it was fitted to, and the fit's parameters' count."""

    mixture: Mixture
    log_likelihood: float
    parameters: int = field(default=0)

    def bic(self, effective: float) -> float:
        """Bayesian information criterion (Schwarz 1978), smaller is better."""
        return self.parameters * math.log(max(effective, 1.0)) - 2 * self.log_likelihood


def fit_mixture(rows: Rows, components: int, belief: Belief, seed: int = 0, single: Fitted | None = None) -> Fitted:
    """The mixture of `components` Gaussians by EM, the best of several starts.

    `single` is the fit of one component if it is known; it places the starts of several.
    One component takes the whole belief; of several, each only takes `STABILISER_ROWS`.
    """
    weights = rows.weights * (rows.effective / rows.weights.sum())  # so that the log likelihood counts real rows
    rows = Rows(rows.x, rows.owner, weights)
    if single is None:
        first, *others = _single_starts(rows, belief)
        if others:
            short = [_run_em(rows, start, belief, SHORT_RUN) for start in (first, *others)]
            first = max(short, key=_log_likelihood).mixture
        single = _run_em(rows, first, belief)
    if components == 1:
        return single
    weak = Belief(
        single.mixture.means[0], 0.0, single.mixture.covariances[0] / components**2, STABILISER_ROWS, belief.floor
    )
    starts = _starts(rows, components, single.mixture, weak, seed)
    short = [_run_em(rows, start, weak, SHORT_RUN) for start in starts]
    return _run_em(rows, max(short, key=_log_likelihood).mixture, weak)


def complete_rows(rows: Rows, mixture: Mixture) -> tuple[FloatArray, FloatArray]:
    """Each row's conditional mean under a mixture, missing axes and axis order resolved.

    Returns
    -------
    x : (n, d) ln mm
    known : (n, d) the probability that a number was stated for the axis, 0 to 1
    """
    responsibility, _ = _expectation(rows, mixture)
    x, known = np.zeros((len(rows), rows.dimensions)), np.zeros((len(rows), rows.dimensions))
    for index, filled, _ in _completions(rows, mixture):
        share = responsibility[index]  # (c, k)
        np.add.at(x, rows.owner[index], np.einsum("ck,kcd->cd", share, filled))
        np.add.at(known, rows.owner[index], share.sum(axis=1)[:, None] * ~np.isnan(rows.x[index]))
    return x, known


def raise_to_floor(covariances: FloatArray, floor: float = SPREAD_FLOOR) -> FloatArray:
    """The covariances (..., d, d) with no standard deviation below `floor` in any direction."""
    values, vectors = np.linalg.eigh((covariances + np.swapaxes(covariances, -1, -2)) / 2)
    raised: FloatArray = np.einsum("...ij,...j,...kj->...ik", vectors, np.maximum(values, floor**2), vectors)
    return raised


def _run_em(rows: Rows, start: Mixture, belief: Belief, iterations: int = ITERATIONS) -> Fitted:
    mixture, before = start, -math.inf
    total = rows.weights.sum()
    k, d = start.means.shape
    parameters = k * (d + d * (d + 1) // 2) + k - 1
    for _ in range(iterations):
        responsibility, log_density = _expectation(rows, mixture)
        likelihood = float(rows.weights @ log_density)
        if likelihood - before < TOLERANCE * total and before > -math.inf:
            break
        before = likelihood
        mixture = _maximisation(rows, mixture, responsibility, belief)
    return Fitted(mixture, float(rows.weights @ _expectation(rows, mixture)[1]), parameters)


def _log_likelihood(fitted: Fitted) -> float:
    return fitted.log_likelihood


def _expectation(rows: Rows, mixture: Mixture) -> tuple[FloatArray, FloatArray]:
    """Responsibilities (m, k), summing to one over the candidates of a row, and log densities (n,) of the rows."""
    terms = np.empty((len(rows.x), len(mixture.weights)))
    for index, axes, _ in rows.patterns:
        block = mixture.covariances[:, axes[:, None], axes]  # (k, o, o)
        terms[index] = gaussian_log_densities(rows.x[index][:, axes], mixture.means[:, axes], block).T
    with np.errstate(divide="ignore"):  # a component that died has log weight -inf
        terms += np.log(mixture.weights) - np.log(rows.candidates)[rows.owner][:, None]
    best = np.maximum.reduceat(terms.max(axis=1), rows.starts)  # (n,)
    likelihood = np.exp(terms - best[rows.owner][:, None])  # (m, k)
    total = np.add.reduceat(likelihood.sum(axis=1), rows.starts)
    return likelihood / total[rows.owner][:, None], best + np.log(total)


def _completions(rows: Rows, mixture: Mixture) -> Iterator[tuple[NDArray[np.intp], FloatArray, FloatArray]]:
    """Per pattern: candidates, their completion (k, c, d) and its conditional covariance (k, d, d)."""
    for index, axes, missing in rows.patterns:
        filled = np.broadcast_to(rows.x[index], (len(mixture.weights), len(index), rows.dimensions)).copy()
        spread = np.zeros_like(mixture.covariances)
        if len(missing):
            across = mixture.covariances[:, missing[:, None], axes]  # (k, m, o)
            gain = np.linalg.solve(mixture.covariances[:, axes[:, None], axes], across.transpose(0, 2, 1))  # (k, o, m)
            offset = rows.x[index][:, axes][None] - mixture.means[:, None, axes]  # (k, c, o)
            filled[:, :, missing] = mixture.means[:, None, missing] + offset @ gain
            rest = mixture.covariances[:, missing[:, None], missing] - across @ gain
            spread[:, missing[:, None], missing] = rest
        yield index, filled, spread


def _maximisation(rows: Rows, mixture: Mixture, responsibility: FloatArray, belief: Belief) -> Mixture:
    """The mixture after a step of EM, given the responsibility (m, k) of each component for each candidate."""
    k, d = mixture.means.shape
    share = responsibility * rows.weights[rows.owner][:, None]  # (m, k)
    mass = share.sum(axis=0)  # (k,)
    first, second = np.zeros((k, d)), np.zeros((k, d, d))
    for index, filled, spread in _completions(rows, mixture):
        offset = filled - belief.mean  # (k, c, d), near zero so that the second moment keeps its digits
        part = share[index].T  # (k, c)
        first += np.einsum("kc,kcd->kd", part, offset)
        second += np.einsum("kc,kcd,kce->kde", part, offset, offset) + part.sum(axis=1)[:, None, None] * spread
    return _posterior_mean(mass, first, second, belief)


def _posterior_mean(mass: FloatArray, first: FloatArray, second: FloatArray, belief: Belief) -> Mixture:
    """Normal-inverse-Wishart update (Gelman et al., Bayesian Data Analysis, 3.6), moments taken about belief.mean.

    mass : (k,) weight of each component; first, second : (k, d) and (k, d, d) weighted sums of the moments, ln mm.
    """
    kappa = belief.mean_rows + mass  # (k,)
    mean = first / np.maximum(kappa, 1e-12)[:, None]  # (k, d); the belief's own mean is the origin
    scatter = second - kappa[:, None, None] * mean[:, :, None] * mean[:, None, :]
    rows = belief.covariance_rows + mass
    covariance = (belief.covariance_rows * belief.covariance + scatter) / np.maximum(rows, 1e-12)[:, None, None]
    return Mixture(mass / mass.sum(), mean + belief.mean, raise_to_floor(covariance, belief.floor))


def _single_starts(rows: Rows, belief: Belief) -> list[Mixture]:
    """The belief itself, and the moments of the rows under each rank of candidate where the order is hidden.

    A belief that is worth a row says itself which axis is which: the likelihood alone would take a door's width of
    80 cm for its thickness.
    """
    starts = [Mixture(np.ones(1), belief.mean[None], raise_to_floor(belief.covariance, belief.floor)[None])]
    if belief.mean_rows >= MIN_INFORMATIVE_ROWS:
        return starts
    for rank in range(int(rows.candidates.max()) if rows.candidates.max() > 1 else 0):
        chosen = rows.x[rows.starts + np.minimum(rank, rows.candidates - 1)]  # (n, d)
        seen = ~np.isnan(chosen)
        mass = np.maximum((rows.weights[:, None] * seen).sum(axis=0), 1e-12)
        mean = (rows.weights[:, None] * np.where(seen, chosen, 0.0)).sum(axis=0) / mass
        mean = np.where(seen.any(axis=0), mean, belief.mean)
        starts.append(Mixture(np.ones(1), mean[None], raise_to_floor(belief.covariance, belief.floor)[None]))
    return starts


def _starts(rows: Rows, components: int, single: Mixture, belief: Belief, seed: int) -> Iterator[Mixture]:
    """Hard partitions of the completed rows: along the main axis, then around k-means++ seeds."""
    x, _ = complete_rows(rows, single)
    white = np.linalg.solve(np.linalg.cholesky(single.covariances[0]), (x - single.means[0]).T).T  # (n, d)
    values, vectors = np.linalg.eigh(single.covariances[0])
    order = np.argsort(np.argsort((x - single.means[0]) @ vectors[:, np.argmax(values)], kind="stable"))
    yield _of_partition(x, rows.weights, order * components // len(x), components, belief)
    generator = np.random.default_rng(seed)
    for _ in range(STARTS - 1):
        yield _of_partition(
            x, rows.weights, _nearest_seed(white, rows.weights, components, generator), components, belief
        )


def _nearest_seed(
    x: FloatArray, weights: FloatArray, components: int, generator: np.random.Generator
) -> NDArray[np.intp]:
    """Partition (n,) by the nearest of k-means++ seeds (Arthur and Vassilvitskii 2007)."""
    seeds = [x[generator.choice(len(x), p=weights / weights.sum())]]
    for _ in range(components - 1):
        near = weights * np.min([((x - seed) ** 2).sum(axis=1) for seed in seeds], axis=0)
        near = near if near.sum() > 0 else weights
        seeds.append(x[generator.choice(len(x), p=near / near.sum())])
    nearest: NDArray[np.intp] = np.argmin([((x - seed) ** 2).sum(axis=1) for seed in seeds], axis=0)
    return nearest


def _of_partition(
    x: FloatArray, weights: FloatArray, part: NDArray[np.intp], components: int, belief: Belief
) -> Mixture:
    """The mixture of hard parts: rows x (n, d) in ln mm with weights (n,), and the component (n,) of each."""
    share = (part[None] == np.arange(components)[:, None]) * weights  # (k, n)
    offset = x - belief.mean
    first, second = share @ offset, np.einsum("kn,nd,ne->kde", share, offset, offset)
    return _posterior_mean(share.sum(axis=1) + 1e-9, first, second, belief)
