"""The continuous ranked probability score of a posterior over log scale (Gneiting and Raftery 2007)."""

from __future__ import annotations

import numpy as np

from estimator.records.curve import Curve

__all__ = ["crps_of"]


def crps_of(curve: Curve, truth: float) -> float:
    """The integral of (F(u) - 1[u >= truth])^2 over log scale u: over the grid and out to the truth."""
    u, step = curve.log_scale, curve.log_scale[1] - curve.log_scale[0]
    below = curve.below + np.cumsum(curve.density) * step
    beyond = max(float(u[0]) - truth, truth - float(u[-1]), 0.0)
    return float(((below - (u >= truth)) ** 2).sum() * step) + beyond
