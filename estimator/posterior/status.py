"""What a posterior allows one to say: a scale, a scale with a warning, or none.

`resolved`: the interval is narrow and no other mode competes. `uncertain`: it is wide, modes compete, or most objects
are outliers, yet the highest mode is more likely near the truth than not. `unresolved`: the posterior itself gives the
neighbourhood of its highest mode little of its mass, or most of it lies where no object says anything.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from estimator.records.curve import Curve, Mode
from estimator.records.result import Status
from metric_base.arrays import FloatArray

__all__ = [
    "CONTRADICTED_POWER",
    "CONTRADICTING_MASS",
    "EDGE_MASS",
    "FAR_MASS",
    "FAR_MODE",
    "LEAST_MEAN_WEIGHT",
    "LEAST_NEAR_MASS",
    "NEAR",
    "RATIO_LIMIT",
    "contradicts",
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
NEAR, LEAST_NEAR_MASS = 1.15, 0.35

#: Three objects or more that are what their labels say with less probability than this, on average, contradict the
#: model: the logarithm of the posterior is then multiplied by `CONTRADICTED_POWER`, which widens it, and the scale is
#: uncertain at best. Chosen on the even rooms of ScanNet and half of simulated scenes, so that the interval of such
#: scenes covers 90 % and seven of ten that become unresolved are off by more than `NEAR` (docs/evidence/results.md).
LEAST_MEAN_WEIGHT, LEAST_JUDGED_OBJECTS, CONTRADICTED_POWER = 0.4, 3, 0.7

#: Unresolved when more of the posterior than this is beyond one end of where the objects speak: all may be outliers.
EDGE_MASS = 0.25


def contradicts(weight: FloatArray) -> bool:
    """Whether most of several objects are outliers; weight : (n,) probability that each is what its label says."""
    return len(weight) >= LEAST_JUDGED_OBJECTS and float(weight.mean()) < LEAST_MEAN_WEIGHT


def near_mass(curve: Curve, scale: float) -> float:
    """The mass of a posterior within the ratio `NEAR` of a scale, in metres per unit."""
    near = np.abs(curve.log_scale - math.log(scale)) <= math.log(NEAR)
    inside = 1 - curve.below - curve.above
    return float(inside * curve.density[near].sum() / curve.density.sum())


def status_of(
    modes: Sequence[Mode], bounds: tuple[float, float], curve: Curve, weight: FloatArray | None = None
) -> Status:
    """The status of a posterior by its modes, highest first, interval, curve and `weight` (n,), as `doubt_of`."""
    doubt = doubt_of(modes, bounds, curve, weight)
    return "resolved" if doubt is None else doubt[0]


def doubt_of(
    modes: Sequence[Mode], bounds: tuple[float, float], curve: Curve, weight: FloatArray | None = None
) -> tuple[Status, str] | None:
    """The status and its reason in words where the scale is not resolved.

    weight : (n,) probability of each object that it is what its label says, where the objects alone carry the scale
    """
    return next(_doubts(modes, bounds, curve, weight), None)


def _doubts(
    modes: Sequence[Mode], bounds: tuple[float, float], curve: Curve, weight: FloatArray | None
) -> Iterator[tuple[Status, str]]:
    """What stands against a resolved scale, the worst first; weight : (n,) as `doubt_of` takes it."""
    best, (low, high) = modes[0].scale, bounds
    edge, near = max(curve.below, curve.above), near_mass(curve, best)
    if edge > EDGE_MASS:
        yield "unresolved", f"{edge:.0%} of the posterior is at scales of which no object says anything"
    if near < LEAST_NEAR_MASS:
        yield "unresolved", f"only {near:.0%} of the posterior is within {NEAR - 1:.0%} of its highest mode"
    far = max((mode.mass for mode in modes[1:] if max(mode.scale / best, best / mode.scale) > FAR_MODE), default=0.0)
    if far >= CONTRADICTING_MASS:
        yield "unresolved", f"modes over {FAR_MODE - 1:.0%} apart contradict each other, one with mass {far:.2g}"
    if weight is not None and contradicts(weight):
        outliers = int((weight < 0.5).sum())
        yield "uncertain", f"{outliers} of {len(weight)} objects are outliers: their labels or masks may be wrong"
    if high / low > RATIO_LIMIT:
        yield "uncertain", f"the interval's high/low is {high / low:.3g}, over {RATIO_LIMIT}"
    if far >= FAR_MASS:
        yield "uncertain", f"modes over {FAR_MODE - 1:.0%} apart, the lesser with mass over {FAR_MASS}"
