"""Hypotheses about the similarity of the objects of one class in one scene, which the posterior mixes.

Ten office chairs in an office are often identical; ten tables need not be. With the components m_k, S_k of the prior
of a class, the error B between its sources, and the fraction rho of the variance within a source that the objects of
the scene have in common, the hypotheses are

    assorted    x_i ~ sum_k w_k N(m_k + e, S_k),            e ~ N(0, B)
    related     x_i ~ sum_k w_k N(m_k + e, (1 - rho) S_k),  e ~ N(0, B + rho sum_k w_k S_k),   rho = 0.5
    one kind    x_i ~ N(m_k + e, (1 - rho) S_k),            e ~ N(0, B + rho S_k),             rho = 0.9, k ~ w
    mislabelled x_i ~ N(m + e, (1 - rho) S),                e ~ N(0, B + 0.7^2 I),  rho = 0 or 0.9, with the moments
                m, S of the mixture: the label means another object in this scene
    biased      x_i ~ sum_k w_k N(m_k + e, (1 - rho) S_k),  e ~ N(0, 5 B + 0.1^2 h h' + rho sum_k w_k S_k),
                rho = 0.5, with h = 1 for length and width: the sources disagree more than B, mainly in the footprint

All hypotheses have a shared error and are integrated in the same way (`shared_error`); their evidence decides. For a
single object, the first three are almost equal, and only `assorted`, `mislabelled` and `biased` are used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from estimator.posterior.axis_assignments import prior_axes
from estimator.posterior.shared_error import SharedError, shared_error, split_error
from metric_base.arrays import FloatArray
from metric_tree.axes import AXES
from metric_tree.fit.mixture import Mixture, reduce_mixture
from metric_tree.prior import Prior

#: Probabilities of assorted, related and one kind. In the rooms of ScanNet, the fractions rho of log extents within
#: classes are close to 0, 0.5 and 0.9 in these proportions.
SIMILARITY_WEIGHTS = (0.3, 0.4, 0.3)
#: Fraction rho of the variance of related objects.
RELATED_FRACTION = 0.5
#: Fraction rho of the variance if all objects are of the same kind.
ONE_KIND_FRACTION = 0.9
#: Probability that the label of several objects means another object in this scene, or that the prior does not describe
#: the objects in rooms. Chosen on rooms of a source that the priors do not contain (docs/evidence/calibration.md).
MISLABEL_PROBABILITY = 0.2
#: The same for priors of one dimension, which have no proportions: with a higher probability, a scene with persons only
#: would have no scale.
MISLABEL_PROBABILITY_1D = 0.03
#: Standard deviation of the error of mislabelled sizes, natural log: a factor of two.
MISLABEL_SD_LOG = 0.7
#: Probability that B is too small for this scene if no row of the class was measured in place; it decreases with the
#: fraction of these rows. The values describe the differences of classes that both catalogues and rooms contain; chosen
#: on one half of the rooms and streets (docs/evidence/calibration.md).
BIAS_PROBABILITY = 0.3
#: Factor of B in this case.
BIAS_FACTOR = 5.0
#: Additional standard deviation that ln length and ln width have in common in this case.
FOOTPRINT_SD_LOG = 0.1
#: Kinds of rows that were measured where the objects are used.
IN_PLACE = ("measured", "statistic")
#: Dimensions of the footprint.
FOOTPRINT = ("length", "width")
#: Maximum number of kinds; the components of a prior are merged to this number.
MAX_KINDS = 3
#: Indices of the sorted extents that may be vertical; the objects of a class have the same one.
VERTICAL_EXTENTS = (0, 1, 2)


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """One hypothesis about the objects of a class."""

    #: Distribution of each object, independent of the others.
    prior: Prior
    #: Error that the objects have in common.
    error: SharedError
    log_weight: float
    #: Index of the sorted extent that is vertical, or -1 if it may differ between objects.
    vertical_extent: int = -1
    #: The label means another object.
    is_mislabelled: bool = False
    #: B is too small.
    is_biased: bool = False


@lru_cache(maxsize=1024)
def hypotheses(prior: Prior, is_open: bool = False) -> tuple[Hypothesis, ...]:
    """Return the hypotheses of a class with several objects; their weights sum to 1.

    Parameters
    ----------
    prior : Prior
    is_open : bool, default False
        The vertical of an object is unknown: each hypothesis is repeated for each vertical extent.
    """
    axes, between = prior_axes(prior), prior.disagreement()
    within = np.einsum("k,kij->ij", prior.weights, prior.covariances)
    related_prior = replace(prior, covariances=(1 - RELATED_FRACTION) * prior.covariances)
    mixture = Mixture(prior.weights, prior.means, prior.covariances)
    assorted, related, one_kind = _similarity_weights(prior)
    mislabelled = mislabel_probability(prior)
    right = 1 - mislabelled

    def component(mean: FloatArray, covariance: FloatArray) -> Prior:
        """Return the prior with a single component."""
        return replace(prior, weights=np.ones(1), means=mean[None], covariances=covariance[None])

    plain = [
        Hypothesis(prior, shared_error(prior), math.log(assorted * right)),
        Hypothesis(related_prior, split_error(between + RELATED_FRACTION * within, axes), math.log(related * right)),
    ]
    kinds = reduce_mixture(mixture, MAX_KINDS)
    fractions = kinds.weights / kinds.weights.sum()
    for fraction, mean, covariance in zip(fractions, kinds.means, kinds.covariances, strict=True):
        own = component(mean, (1 - ONE_KIND_FRACTION) * covariance)
        error = split_error(between + ONE_KIND_FRACTION * covariance, axes)
        plain.append(Hypothesis(own, error, math.log(max(one_kind * right * fraction, 1e-300))))
    if biased := bias_probability(prior):
        log_unbiased = math.log(1 - biased)
        plain = [replace(hypothesis, log_weight=hypothesis.log_weight + log_unbiased) for hypothesis in plain]
        error = split_error(biased_error(prior) + RELATED_FRACTION * within, axes)
        plain.append(Hypothesis(related_prior, error, math.log(biased * right), is_biased=True))
    moments = reduce_mixture(mixture, 1)
    error = split_error(mislabelled_error(prior), axes)
    for own_fraction in (1.0, 1 - ONE_KIND_FRACTION):
        own = component(moments.means[0], own_fraction * moments.covariances[0])
        plain.append(Hypothesis(own, error, math.log(mislabelled / 2), is_mislabelled=True))
    if not is_open:
        return tuple(plain)
    log_count = math.log(len(VERTICAL_EXTENTS))
    return tuple(
        replace(hypothesis, vertical_extent=extent, log_weight=hypothesis.log_weight - log_count)
        for extent in VERTICAL_EXTENTS
        for hypothesis in plain
    )


def bias_probability(prior: Prior) -> float:
    """Return the probability that B is too small; 0 without proportions, which are necessary to detect it."""
    if len(prior.dims) < len(AXES) or prior.tier == "norm":
        return 0.0
    return BIAS_PROBABILITY * (1 - min(sum(prior.share_by_kind.get(kind, 0.0) for kind in IN_PLACE), 1.0))


def biased_error(prior: Prior) -> FloatArray:
    """Return the covariance (d, d) of the shared error if B is too small."""
    footprint = np.array([dim in FOOTPRINT for dim in prior.dims], dtype=float)
    return np.asarray(BIAS_FACTOR * prior.disagreement() + FOOTPRINT_SD_LOG**2 * np.outer(footprint, footprint))


def mislabel_probability(prior: Prior) -> float:
    """Return the probability that a label means another object in this scene."""
    return MISLABEL_PROBABILITY if len(prior.dims) > 1 else MISLABEL_PROBABILITY_1D


def mislabelled_error(prior: Prior) -> FloatArray:
    """Return the covariance (d, d) of the error of mislabelled objects."""
    return np.asarray(prior.disagreement() + MISLABEL_SD_LOG**2 * np.eye(len(prior.dims)))


def _similarity_weights(prior: Prior) -> FloatArray:
    """Return the probabilities (3,) of assorted, related and one kind.

    If the release states the mean fraction rho of the class (`sameness`), the weights are tilted to this mean.
    """
    weights = np.array(SIMILARITY_WEIGHTS)
    mean = prior.sameness
    if mean is None or not np.isfinite(mean):
        return weights
    fractions = np.array([0.0, RELATED_FRACTION, ONE_KIND_FRACTION])
    target = float(np.clip(mean, 0.05, ONE_KIND_FRACTION - 0.05))
    low, high = -40.0, 40.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        tilted = weights * np.exp(middle * fractions)
        low, high = (middle, high) if tilted @ fractions / tilted.sum() < target else (low, middle)
    return np.asarray(tilted / tilted.sum())
