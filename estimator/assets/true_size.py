"""The true size of a model from its shape alone: the posterior of the factor on its stated size.

With x the ln of its stated extents and u the ln of the factor, p(u | x) is p(x + u) of the size model, normalised:
each component gives a Gaussian in u, weighted by what the proportions say (docs/explanation/posterior.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from metric_base.arrays import FloatArray
from models3d.asset import AXES, AssetBody, Up
from models3d.size_check.hypotheses import ordered_sizes
from models3d.size_check.size_model import SizeModel

__all__ = ["LEVEL", "TrueSize", "factor_of_bodies", "true_size"]

#: Mass of the interval of a true size.
LEVEL = 0.9
#: Steps of the grid of ln factor over the components' range, and how many sds of each it covers.
GRID_STEPS, GRID_SD = 4001, 6.0


@dataclass(frozen=True, slots=True)
class TrueSize:
    """The factor on the stated size with its interval, (low, median, high), and the height that follows in metres."""

    factor: tuple[float, float, float]
    height_m: tuple[float, float, float]
    level: float = LEVEL


def true_size(body: AssetBody, up: Up | None, model: SizeModel, level: float = LEVEL) -> TrueSize:
    """The posterior of the factor for one body; the vertical extent is that of the stated up axis, y where none is."""
    low, median, high = _quantiles([_components(body, up, model)], level)
    vertical = float(body.extents_m[AXES.index(up or "y")])
    heights = [float(f"{vertical * factor:.4g}") for factor in (low, median, high)]
    return TrueSize((low, median, high), (heights[0], heights[1], heights[2]), level)


def factor_of_bodies(
    bodies: list[tuple[AssetBody, Up | None, SizeModel]], level: float = LEVEL
) -> tuple[float, float, float]:
    """The factor that several bodies of one scene have in common: low, median, high."""
    return _quantiles([_components(body, up, model) for body, up, model in bodies], level)


def _components(body: AssetBody, up: Up | None, model: SizeModel) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weights, means and sds, (k,) each, of the posterior of ln factor."""
    return model.shift_components(ordered_sizes(body.extents_m, up or "y", model.is_sorted))


def _quantiles(posteriors: list[tuple[FloatArray, FloatArray, FloatArray]], level: float) -> tuple[float, float, float]:
    """Quantiles of exp(u) under the product of mixtures of Gaussians in u, each (weights, means, sds) of (k,)."""
    low = min(float((means - GRID_SD * sds).min()) for _, means, sds in posteriors)
    high = max(float((means + GRID_SD * sds).max()) for _, means, sds in posteriors)
    grid = np.linspace(low, high, GRID_STEPS)  # (g,)
    log_density = np.zeros_like(grid)
    for weights, means, sds in posteriors:
        z = (grid[:, None] - means) / sds
        density = (weights / (sds * math.sqrt(2 * math.pi)) * np.exp(-(z**2) / 2)).sum(axis=1)
        log_density += np.log(density + 1e-300)
    mass = np.exp(log_density - log_density.max())
    share = np.cumsum(mass) / mass.sum()
    at = [float(np.exp(np.interp(q, share, grid))) for q in ((1 - level) / 2, 0.5, (1 + level) / 2)]
    return at[0], at[1], at[2]
