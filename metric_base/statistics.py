"""Statistics that several packages share: robust spread, densities of Gaussian mixtures."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

#: Standard deviation of a normal distribution over its median absolute deviation: 1 / Phi^-1(3/4).
MAD_TO_SIGMA = 1.4826


def robust_sigma(values: NDArray[np.floating]) -> float:
    """Standard deviation of values (n,) by their median absolute deviation; the caller sees to it that n >= 1."""
    return float(MAD_TO_SIGMA * np.median(np.abs(values - np.median(values))))


def gaussian_log_densities(
    x: NDArray[np.float64], means: NDArray[np.float64], covariances: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Log density of every row under every Gaussian, (k, n).

    Parameters
    ----------
    x : (n, d) points; means : (k, d); covariances : (k, d, d), positive definite
    """
    lower = np.linalg.cholesky(covariances)  # (k, d, d)
    offset = x[None, :, :] - means[:, None, :]  # (k, n, d)
    white = np.linalg.solve(lower, offset.transpose(0, 2, 1))  # (k, d, n)
    half_log_det = np.log(np.diagonal(lower, axis1=1, axis2=2)).sum(axis=1)  # (k,)
    constant = half_log_det + 0.5 * x.shape[1] * math.log(2 * math.pi)
    return np.asarray(-0.5 * (white**2).sum(axis=1) - constant[:, None])


def mixture_log_density(
    x: NDArray[np.float64], weights: NDArray[np.float64], means: NDArray[np.float64], covariances: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Log density of a Gaussian mixture at each row, (n,); weights (k,), the rest as in `gaussian_log_densities`."""
    with np.errstate(divide="ignore"):  # a component of weight zero has no effect
        terms = np.log(weights)[:, None] + gaussian_log_densities(x, means, covariances)  # (k, n)
    top = terms.max(axis=0)
    return np.asarray(top + np.log(np.exp(terms - top).sum(axis=0)))
