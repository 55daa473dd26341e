"""Estimate position, direction, strength and colour of the lamps of a room from the shading of its planes.

Model. A matt cell with albedo a has the radiance

    L = a / pi * (A + sum_l P_l v_l cos(theta_l) / r_l^2),    A = A_seen + g * A_unseen

with the ambient irradiance A and, for each lamp l, its strength P_l (times the cosine to its axis, if any), distance
r_l, angle theta_l to the normal, and v_l, the fraction of the cell that it reaches. A_seen is gathered from surfaces
in the images; g is the brightness of the others, mainly the ceiling. The albedo is constant on a plane of one paint.
The likelihood is a Cauchy density of the log luminance minus its median on the plane. Its weight is 0.25, against
log-normal priors on the direct-to-ambient ratio (16), on g and on the albedo of the lightest cells (0.55).

Algorithm.
1. Candidates: a grid in the room, omnidirectional, downwards or away from a wall, except at visibly free positions.
2. Greedy search: another lamp as long as the log posterior increases by at least 2.
3. After each step, random local search over one lamp at a time, with a decreasing radius.
4. Strengths and g become their posterior means; the colour of each lamp is fitted per channel.

Limits. None for fewer than 60 cells or 2 planes. At most 3 lamps, each about as large as the grid spacing. Contrast
determines only the ratio of strengths to g; their level depends on the priors. No shadows without an occupancy grid.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from insertion.colour import luminance
from insertion.light.lamp_candidates import (
    MAX_WALL_UP_COSINE,
    TYPICAL_IRRADIANCE,
    Candidates,
    local_candidates,
    room_candidates,
)
from insertion.scene.occupancy import Occupancy
from insertion.scene.plane_cells import PlaneCells
from metric_base.arrays import BoolArray, FloatArray

#: Candidate widths of the Cauchy density of log luminance (texture, uneven ambient light). Its tails accept the few
#: large errors of shadows with a wrong edge.
CELL_WIDTHS = np.geomspace(0.03, 0.4, 6)
#: Maximum effective number of cells: errors of neighbouring cells are correlated.
MAX_EFFECTIVE_CELLS = 60
#: Standard deviation of log albedo between walls, which often have the same paint, and between all planes.
WALL_SIGMA, PLANE_SIGMA = 0.35, 0.8
#: Minimum number of cells of a fit.
MIN_FIT_CELLS = 60
#: Minimum number of planes of a fit.
MIN_FIT_PLANES = 2
#: Candidate ratios of direct to ambient irradiance of one lamp at a typical position.
DIRECT_TO_AMBIENT_GRID = np.geomspace(0.6, 25.0, 7)
#: Candidate gains of the unseen surfaces: their radiance over the mean of the others.
UNSEEN_GAIN_GRID = np.geomspace(0.5, 5.0, 9)
#: Standard deviation of the log gain of the unseen surfaces.
UNSEEN_SIGMA = 0.3
#: Albedo of the ceiling, the largest unseen surface, which reflects the seen surfaces and the lamps.
CEILING_ALBEDO = 0.85
#: Prior median of the direct-to-ambient ratio of all lamps at a typical position. It conserves the energy of a closed
#: room whose surfaces reflect a quarter to a half; ten rendered rooms had 9 to 24.
DIRECT_TO_AMBIENT_PRIOR = 16.0
#: Standard deviation of its logarithm.
DIRECT_TO_AMBIENT_SIGMA = 0.3
#: Weight of the contrast in the log posterior: shadows with slightly wrong edges make lamps look weak.
CONTRAST_WEIGHT = 0.25
#: Standard deviation of the log colour of a lamp in each channel: cameras balance white for the scene, not per lamp.
TINT_SIGMA = 0.12
#: Candidate log colours.
TINT_GRID = np.linspace(-0.6, 0.6, 25)
#: Minimum increase of the log posterior by another lamp.
MIN_LOG_POSTERIOR_GAIN = 2.0
#: Maximum number of lamps.
MAX_LAMPS = 3
#: Number of rounds of the local search, and factor of the search radius per round.
ROUNDS, SHRINK = 9, 0.72
#: Candidate factors of a strength in the local search.
LOCAL_FACTORS = np.array([0.6, 0.78, 1.0, 1.28, 1.65])
#: Minimum weight of a candidate position, as a fraction of the largest weight.
MIN_RELATIVE_WEIGHT = 0.02
#: Prior median and log standard deviation of the albedo of the lightest cells, for example a painted wall.
LIGHTEST_ALBEDO, LIGHTEST_SIGMA = 0.55, 0.1
#: Fraction of the cells that are lighter than the lightest cells of the prior (the median of the lightest tenth).
LIGHTEST_QUANTILE_TAIL = 0.05
#: Candidate factors of the strengths, and candidate gains, for the posterior means.
FINAL_FACTORS, FINAL_UNSEEN_GAINS = np.geomspace(0.25, 4.0, 33), np.geomspace(0.3, 5.0, 25)


@dataclass(frozen=True, slots=True, eq=False)
class PlaneShading:
    """Cells of planes with their ambient irradiance in units of its mean."""

    cells: PlaneCells
    occupancy: Occupancy | None
    walls: BoolArray  #: (k,) planes that are upright
    seen: FloatArray  #: (n,) irradiance from surfaces in the images
    unseen: FloatArray  #: (n,) irradiance from the other surfaces, if they were as bright as the seen ones
    unit: float  #: mean ambient irradiance in units of the images
    gain: float = 1.0  #: brightness of the unseen surfaces over that of the seen ones
    tint: FloatArray | None = None  #: (n, 3) colour of the ambient light over its luminance

    def ambient(self, gain: float) -> FloatArray:
        """Return the ambient irradiance (n,) of the cells."""
        return np.asarray(self.seen + gain * self.unseen)

    @property
    def mean_irradiance(self) -> float:
        """Irradiance of a position surrounded by the mean radiance of the images, in units of `unit`."""
        return float((self.unseen.sum() + self.seen.sum()) / len(self.seen))


def plane_shading(cells: PlaneCells, up: FloatArray, occupancy: Occupancy | None) -> PlaneShading:
    """Return the cells with their ambient irradiance.

    Parameters
    ----------
    up : (3,) ndarray of float
        Unit vector.
    occupancy : Occupancy, optional
        Grid that the irradiance is gathered from; without it the ambient irradiance is 1 everywhere.
    """
    first = [int(np.argmax(cells.plane == k)) for k in range(int(cells.plane.max()) + 1)]
    walls = np.asarray(np.abs(cells.normals[first] @ up) < MAX_WALL_UP_COSINE)
    if occupancy is None:
        return PlaneShading(cells, None, walls, np.zeros(len(cells.plane)), np.ones(len(cells.plane)), 1.0)
    colours, unseen = occupancy.gather_irradiance(cells.positions, cells.normals)
    mean = colours.sum(axis=0) / max(float((1 - unseen).sum()), 1e-9)  # pi times the mean radiance of seen surfaces
    total = colours + unseen[:, None] * mean
    tint = total / np.maximum(luminance(total), 1e-12)[:, None]
    seen, brightness = luminance(colours).astype(np.float64), float(luminance(mean))
    unit = float((seen + brightness * unseen).mean())
    return PlaneShading(cells, occupancy, walls, seen / unit, brightness * unseen / unit, unit, tint=np.asarray(tint))


def log_posterior(planes: PlaneShading, fields: FloatArray, values: FloatArray | None = None) -> FloatArray:
    """Return the log posterior of fields of irradiance, up to their total level.

    Parameters
    ----------
    planes : PlaneShading
        The n cells.
    fields : (c, n) ndarray of float
        Irradiance of the cells over the mean ambient irradiance.
    values : (n,) ndarray of float, optional
        Log radiance to explain; the log luminance of the cells by default.

    Returns
    -------
    (c,) ndarray of float
        Log likelihood of the contrast on each plane, plus the log prior of the albedo of the planes.
    """
    plane, walls = planes.cells.plane, planes.walls
    observed = planes.cells.log_luminance if values is None else values
    residuals = (observed - np.log(fields)).astype(np.float32)  # (c, n)
    medians = []
    ends = np.searchsorted(plane, np.arange(len(walls) + 1))
    for start, end in itertools.pairwise(ends):
        half = (end - start) // 2
        median = np.partition(residuals[:, start:end], half, axis=1)[:, half]
        residuals[:, start:end] -= median[:, None]
        medians.append(median)
    # the Cauchy density of the width that explains the residuals best
    squares = np.square(residuals)
    by_width = [np.log1p(squares / np.float32(width**2)).mean(axis=1) + np.log(width) for width in CELL_WIDTHS]
    log_likelihood = np.asarray(-np.min(by_width, axis=0), dtype=np.float64)
    total = min(MAX_EFFECTIVE_CELLS, len(plane)) * log_likelihood
    log_albedo = np.array(medians, dtype=np.float64)  # (k, c)
    for kind, sigma in ((walls, WALL_SIGMA), (np.ones(len(walls), dtype=bool), PLANE_SIGMA)):
        if kind.sum() > 1:
            total -= 0.5 * (((log_albedo[kind] - log_albedo[kind].mean(axis=0)) / sigma) ** 2).sum(axis=0)
    return np.asarray(total)


@dataclass(frozen=True, slots=True, eq=False)
class Lamp:
    """One lamp, as a distribution over positions."""

    positions: FloatArray  #: (c, 3) in the scene
    facing: FloatArray  #: (c, 3) unit axis of the cosine lobe; 0 for an omnidirectional lamp
    weights: FloatArray  #: (c,) sum to 1
    strengths: FloatArray  #: (c,) irradiance across the light times the squared distance
    size: float  #: approximate diameter, scene units
    colour: FloatArray = field(default_factory=lambda: np.ones(3))  #: (3,) linear, of luminance 1


@dataclass(frozen=True, slots=True, eq=False)
class RoomLight:
    """The light of a room, in units of the radiance of the images."""

    unseen: float  #: radiance of surfaces that no image shows, mainly of the ceiling
    lamps: tuple[Lamp, ...]
    occupancy: Occupancy | None = None  #: occluders between the lamps and a position


@dataclass(frozen=True, slots=True, eq=False)
class _FittedLamp:
    """A lamp with its best candidate, and the log posterior of all lamps."""

    score: float
    irradiance: FloatArray  #: (n,) of the cells
    lamp: Lamp
    position: FloatArray  #: (3,)
    facing: FloatArray  #: (3,)
    ratio: float  #: direct-to-ambient irradiance at a typical position
    ceiling_irradiance: float  #: mean irradiance of the ceiling

    def scaled(self, factor: float) -> _FittedLamp:
        """Return the lamp with `factor` times its strength."""
        return replace(
            self,
            irradiance=factor * self.irradiance,
            lamp=replace(self.lamp, strengths=factor * self.lamp.strengths),
            ratio=factor * self.ratio,
            ceiling_irradiance=factor * self.ceiling_irradiance,
        )


def fit_room_light(
    cells: PlaneCells,
    up: FloatArray,
    is_free: Callable[[FloatArray], BoolArray] | None = None,
    occupancy: Occupancy | None = None,
) -> RoomLight | None:
    """Estimate the lamps of a room from the shading of its planes (see the module docstring).

    Parameters
    ----------
    cells : PlaneCells
        Cells of the planes with their brightness.
    up : (3,) ndarray of float
        Unit vector.
    is_free : callable, optional
        Returns which of (n, 3) positions are visibly free and cannot hold a lamp, (n,).
    occupancy : Occupancy, optional
        Grid that casts shadows and whose brightness is gathered. Without it there are no shadows, and the ambient
        irradiance is the same everywhere.

    Returns
    -------
    RoomLight or None
        None if there are too few cells or planes, or no candidate.
    """
    if len(cells.plane) < MIN_FIT_CELLS or len(np.unique(cells.plane)) < MIN_FIT_PLANES:
        return None
    candidates = room_candidates(cells, up, is_free, occupancy)
    if not len(candidates.positions):
        return None

    # 1. Greedy search: another lamp as long as it increases the posterior enough.
    planes = plane_shading(cells, up, occupancy)
    score = -np.inf
    lamps: list[_FittedLamp] = []
    while len(lamps) < MAX_LAMPS:
        extended = [*lamps, _best_lamp(planes, candidates, lamps, DIRECT_TO_AMBIENT_GRID)]
        extended, changed = _refine_lamps(extended, planes, candidates)
        if extended[-1].score < score + MIN_LOG_POSTERIOR_GAIN:
            break
        lamps, planes, score = extended, changed, extended[-1].score

    # 2. Strengths and brightness of the unseen surfaces: geometric means over the posterior.
    factor, gain = (grid.ravel() for grid in np.meshgrid(FINAL_FACTORS, FINAL_UNSEEN_GAINS))
    scores = _lamp_log_posterior(planes, *_totals(lamps, planes, factor), gain)
    weights = np.exp(scores - scores.max())
    mean_factor, mean_gain = (float(np.exp(np.average(np.log(grid), weights=weights))) for grid in (factor, gain))
    lamps, planes = [fitted.scaled(mean_factor) for fitted in lamps], replace(planes, gain=mean_gain)

    # 3. From units of the mean ambient irradiance and the diagonal to those of the images and the scene.
    unit = planes.unit
    scaled = [
        replace(fitted.lamp, strengths=fitted.lamp.strengths * unit * cells.diagonal**2, colour=colour)
        for fitted, colour in zip(lamps, _lamp_colours(planes, lamps), strict=True)
    ]
    return RoomLight(unit * planes.mean_irradiance * planes.gain / np.pi, tuple(scaled), occupancy)


def _lamp_colours(planes: PlaneShading, lamps: list[_FittedLamp]) -> list[FloatArray]:
    """Return the colour (3,) of each lamp, of luminance 1, from the change of hue between shadow and light.

    The ambient light has the colour of the seen surfaces. Each channel is fitted separately, one lamp after another.
    """
    if planes.cells.hue is None or planes.tint is None:
        return [np.ones(3) for _ in lamps]
    log_colours = np.zeros((len(lamps), 3))
    for channel in range(3):
        observed = planes.cells.log_luminance + planes.cells.hue[:, channel]
        ambient = planes.ambient(planes.gain) * planes.tint[:, channel]
        for step in range(2 * len(lamps)):
            index = step % len(lamps)
            others = [np.exp(log_colours[k, channel]) * lamps[k].irradiance for k in range(len(lamps)) if k != index]
            fields = ambient + sum(others, np.zeros(len(ambient)))
            fields = fields + np.exp(TINT_GRID)[:, None] * lamps[index].irradiance
            scores = log_posterior(planes, fields, observed) - 0.5 * (TINT_GRID / TINT_SIGMA) ** 2
            log_colours[index, channel] = TINT_GRID[int(scores.argmax())]
    return [np.exp(row) / float(luminance(np.exp(row))) for row in log_colours]


def _refine_lamps(
    lamps: list[_FittedLamp], planes: PlaneShading, candidates: Candidates
) -> tuple[list[_FittedLamp], PlaneShading]:
    """Refine lamps by random local search, one at a time, with a search radius that shrinks by SHRINK per round.

    At the start of a round, all strengths are scaled together with the brightness of the unseen surfaces: stronger
    lamps and more ambient light leave the contrast of shadows unchanged.
    """
    generator = np.random.default_rng(0)
    for step in range(ROUNDS * len(lamps)):
        index = step % len(lamps)
        if index == 0:
            lamps, planes = balance_lamps(lamps, planes)
        old, others = lamps[index], lamps[:index] + lamps[index + 1 :]
        spread = candidates.spacing * SHRINK ** (step // len(lamps))
        near = local_candidates(candidates, old.position, old.facing, spread, planes.cells, planes.occupancy, generator)
        new = _best_lamp(planes, near, others, old.ratio * LOCAL_FACTORS)
        lamps = [*others[:index], new, *others[index:]]
    return lamps, planes


def balance_lamps(lamps: list[_FittedLamp], planes: PlaneShading) -> tuple[list[_FittedLamp], PlaneShading]:
    """Return the most likely common factor of all strengths, with the brightness of the unseen surfaces."""
    factor, gain = (grid.ravel() for grid in np.meshgrid(LOCAL_FACTORS, UNSEEN_GAIN_GRID))
    best = int(_lamp_log_posterior(planes, *_totals(lamps, planes, factor), gain).argmax())
    return [fitted.scaled(float(factor[best])) for fitted in lamps], replace(planes, gain=float(gain[best]))


def _best_lamp(
    planes: PlaneShading, candidates: Candidates, others: list[_FittedLamp], ratios: FloatArray
) -> _FittedLamp:
    """Return the best lamp in addition to others; `ratios` (q,) are candidate direct-to-ambient ratios."""
    scores = _candidate_scores(planes, candidates, others, ratios)
    row, best = (int(k) for k in np.unravel_index(int(scores.argmax()), scores.shape))
    return _lamp_of_row(candidates, row, float(ratios[best]), scores, ratios)


def _candidate_scores(
    planes: PlaneShading, candidates: Candidates, others: list[_FittedLamp], ratios: FloatArray
) -> FloatArray:
    """Return the log posterior (c, q) of each candidate in addition to others, by its ratio (q,)."""
    direct, ratio, ceiling = _totals(others, planes)
    scores = [
        _lamp_log_posterior(
            planes,
            direct + q * candidates.irradiance,
            ratio + q,
            ceiling + q * candidates.ceiling_irradiance,
            planes.gain,
        )
        for q in ratios
    ]
    return np.asarray(np.array(scores).T + candidates.log_prior[:, None])


def _totals(
    lamps: list[_FittedLamp], planes: PlaneShading, factor: FloatArray | float = 1.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return sums over lamps of `factor` (c,) times their strength.

    Returns
    -------
    direct : (c, n) ndarray of float
        Irradiance of the cells. The axis c is absent for one factor, here and below.
    ratio : (c,) ndarray of float
        Direct-to-ambient ratio at a typical position.
    ceiling : (c,) ndarray of float
        Irradiance of the ceiling.
    """
    direct = sum((fitted.irradiance for fitted in lamps), np.zeros(len(planes.seen)))
    ratio, ceiling = sum(fitted.ratio for fitted in lamps), sum(fitted.ceiling_irradiance for fitted in lamps)
    return np.multiply.outer(factor, direct), np.multiply.outer(factor, ratio), np.multiply.outer(factor, ceiling)


