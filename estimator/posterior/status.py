"""What a posterior allows one to say: a scale, a scale with a warning, or none.

`resolved`: the interval is narrow and no other mode competes. `uncertain`: it is wide, or modes compete, yet the
highest mode is more likely near the truth than not. `unresolved`: the posterior itself gives the neighbourhood of its
highest mode little of its mass, or most of it lies where no object says anything.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from estimator.records.curve import Curve, Mode
from estimator.records.result import Status

__all__ = [
    "CONTRADICTING_MASS",
    "EDGE_MASS",
    "FAR_MASS",
    "FAR_MODE",
    "LEAST_NEAR_MASS",
    "NEAR",
    "RATIO_LIMIT",
    "doubt_of",
    "near_mass",
    "status_of",
]

#: Uncertain when the interval's high/low exceeds this, ...
RATIO_LIMIT = 1.8

#: ... or a mode further away than this ratio has at least this mass.
FAR_MODE, FAR_MASS = 1.25, 0.1

#: Unresolved when such a mode has this mass: two answers contradict each other.
CONTRADICTING_MASS = 0.35

#: Unresolved when less than this mass is within this ratio of the highest mode. Chosen on simulated scenes and one half
#: of the rooms of ScanNet so that seven of ten refused scales are off by more than that ratio
#: (docs/evidence/results.md).
NEAR, LEAST_NEAR_MASS = 1.15, 0.4

#: Unresolved when more of the posterior than this is beyond one end of where the objects speak: all may be outliers.
EDGE_MASS = 0.25


def near_mass(curve: Curve, scale: float) -> float:
    """The mass of a posterior within the ratio `NEAR` of a scale, in metres per unit."""
    near = np.abs(curve.log_scale - math.log(scale)) <= math.log(NEAR)
    inside = 1 - curve.below - curve.above
    return float(inside * curve.density[near].sum() / curve.density.sum())


def status_of(modes: Sequence[Mode], bounds: tuple[float, float], curve: Curve) -> Status:
    """The status of a posterior by its modes, highest first, its interval and its curve."""
    doubt = doubt_of(modes, bounds, curve)
    return "resolved" if doubt is None else doubt[0]


def doubt_of(modes: Sequence[Mode], bounds: tuple[float, float], curve: Curve) -> tuple[Status, str] | None:
    """The status and its reason in words where the scale is not resolved."""
    best, (low, high) = modes[0].scale, bounds
    edge, near = max(curve.below, curve.above), near_mass(curve, best)
    if edge > EDGE_MASS:
        return "unresolved", f"{edge:.0%} of the posterior is at scales of which no object says anything"
    if near < LEAST_NEAR_MASS:
        return "unresolved", f"only {near:.0%} of the posterior is within {NEAR - 1:.0%} of its highest mode"
    far = max(
        (mode.mass for mode in modes[1:] if max(mode.scale / best, best / mode.scale) > FAR_MODE),
        default=0.0,
    )
    if far >= CONTRADICTING_MASS:
        return (
            "unresolved",
            f"modes over {FAR_MODE - 1:.0%} apart contradict each other, one with mass {far:.2g}",
        )
    if high / low > RATIO_LIMIT:
        return "uncertain", f"the interval's high/low is {high / low:.3g}, over {RATIO_LIMIT}"
    if far >= FAR_MASS:
        return "uncertain", f"modes over {FAR_MODE - 1:.0%} apart, the lesser with mass over {FAR_MASS}"
    return None
