"""How alike the objects of one class in one scene are: hypotheses that the posterior mixes over.

Ten office chairs in one office are often one kind of chair; ten tables need not be. With m_k, S_k the components of a
class's prior, B its error between sources and rho the share of the spread within a source that the scene's objects
have in common, a scene's class is one of

    assorted   x_i ~ sum_k w_k N(m_k + e, S_k),            e ~ N(0, B)
    related    x_i ~ sum_k w_k N(m_k + e, (1 - rho) S_k),  e ~ N(0, B + rho sum_k w_k S_k),   rho = 0.5
    one kind   x_i ~ N(m_k + e, (1 - rho) S_k),            e ~ N(0, B + rho S_k),             rho = 0.9, k ~ w
    foreign    x_i ~ N(m + e, (1 - rho) S),                e ~ N(0, B + 0.7^2 I),  rho = 0 or 0.9, and m, S the
               moments of the mixture: the label means another object in this scene
    displaced  x_i ~ sum_k w_k N(m_k + e, (1 - rho) S_k),  e ~ N(0, 5 B + 0.1^2 h h' + rho sum_k w_k S_k),
               rho = 0.5, h one on length and width: sources disagree more than B says, above all in the footprint

Each is a class with a shared error, so that `class_error` integrates all alike; their evidence decides. For one object
the first three say nearly the same, and `assorted` stands for them, beside `displaced`.
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
from metric_tree.fit.inner_priors import reduce_mixture
from metric_tree.fit.mixture import Mixture
from metric_tree.prior import Prior

#: Probabilities of assorted, related, one kind: in ScanNet's rooms the shares of the log extents
#: within classes are near 0, 0.5 and 0.9 in so many parts.
KIND_WEIGHTS = (0.3, 0.4, 0.3)

#: Shares of the spread within a source that a scene's objects have in common.
RELATED_SHARE, ALIKE_SHARE = 0.5, 0.9

#: Probability that a label with several objects means another object in this scene, or that its prior is not of what
#: rooms hold, and by how far sizes are then off, one standard deviation of the natural log: a factor of two. Chosen on
#: rooms of a source that the priors had not seen (docs/evidence/results.md). A class of one dimension has no
#: proportions that could show it, and with as large a share a scene of persons alone would have no answer.
FOREIGN_SHARE, FOREIGN_SHARE_OF_HEIGHTS, FOREIGN_SD_LOG = 0.2, 0.03, 0.7

#: Probability that B is too small for this scene, where no row of the class was measured in place (it falls with their
#: share); by what factor it then is, and the standard deviation of what ln length and ln width have in common
#: beside it. So do classes differ that catalogues and rooms both show; chosen on one half of the rooms and streets
#: (docs/evidence/results.md).
DISPLACED_SHARE, DISPLACED_FACTOR, FOOTPRINT_SD_LOG = 0.3, 5.0, 0.1

#: Kinds of rows that show objects where they stand, and their sides there.
IN_PLACE, FOOTPRINT = ("measured", "statistic"), ("length", "width")

#: A scene's one kind is one of so many: components of a prior are merged to at most this number.
MOST_KINDS = 3

#: The objects of a class whose vertical is unknown are read alike: which of the sorted extents is vertical.
READINGS = (0, 1, 2)


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """One way in which a class's objects are alike.

    prior : what each object adds of its own; error : what all share; log_weight : of the hypothesis; reading : which of
    the three sorted extents is vertical, -1 where each object decides; foreign : the label means another object here;
    displaced : B is too small here.
    """

    prior: Prior
    error: SharedError
    log_weight: float
    reading: int = -1
    foreign: bool = False
    displaced: bool = False


@lru_cache(maxsize=1024)
def hypotheses(prior: Prior, free: bool = False) -> tuple[Hypothesis, ...]:
    """The hypotheses of a class of several objects; their weights sum to one.

    free : some object's vertical is unknown, so that each hypothesis comes with each reading of the axes.
    """
    plain = [*_usual_and_displaced(prior), *_foreign(prior)]
    if not free:
        return tuple(plain)
    third = math.log(len(READINGS))
    return tuple(
        replace(one, reading=reading, log_weight=one.log_weight - third) for reading in READINGS for one in plain
    )


def displaced_share(prior: Prior) -> float:
    """The probability that the class is displaced; without proportions nothing could show it."""
    if len(prior.dims) < len(AXES) or prior.tier == "norm":
        return 0.0
    return DISPLACED_SHARE * (1 - min(sum(prior.share_by_kind.get(kind, 0.0) for kind in IN_PLACE), 1.0))


def displaced_error(prior: Prior) -> FloatArray:
    """The covariance (d, d) of the error that a displaced class shares."""
    footprint = np.array([dim in FOOTPRINT for dim in prior.dims], dtype=float)
    return np.asarray(DISPLACED_FACTOR * prior.disagreement() + FOOTPRINT_SD_LOG**2 * np.outer(footprint, footprint))


def _usual_and_displaced(prior: Prior) -> list[Hypothesis]:
    """Assorted, related and of one kind with the error that B says, and with a larger one."""
    share = displaced_share(prior)
    usual = [*_assorted_hypotheses(prior), *_one_kind(prior)]
    if not share:
        return usual
    own = replace(prior, covariances=(1 - RELATED_SHARE) * prior.covariances)
    within = np.einsum("k,kij->ij", prior.weights, prior.covariances)
    error = _error(prior, displaced_error(prior) + RELATED_SHARE * within)
    return [
        *(replace(one, log_weight=one.log_weight + math.log(1 - share)) for one in usual),
        Hypothesis(own, error, math.log(share * (1 - _foreign_share(prior))), displaced=True),
    ]


def _assorted_hypotheses(prior: Prior) -> list[Hypothesis]:
    between = prior.disagreement()
    within = np.einsum("k,kij->ij", prior.weights, prior.covariances)
    assorted, related, _ = _kind_weights(prior)
    foreign = _foreign_share(prior)
    own = replace(prior, covariances=(1 - RELATED_SHARE) * prior.covariances)
    return [
        Hypothesis(prior, shared_error(prior), math.log(assorted * (1 - foreign))),
        Hypothesis(own, _error(prior, between + RELATED_SHARE * within), math.log(related * (1 - foreign))),
    ]


def _foreign(prior: Prior) -> list[Hypothesis]:
    """The label means another object in this scene: objects as unlike as the class's, or all alike."""
    whole = reduce_mixture(Mixture(prior.weights, prior.means, prior.covariances), 1)
    error = _error(prior, prior.disagreement() + FOREIGN_SD_LOG**2 * np.eye(len(prior.dims)))
    return [
        Hypothesis(
            replace(prior, weights=np.ones(1), means=whole.means, covariances=own * whole.covariances),
            error,
            math.log(_foreign_share(prior) / 2),
            foreign=True,
        )
        for own in (1.0, 1 - ALIKE_SHARE)
    ]


