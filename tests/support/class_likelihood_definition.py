"""Reference implementation of the scale likelihood of a class with several objects.

For each hypothesis of similarity (`estimator.posterior.class_hypotheses`) with weight w_h, prior p_h and shared error
e ~ N(0, B_h),

    L_c(u) = sum_h w_h integral of prod_i (p_h(y_i + v) + floor_i)^tau N(u 1 - v; 0, B_h) dv,    v = u 1 - e

The integral is computed as a sum over a cubic grid of v. `class_likelihood` computes it with seven nodes and a
convolution, about 1000 times faster.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.posterior.axis_assignments import prior_axes
from estimator.posterior.class_hypotheses import Hypothesis, hypotheses
from estimator.posterior.class_likelihood import EFFECTIVE_OBJECTS
from estimator.posterior.object_likelihood import ObjectEvidence, has_open_vertical, hypothesis_rows, measurement_arrays
from metric_base.arrays import FloatArray

__all__ = ["class_log_likelihood", "hypothesis_likelihood"]

#: Margin of the grid of v around the residuals of the objects, in standard deviations of e.
MARGIN_SIGMAS = 4.0
#: Maximum margin of the grid of v, natural log.
MAX_MARGIN_LOG = 0.8


def class_log_likelihood(evidence: Sequence[ObjectEvidence], u: FloatArray, points: int = 64) -> FloatArray:
    """Return log L_c (g,) at log scales u (g,) for at least two objects of one class, without tempering of readings.

    points : number of grid points along each axis.
    """
    models = hypotheses(evidence[0].prior, any(has_open_vertical(item) for item in evidence))
    values = [np.exp(model.log_weight) * hypothesis_likelihood(evidence, model, u, points) for model in models]
    return np.asarray(np.log(np.sum(values, axis=0)))


def hypothesis_likelihood(
    evidence: Sequence[ObjectEvidence], model: Hypothesis, u: FloatArray, points: int = 64
) -> FloatArray:
    """Return the integral (g,) of one hypothesis at log scales u (g,)."""
    n, axes = len(evidence), prior_axes(model.prior)
    parts = hypothesis_rows(measurement_arrays(evidence), np.arange(n), [(model,)] * n)
    precision = parts.precision.transpose(2, 0, 1)  # (m, 3, 3)
    residual = np.linalg.solve(precision, parts.pull.T[:, :, None])[:, :, 0]  # (m, 3)
    log_weight = parts.log_constant + 0.5 * (residual * parts.pull.T).sum(axis=1)
    covariance = model.error.covariance[np.ix_(axes, axes)]  # (d, d)
    low, high = residual.min(axis=0)[axes], residual.max(axis=0)[axes]
    reach = np.minimum(MARGIN_SIGMAS * np.sqrt(np.diag(covariance)), MAX_MARGIN_LOG)
    sides = [np.linspace(a - r, b + r, points) for a, b, r in zip(low, high, reach, strict=True)]
    v = np.zeros((points ** len(axes), 3))
    v[:, axes] = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, len(axes))
    log_product = np.zeros(len(v))
    for i in range(n):
        density = np.full(len(v), np.exp(parts.log_floor[i]))
        for row in np.flatnonzero(parts.object == i):
            density += np.exp(log_weight[row] - 0.5 * _quadratic(v - residual[row], precision[row]))
        log_product += min(1.0, EFFECTIVE_OBJECTS / n) * np.log(density)
    cell = np.prod([side[1] - side[0] for side in sides])
    normal = cell / np.sqrt(np.linalg.det(2 * np.pi * covariance))
    inverse = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    # expand (u 1 - v)' B^-1 (u 1 - v) as a polynomial in u, which takes a third of the time
    v = v[:, axes]
    constant, slope = log_product - 0.5 * _quadratic(v, inverse), v @ inverse.sum(axis=0)
    values = [np.exp(constant + scale * (slope - 0.5 * scale * inverse.sum())).sum() for scale in u]
    return np.asarray(normal * np.array(values))


def _quadratic(x: FloatArray, matrix: FloatArray) -> FloatArray:
    """Return x' M x (n,) of vectors (n, d) and a matrix (d, d)."""
    return np.asarray(np.einsum("ij,ij->i", x @ matrix, x))
