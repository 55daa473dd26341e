"""Search of both baselines: the candidate scale with the highest product of likelihoods."""

from __future__ import annotations

import numpy as np

from estimator.posterior.log_scale_grid import interval, modes
from estimator.posterior.posterior import Estimate, status_reason
from estimator.records.result import Curve
from metric_base.arrays import FloatArray

#: Number of candidate scales between the limits. The paper states neither limits nor step; this step is a thousandth of
#: the result if the ratio of the limits is ten.
CANDIDATES = 2000
#: Ratio of the limits to the extreme scales of single objects.
MARGIN = 1.6


def candidate_scales(proposed: FloatArray) -> FloatArray:
    """Return evenly spaced candidates (g,) around the scales (n,) by the typical sizes of the objects (paper 4.3)."""
    return np.linspace(float(proposed.min()) / MARGIN, float(proposed.max()) * MARGIN, CANDIDATES)


def estimate_on(scales: FloatArray, log_likelihood: FloatArray, level: float) -> Estimate:
    """Return the estimate from log likelihoods (n, g) of n objects on candidate scales (g,).

    It maximises s* = argmax prod_i phi_i(s L_i), without Jacobian, outliers or prior. Every object has the weight 1.
    """
    total = log_likelihood.sum(axis=0)
    log_scale = np.linspace(np.log(scales[0]), np.log(scales[-1]), 2 * len(scales))
    log_density = np.interp(np.exp(log_scale), scales, total)
    density = np.exp(log_density - log_density.max())
    density /= density.sum() * (log_scale[1] - log_scale[0])
    curve = Curve(log_scale, density, 0.0, 0.0)
    peaks, bounds = modes(curve), interval(curve, level)
    status, reason = status_reason(peaks, bounds, curve)
    return Estimate(
        curve=curve,
        modes=peaks,
        interval=bounds,
        status=status,
        reason=reason,
        weight=np.ones(len(log_likelihood)),
        own_scale=scales[log_likelihood.argmax(axis=1)],
    )
