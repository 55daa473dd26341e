"""True sizes of the objects of one class in a simulated scene: with a share of the spread in common, or as modelled."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from estimator.posterior.assignments import GROSS_ERROR_SD_LOG, GROSS_ERROR_SHARE, LOG_BOX
from estimator.posterior.class_error import shared_error
from estimator.posterior.grid import PRIOR_MARGIN_LOG
from estimator.posterior.likelihood import OUTLIER_SHARE
from estimator.posterior.sameness import hypotheses
from metric_base.arrays import FloatArray
from metric_tree.prior import Prior

__all__ = ["Draw", "modelled_class", "sharing_class"]

#: One more object of the class: (3,) length, width, height in mm, in the prior's order.
Draw = Callable[[], FloatArray]


def sharing_class(prior: Prior, shared: float, generator: np.random.Generator) -> Draw:
    """Objects that share an error between sources and `shared` of the spread within a source.

    `shared` is also the probability that an object is of the scene's component.
    """
    error = generator.multivariate_normal(np.zeros(3), shared_error(prior).covariance)
    usual, place = _component(prior, generator), generator.standard_normal(3)

    def draw() -> FloatArray:
        component = usual if generator.random() < shared else _component(prior, generator)
        own = math.sqrt(shared) * place + math.sqrt(1 - shared) * generator.standard_normal(3)
        lower = np.linalg.cholesky(prior.covariances[component])
        return np.asarray(np.exp(prior.means[component] + lower @ own + error))

    return draw


def modelled_class(prior: Prior, several: bool, generator: np.random.Generator) -> Draw:
    """Objects as the posterior takes them to be: a hypothesis of sameness, outliers and gross errors included.

    An outlier has any proportions, and a size for which the scale stays within the prior's reach.
    several : the scene has more than one object of the class; of one alone the first hypothesis says all.
    """
    ways = hypotheses(prior) if several else hypotheses(prior)[:1]
    odds = np.exp([way.log_weight for way in ways])
    way = ways[generator.choice(len(ways), p=odds / odds.sum())]
    error = generator.multivariate_normal(np.zeros(3), way.error.covariance)
    middle = prior.weights @ prior.means

    def draw() -> FloatArray:
        if generator.random() < OUTLIER_SHARE:
            anything = LOG_BOX * generator.uniform(-0.5, 0.5, 3)
            return np.asarray(np.exp(middle + anything - anything.mean() + PRIOR_MARGIN_LOG * generator.uniform(-1, 1)))
        component = _component(way.prior, generator)
        size = generator.multivariate_normal(way.prior.means[component], way.prior.covariances[component]) + error
        wrong = generator.random()
        if wrong < 3 * GROSS_ERROR_SHARE:
            size[int(wrong / GROSS_ERROR_SHARE)] += GROSS_ERROR_SD_LOG * generator.standard_normal()
        return np.asarray(np.exp(size))

    return draw


def _component(prior: Prior, generator: np.random.Generator) -> int:
    return int(generator.choice(len(prior.weights), p=prior.weights / prior.weights.sum()))