def _lamp_log_posterior(
    planes: PlaneShading,
    direct: FloatArray,
    ratio: FloatArray | float,
    ceiling: FloatArray,
    gain: FloatArray | float,
) -> FloatArray:
    """Return the log posterior (c,) of lamps and of the brightness of the unseen surfaces.

    The contrast of shadows alone leaves a ridge, because stronger lamps and more ambient light explain it as well. The
    albedo of the lightest cells determines the total light, and the lamps determine the brightness of the ceiling.

    Parameters
    ----------
    direct : (c, n) ndarray of float
        Irradiance of the cells by the lamps.
    ratio, ceiling, gain : (c,) ndarray of float, or float
        Direct-to-ambient ratio, irradiance of the ceiling by the lamps, and brightness of the unseen surfaces.
    """
    fields = planes.seen + np.multiply.outer(np.asarray(gain), planes.unseen) + direct
    expected_gain = CEILING_ALBEDO * (1 + ceiling / planes.mean_irradiance)
    scores = CONTRAST_WEIGHT * log_posterior(planes, fields)
    scores = scores - 0.5 * (np.log(ratio / DIRECT_TO_AMBIENT_PRIOR) / DIRECT_TO_AMBIENT_SIGMA) ** 2
    scores = scores - 0.5 * (np.log(gain / expected_gain) / UNSEEN_SIGMA) ** 2
    lightest = np.quantile(planes.cells.log_luminance - np.log(fields), 1 - LIGHTEST_QUANTILE_TAIL, axis=1)
    albedo = np.pi * np.exp(lightest) / planes.unit
    return np.asarray(scores - 0.5 * (np.log(albedo / LIGHTEST_ALBEDO) / LIGHTEST_SIGMA) ** 2)