def _foreign_share(prior: Prior) -> float:
    """The probability of the foreign hypotheses."""
    return FOREIGN_SHARE if len(prior.dims) > 1 else FOREIGN_SHARE_OF_HEIGHTS


def _one_kind(prior: Prior) -> list[Hypothesis]:
    between, weight = prior.disagreement(), _kind_weights(prior)[2] * (1 - _foreign_share(prior))
    kinds = reduce_mixture(Mixture(prior.weights, prior.means, prior.covariances), MOST_KINDS)
    return [
        Hypothesis(
            replace(prior, weights=np.ones(1), means=mean[None], covariances=(1 - ALIKE_SHARE) * covariance[None]),
            _error(prior, between + ALIKE_SHARE * covariance),
            math.log(max(weight * share, 1e-300)),
        )
        for share, mean, covariance in zip(
            kinds.weights / kinds.weights.sum(), kinds.means, kinds.covariances, strict=True
        )
    ]


def _kind_weights(prior: Prior) -> FloatArray:
    """(3,) probabilities of assorted, related, one kind.

    Where the release states the mean share of a class (`sameness`), the weights are tilted to have that mean.
    """
    weights = np.array(KIND_WEIGHTS)
    stated = prior.sameness
    if stated is None or not np.isfinite(stated):
        return weights
    shares = np.array([0.0, RELATED_SHARE, ALIKE_SHARE])
    target = float(np.clip(stated, 0.05, ALIKE_SHARE - 0.05))
    low, high = -40.0, 40.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        tilted = weights * np.exp(middle * shares)
        low, high = (middle, high) if tilted @ shares / tilted.sum() < target else (low, middle)
    return np.asarray(tilted / tilted.sum())


def _error(prior: Prior, covariance: FloatArray) -> SharedError:
    """The shared error of a covariance (d, d) on the prior's axes."""
    return split_error(covariance, prior_axes(prior))
