"""Density of log scale on a grid: range and step of the grid, refinement, modes and interval."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from estimator.records.result import Curve, Mode
from metric_base.arrays import FloatArray

#: Margin of the flat prior of u on both sides of the evidence, natural log: a factor of e. The prior follows the
#: evidence, so that the unit of the scene does not matter, and it is proper, which the outlier densities require. A
#: wider prior would fill the interval of a single object with the case that its label is wrong.
PRIOR_MARGIN_LOG = 1.0
#: Half width of a component in its standard deviations; farther out, the outlier density dominates.
SUPPORT_SIGMAS = 4.0
#: Minimum ratio of a component to the outlier density of its object, at which the component ends.
MIN_OUTLIER_RATIO = 0.02
#: Maximum and minimum step of the coarse grid.
MAX_STEP, MIN_STEP = 0.06, 0.004
#: Step of the coarse grid relative to the narrowest component. The error of the cubic interpolation of the log
#: likelihood is then less than 1e-3.
STEP_SIGMAS = 0.6
#: Minimum number of points of the coarse grid.
MIN_POINTS = 8
#: Maximum number of points of the coarse grid, which suffices for objects over twenty decades.
MAX_POINTS = 4096
#: Points of the fine grid per step of the coarse one.
FINE_POINTS_PER_STEP = 8
#: Maximum refinement of the coarse grid, for sharp evidence.
MAX_REFINEMENT = 512
#: Width of the flat density of wrong evidence in log scale: sizes within a factor of 50, as for outliers.
WRONG_EVIDENCE_WIDTH_LOG = math.log(50.0)
#: Two peaks are one mode unless the density between them falls below this fraction of the lower peak.
MAX_DIP_WITHIN_MODE = 0.9
#: Minimum mass of a mode other than the highest one.
MIN_MODE_MASS = 0.005
#: Minimum density of a peak relative to the highest one.
MIN_PEAK_DENSITY = 1e-9


def evidence_grid(centre: FloatArray, sd: FloatArray, reach: FloatArray) -> FloatArray:
    """Return a uniform grid (g,) over the union of the intervals centre +- reach.

    Parameters
    ----------
    centre, sd, reach : (m,) ndarray of float
        Centres and standard deviations of Gaussians, and half widths of the intervals. Without any, the grid is around
        one metre per unit.
    """
    if not len(centre):
        return np.linspace(-1.0, 1.0, MIN_POINTS)
    low = float((centre - reach).min())
    high = max(float((centre + reach).max()), low + 1e-6)
    step = min(max(STEP_SIGMAS * float(sd.min()), MIN_STEP), MAX_STEP)
    size = int(min(max(math.ceil((high - low) / step) + 1, MIN_POINTS), MAX_POINTS))
    return np.linspace(low, high, size)


def curve(grid: FloatArray, log_density: FloatArray, gaussians: FloatArray) -> Curve:
    """Return the posterior on a finer grid, normalised together with the flat prior beyond its ends.

    Parameters
    ----------
    grid, log_density : (g,) ndarray of float
        Uniform grid, and the log posterior of the objects.
    gaussians : (n, 3) ndarray of float
        Other evidence (mean, standard deviation, probability to be wrong). It is added on the fine grid, because it may
        be sharper than the coarse one.
    """
    step = float(grid[1] - grid[0])
    min_sd = float(gaussians[:, 1].min()) if len(gaussians) else math.inf
    factor = int(min(max(FINE_POINTS_PER_STEP, math.ceil(FINE_POINTS_PER_STEP * step / min_sd)), MAX_REFINEMENT))
    fine = np.linspace(grid[0], grid[-1], (len(grid) - 1) * factor + 1)
    # Cubic interpolation (Lagrange) at `factor` points per step; the evidence is added exactly.
    first, last = 2 * log_density[0] - log_density[1], 2 * log_density[-1] - log_density[-2]  # linear extrapolation
    padded = np.concatenate([[first], log_density, [last]])
    windows = np.array([padded[:-3], padded[1:-2], padded[2:-1], padded[3:]])  # (4, g - 1)
    log_fine = np.append((windows.T @ _lagrange(factor)).ravel(), log_density[-1]) + log_evidence_density(
        fine, gaussians
    ).sum(axis=0)
    log_ends = log_density[[0, -1]] + log_evidence_density(grid[[0, -1]], gaussians).sum(axis=0)
    top = float(log_fine.max())
    density = np.exp(log_fine - top)
    margin = np.full(2, PRIOR_MARGIN_LOG)
    if (gaussians[:, 2] == 0).any():  # certain evidence leaves no mass beyond the grid, which covers it
        margin[:] = 0.0
    tails = np.exp(np.minimum(log_ends - top, 0.0)) * margin
    inside = float(density.sum() - 0.5 * (density[0] + density[-1])) * step / factor
    total = inside + float(tails.sum())
    return Curve(fine, density / total, float(tails[0]) / total, float(tails[1]) / total)


def tempered_posterior(posterior: Curve, power: float) -> Curve:
    """Return the posterior with its logarithm multiplied by `power`, which widens it."""
    top = float(posterior.density.max())
    density = (posterior.density / top) ** power
    below, above = (
        PRIOR_MARGIN_LOG * (mass / PRIOR_MARGIN_LOG / top) ** power for mass in (posterior.below, posterior.above)
    )
    step = float(posterior.log_scale[1] - posterior.log_scale[0])
    total = float(density.sum() - 0.5 * (density[0] + density[-1])) * step + below + above
    return Curve(posterior.log_scale, density / total, below / total, above / total)


def log_evidence_density(u: FloatArray, gaussians: FloatArray) -> FloatArray:
    """Return the log density (n, g) of other evidence (n, 3) at u (g,): a Gaussian, or flat if it is wrong."""
    mean, sd, doubt = gaussians.T[:, :, None]
    gauss = (
        np.log1p(-doubt) - 0.5 * ((u - mean) / sd) ** 2 - np.log(sd * math.sqrt(2 * math.pi) / WRONG_EVIDENCE_WIDTH_LOG)
    )
    with np.errstate(divide="ignore"):
        return np.asarray(np.logaddexp(gauss, np.log(doubt)))


def evidence_probabilities(posterior: Curve, gaussians: FloatArray) -> FloatArray:
    """Return the posterior probability (n,) of other evidence (n, 3) to be right; 1 without prior doubt."""
    mass = posterior.density / posterior.density.sum()
    with np.errstate(divide="ignore"):
        wrong = np.exp(np.log(gaussians[:, 2:]) - log_evidence_density(posterior.log_scale, gaussians))
    return np.asarray(1 - wrong @ mass)


def interval(posterior: Curve, level: float) -> tuple[float, float]:
    """Return the equal-tailed interval with probability `level`, in metres per unit."""
    cumulative = _cumulative(posterior)
    targets = np.array([(1 - level) / 2, (1 + level) / 2])
    inside = np.interp(targets, cumulative, posterior.log_scale)
    low, high = (float(value) for value in inside)
    if posterior.below >= targets[0]:  # the quantile is in the flat tail
        low = posterior.log_scale[0] - PRIOR_MARGIN_LOG * (1 - targets[0] / posterior.below)
    if posterior.above >= 1 - targets[1]:
        high = posterior.log_scale[-1] + PRIOR_MARGIN_LOG * (1 - (1 - targets[1]) / posterior.above)
    return math.exp(low), math.exp(high)


def modes(posterior: Curve) -> tuple[Mode, ...]:
    """Return the modes, the highest first, each with the mass between the valleys around it."""
    density, grid = posterior.density, posterior.log_scale
    is_rising = np.append(True, density[1:] > density[:-1])
    peaks = np.flatnonzero(is_rising[:-1] & ~is_rising[1:])
    peaks = peaks[density[peaks] > MIN_PEAK_DENSITY * density.max()]
    if not len(peaks):
        peaks = np.array([int(density.argmax())])
    # Peaks without a sufficient dip between them are merged.
    separate, valleys = [int(peaks[0])], list[int]()
    for peak in map(int, peaks[1:]):
        valley = separate[-1] + int(density[separate[-1] : peak + 1].argmin())
        if density[valley] < MAX_DIP_WITHIN_MODE * min(density[separate[-1]], density[peak]):
            separate.append(peak)
            valleys.append(valley)
        elif density[peak] > density[separate[-1]]:
            separate[-1] = peak
    cumulative = _cumulative(posterior)
    edges = np.concatenate([[posterior.below], cumulative[valleys], [1.0 - posterior.above]])
    by_height = []
    for peak, mass in zip(separate, np.diff(edges), strict=True):
        vertex = float(grid[peak])
        if 0 < peak < len(grid) - 1 and min(density[peak - 1 : peak + 2]) > 0:
            # Vertex of the parabola through the log density at the peak and its neighbours.
            left, middle, right = np.log(density[peak - 1 : peak + 2])
            bend = left - 2 * middle + right
            shift = 0.5 * (left - right) / bend if bend < 0 else 0.0
            vertex = float(grid[peak] + shift * (grid[1] - grid[0]))
        by_height.append((float(density[peak]), Mode(math.exp(vertex), float(mass))))
    by_height.sort(key=lambda pair: -pair[0])
    return tuple(mode for index, (_, mode) in enumerate(by_height) if index == 0 or mode.mass >= MIN_MODE_MASS)


def _cumulative(posterior: Curve) -> FloatArray:
    """Return the mass (g,) below each grid point, by the trapezoidal rule."""
    step = posterior.log_scale[1] - posterior.log_scale[0]
    pairs = 0.5 * (posterior.density[1:] + posterior.density[:-1]) * step
    return posterior.below + np.concatenate([[0.0], np.cumsum(pairs)])


@lru_cache(maxsize=8)
def _lagrange(factor: int) -> FloatArray:
    """Return the weights (4, n) of four neighbours at n = `factor` points from the second to the third."""
    t = np.arange(factor) / factor
    return np.array(
        [
            -t * (t - 1) * (t - 2) / 6,
            (t + 1) * (t - 1) * (t - 2) / 2,
            -(t + 1) * t * (t - 2) / 2,
            (t + 1) * t * (t - 1) / 6,
        ]
    )