def _lamp_of_row(candidates: Candidates, row: int, ratio: float, scores: FloatArray, ratios: FloatArray) -> _FittedLamp:
    """Return the candidate of a row, with the likely candidates as its distribution.

    Parameters
    ----------
    ratio : float
        Direct-to-ambient ratio of the candidate.
    scores : (c, q) ndarray of float
        Log posterior of each candidate and ratio.
    ratios : (q,) ndarray of float
        Candidate ratios.
    """
    weight = np.exp(scores - scores.max())  # (c, q)
    likely = np.flatnonzero(weight.sum(axis=1) > MIN_RELATIVE_WEIGHT * weight.sum(axis=1).max())
    weight = weight[likely]
    mean_ratio = (weight * ratios).sum(axis=1) / weight.sum(axis=1)
    lamp = Lamp(
        candidates.positions[likely],
        candidates.facing[likely],
        weight.sum(axis=1) / weight.sum(),
        mean_ratio / TYPICAL_IRRADIANCE,
        candidates.spacing,
    )
    irradiance = ratio * candidates.irradiance[row]
    ceiling_irradiance = ratio * float(candidates.ceiling_irradiance[row])
    position, facing = candidates.positions[row], candidates.facing[row]
    return _FittedLamp(float(scores.max()), irradiance, lamp, position, facing, ratio, ceiling_irradiance)
