"""A density over log scale, and its modes."""

from __future__ import annotations

from dataclasses import dataclass

from metric_base.arrays import FloatArray

__all__ = ["Curve", "Mode"]


@dataclass(frozen=True, slots=True)
class Mode:
    """A local maximum of the posterior: `scale` in metres per unit, the `mass` of its basin."""

    scale: float
    mass: float


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A density over log scale: log_scale (g,), density (g,), and the mass beyond each end of the grid."""

    log_scale: FloatArray
    density: FloatArray
    below: float
    above: float
