"""A density over log scale on a grid: where the grid lies, how it is refined, its modes and its interval."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from estimator.records.result import Curve, Mode
from metric_base.arrays import FloatArray, IntArray

#: The prior on u is flat from so far below what any object or length supports to so far above it, natural log: a
#: factor of e. It follows the evidence, so that the unit of the scene has no part in the answer, and is proper, as the
#: outliers ask for. A wider one fills the interval of an object alone with the case that its label is wrong.
PRIOR_MARGIN_LOG = 1.0

#: Half-width of a component's support in its standard deviations; beyond it the outlier's floor is all there is.
SUPPORT_SD = 4.0

#: Nor does a component reach beyond where it is this part of its object's outlier.
MIN_SHARE_OF_OUTLIER = 0.02

#: Widest and finest steps of the first grid, and the step as a part of the narrowest component: the log likelihood is
#: then smooth between points and cubic interpolation is off by less than 1e-3.
WIDEST_STEP, FINEST_STEP, STEP_SD = 0.06, 0.004, 0.6

#: Bounds of the first grid's size: objects over twenty decades still have their step; one of fewer has no shape.
LEAST_POINTS, MOST_POINTS = 8, 4096

#: Points of the refined grid per step of the first, and the log density under the peak where refining stops to matter.
FINE_POINTS_PER_STEP = 8

#: Width in log scale of what a line that is wrong may say: sizes over a factor of 50, as of an object's outlier.
WRONG_EVIDENCE_WIDTH_LOG = math.log(50.0)

#: Two peaks with no dip under this part of the lower one between them are one mode.
MAX_DIP_WITHIN_MODE = 0.9

#: Modes of less mass are left out of the list.
LEAST_MASS = 0.005


def evidence_grid(centre: FloatArray, sd: FloatArray, reach: FloatArray) -> FloatArray:
    """A uniform grid (g,) over the union of centre +- reach of Gaussians, each (m,), fine enough for every sd.

    Where nothing reaches, it is about one metre per unit.
    """
    if not len(centre):
        return np.linspace(-1.0, 1.0, LEAST_POINTS)
    low = float((centre - reach).min())
    high = max(float((centre + reach).max()), low + 1e-6)
    step = min(max(STEP_SD * float(sd.min()), FINEST_STEP), WIDEST_STEP)
    size = int(min(max(math.ceil((high - low) / step) + 1, LEAST_POINTS), MOST_POINTS))
    return np.linspace(low, high, size)


def curve(grid: FloatArray, log_density: FloatArray, lines: FloatArray) -> Curve:
    """The posterior on a finer grid, normalised together with the flat rest of the prior.

    Parameters
    ----------
    grid, log_density : (g,) uniform grid and log posterior on it, less the lines
    lines : (n, 3) mean and standard deviation in log scale, and doubt, of evidence beside the objects, which is added
        where it is sharp
    """
    step = float(grid[1] - grid[0])
    sharpest = float(lines[:, 1].min()) if len(lines) else math.inf
    factor = int(min(max(FINE_POINTS_PER_STEP, math.ceil(FINE_POINTS_PER_STEP * step / sharpest)), 512))
    fine = np.linspace(grid[0], grid[-1], (len(grid) - 1) * factor + 1)
    log_fine = _upsample(log_density, factor) + log_lines(fine, lines).sum(axis=0)
    log_ends = log_density[[0, -1]] + log_lines(grid[[0, -1]], lines).sum(axis=0)
    top = float(log_fine.max())
    density = np.exp(log_fine - top)
    width = np.full(2, PRIOR_MARGIN_LOG)
    if (lines[:, 2] == 0).any():  # beyond the grid a certain line leaves nothing: it is what placed the grid
        width[:] = 0.0
    rest = np.exp(np.minimum(log_ends - top, 0.0)) * width
    inside = float(density.sum() - 0.5 * (density[0] + density[-1])) * step / factor
    total = inside + float(rest.sum())
    return Curve(fine, density / total, float(rest[0]) / total, float(rest[1]) / total)


def tempered_posterior(posterior: Curve, power: float) -> Curve:
    """The posterior with its logarithm times `power`: as if all that was said were said by so much less."""
    top = float(posterior.density.max())
    density = (posterior.density / top) ** power
    below, above = (
        PRIOR_MARGIN_LOG * (mass / PRIOR_MARGIN_LOG / top) ** power for mass in (posterior.below, posterior.above)
    )
    step = float(posterior.log_scale[1] - posterior.log_scale[0])
    total = float(density.sum() - 0.5 * (density[0] + density[-1])) * step + below + above
    return Curve(posterior.log_scale, density / total, below / total, above / total)


def log_lines(u: FloatArray, lines: FloatArray) -> FloatArray:
    """(n, g) log density of each line (n, 3) at u (g,): a Gaussian, and with its doubt as probability anything."""
    mean, sd, doubt = lines.T[:, :, None]
    gauss = (
        np.log1p(-doubt) - 0.5 * ((u - mean) / sd) ** 2 - np.log(sd * math.sqrt(2 * math.pi) / WRONG_EVIDENCE_WIDTH_LOG)
    )
    with np.errstate(divide="ignore"):
        return np.asarray(np.logaddexp(gauss, np.log(doubt)))


def line_weights(posterior: Curve, lines: FloatArray) -> FloatArray:
    """(n,) probability that each line is right; of one without doubt it is 1."""
    mass = posterior.density / posterior.density.sum()
    with np.errstate(divide="ignore"):
        wrong = np.exp(np.log(lines[:, 2:]) - log_lines(posterior.log_scale, lines))
    return np.asarray(1 - wrong @ mass)


def interval(posterior: Curve, level: float) -> tuple[float, float]:
    """Equal-tailed interval of the scale that holds `level` of the posterior, in metres per unit."""
    cumulative = _cumulative(posterior)
    targets = np.array([(1 - level) / 2, (1 + level) / 2])
    inside = np.interp(targets, cumulative, posterior.log_scale)
    low, high = (float(value) for value in inside)
    if posterior.below >= targets[0]:  # a flat tail: its own quantile
        low = posterior.log_scale[0] - PRIOR_MARGIN_LOG * (1 - targets[0] / posterior.below)
    if posterior.above >= 1 - targets[1]:
        high = posterior.log_scale[-1] + PRIOR_MARGIN_LOG * (1 - (1 - targets[1]) / posterior.above)
    return math.exp(low), math.exp(high)


def modes(posterior: Curve) -> tuple[Mode, ...]:
    """The modes, highest first, each with the mass between the valleys beside it."""
    density, grid = posterior.density, posterior.log_scale
    rising = np.append(True, density[1:] > density[:-1])
    peaks = np.flatnonzero(rising[:-1] & ~rising[1:])
    peaks = peaks[density[peaks] > 1e-9 * density.max()]
    if not len(peaks):
        peaks = np.array([int(density.argmax())])
    kept, valleys = _separate(density, peaks)
    cumulative = _cumulative(posterior)
    edges = np.concatenate([[posterior.below], cumulative[valleys], [1.0 - posterior.above]])
    by_height = [
        (float(density[peak]), Mode(math.exp(_vertex(grid, density, peak)), float(mass)))
        for peak, mass in zip(kept, np.diff(edges), strict=True)
    ]
    by_height.sort(key=lambda pair: -pair[0])
    return tuple(mode for place, (_, mode) in enumerate(by_height) if place == 0 or mode.mass >= LEAST_MASS)


def _separate(density: FloatArray, peaks: IntArray) -> tuple[list[int], list[int]]:
    """Peaks (p,) of a density (g,) with a real dip between them, and the lowest point between neighbours."""
    kept, valleys = [int(peaks[0])], list[int]()
    for peak in map(int, peaks[1:]):
        valley = kept[-1] + int(density[kept[-1] : peak + 1].argmin())
        if density[valley] < MAX_DIP_WITHIN_MODE * min(density[kept[-1]], density[peak]):
            kept.append(peak)
            valleys.append(valley)
        elif density[peak] > density[kept[-1]]:
            kept[-1] = peak
    return kept, valleys


def _vertex(grid: FloatArray, density: FloatArray, peak: int) -> float:
    """The top of the parabola through the log of the peak and its neighbours on the grid (g,)."""
    if not 0 < peak < len(grid) - 1 or min(density[peak - 1 : peak + 2]) <= 0:
        return float(grid[peak])
    left, middle, right = np.log(density[peak - 1 : peak + 2])
    bend = left - 2 * middle + right
    shift = 0.5 * (left - right) / bend if bend < 0 else 0.0
    return float(grid[peak] + shift * (grid[1] - grid[0]))


def _cumulative(posterior: Curve) -> FloatArray:
    """(g,) mass below each point of the grid, by the trapezoid rule."""
    step = posterior.log_scale[1] - posterior.log_scale[0]
    pairs = 0.5 * (posterior.density[1:] + posterior.density[:-1]) * step
    return posterior.below + np.concatenate([[0.0], np.cumsum(pairs)])


def _upsample(values: FloatArray, factor: int) -> FloatArray:
    """(g,) values at `factor` times the points by four-point Lagrange interpolation, (factor (g - 1) + 1,)."""
    first, last = 2 * values[0] - values[1], 2 * values[-1] - values[-2]  # straight on beyond the ends
    padded = np.concatenate([[first], values, [last]])
    windows = np.array([padded[:-3], padded[1:-2], padded[2:-1], padded[3:]])  # (4, g - 1)
    return np.append((windows.T @ _lagrange(factor)).ravel(), values[-1])


@lru_cache(maxsize=8)
def _lagrange(factor: int) -> FloatArray:
    """(4, f) weights of four neighbours at the f = `factor` points from the second to the third."""
    t = np.arange(factor) / factor
    return np.array(
        [
            -t * (t - 1) * (t - 2) / 6,
            (t + 1) * (t - 1) * (t - 2) / 2,
            -(t + 1) * t * (t - 2) / 2,
            (t + 1) * t * (t - 1) / 6,
        ]
    )
