"""SceneSmith: choose the factor of an articulated asset among factors of units (x1, x0.1, x0.01, x0.001).

SceneSmith queries a vision-language model for the realistic factor (mesh_physics/articulated.yaml). This function
computes it from the category and the extents, with its probability, so that only doubtful assets need the model:

    choice = realistic_factor("cabinet", extents_m)
    if choice.probability < 0.9: ...  # query the model, and add its result as evidence
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import metric_tree

#: Metres, decimetres, centimetres and millimetres. The prompt contains the first three.
FACTORS = (1.0, 0.1, 0.01, 0.001)


@dataclass(frozen=True, slots=True)
class Choice:
    """A factor with its probability among the factors, and the reason."""

    factor: float
    probability: float
    reason: str


def realistic_factor(
    category: str,
    extents: Sequence[float],
    factors: Sequence[float] = FACTORS,
    evidence: Sequence[tuple[float, float]] = (),
) -> Choice:
    """Return the most probable of some factors for extents (3,) along x, y, z, with z up.

    The posterior of the factor is approximated by a log-normal with the median and the interval of `scale_for`.
    """
    scale = metric_tree.scale_for(category, list(extents), evidence=evidence, up="z")
    sd_log = np.log(scale.high / scale.low) / (2 * 1.645)
    weights = np.exp(-((np.log(factors) - np.log(scale.median)) ** 2) / (2 * sd_log**2)) + 1e-12
    best = int(np.argmax(weights))
    return Choice(factors[best], float(weights[best] / weights.sum()), scale.reason)
