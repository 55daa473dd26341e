"""How many Gaussians a class has, by BIC, and what their mixture says of a further object."""

from __future__ import annotations

import numpy as np

from metric_base.arrays import FloatArray
from metric_tree.fit.mixture_em import Belief, Fitted, Mixture, Rows, fit_mixture

__all__ = ["best_mixture", "predictive_mixture"]

#: Largest number of components: sizes of one category fall into a few kinds (a hatchback, a saloon, a van).
MAX_COMPONENTS = 4

#: Effective rows that a component must have: one and a half for each of its ten numbers (mean 3, covariance 6, weight).
COMPONENT_ROWS = 15.0

#: Degrees of freedom above which Student's t is published as one Gaussian: the 99 % points differ by 4 %.
GAUSSIAN_FREEDOM = 30.0

#: Normal components that stand for a Student's t.
T_COMPONENTS = 3


def best_mixture(rows: Rows, belief: Belief, seed: int, worth: float = 1.0) -> tuple[Mixture, int]:
    """The mixture of the smallest BIC, as the predictive density of a further object of the same source."""
    effective = rows.effective
    largest = max(1, min(MAX_COMPONENTS, int(worth * _whole_rows(rows) // COMPONENT_ROWS)))
    best = single = fit_mixture(rows, 1, belief, seed)
    for k in range(2, largest + 1):
        fit = fit_mixture(rows, k, belief, seed, single)
        if fit.bic(effective) >= best.bic(effective) and k > len(best.mixture.weights) + 1:
            break  # two more components in vain: a third is not tried
        best = min(best, fit, key=lambda one: one.bic(effective))
    return predictive_mixture(best, belief, effective), len(best.mixture.weights)


def predictive_mixture(fit: Fitted, belief: Belief, effective: float) -> Mixture:
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


def _whole_rows(rows: Rows) -> float:
    """Effective number of the rows that state as many axes as any."""
    stated = (~np.isnan(rows.x[rows.starts])).sum(axis=1)
    weights = rows.weights[stated >= min(2, int(stated.max()))]
    return float(weights.sum() ** 2 / (weights**2).sum())
