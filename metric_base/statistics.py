"""Robust statistics that several packages share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["MAD_TO_SIGMA", "robust_sigma"]

#: Standard deviation of a normal distribution over its median absolute deviation: 1 / Phi^-1(3/4).
MAD_TO_SIGMA = 1.4826


def robust_sigma(values: NDArray[np.float64]) -> float:
    """Standard deviation of values (n,) by their median absolute deviation; the caller sees to it that n >= 1."""
    return float(MAD_TO_SIGMA * np.median(np.abs(values - np.median(values))))
