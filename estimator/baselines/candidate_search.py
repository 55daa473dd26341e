"""The search that both baselines share: likelihoods on a row of candidate scales, the highest product wins."""

from __future__ import annotations

import numpy as np

from estimator.posterior.log_scale_grid import interval, modes
from estimator.posterior.posterior import Estimate, status_reason
from estimator.records.result import Curve
from metric_base.arrays import FloatArray

#: Candidate scales between the limits: the paper names neither its limits nor its step; this step is a thousandth of
#: the answer where the limits are a factor of ten apart.
CANDIDATES = 2000

#: The limits reach this factor beyond the scales that single objects propose.
MARGIN = 1.6


def candidate_scales(proposed: FloatArray) -> FloatArray:
    """Evenly spaced candidates (g,) around the scales (n,) that the objects' typical sizes propose (paper 4.3)."""
    return np.linspace(float(proposed.min()) / MARGIN, float(proposed.max()) * MARGIN, CANDIDATES)


def estimate_on(scales: FloatArray, log_likelihood: FloatArray, level: float) -> Estimate:
    """The estimate from log likelihoods (n, g) of n objects on candidate scales (g,).

    The product is taken as it stands, s* = argmax prod_i phi_i(s L_i): no Jacobian, no outliers, flat over the
    candidates; every object has weight one.
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
