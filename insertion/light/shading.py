"""Lamps from the shading of planes: where the light of a scene comes from, and how much of it comes from nowhere.

A matt plane of one colour with albedo a has the radiance a / pi (A + sum_l P_l c_l / r_l^2): the ambient irradiance A
and, from each lamp l at the distance r_l, its strength times the cosine c_l. The colour is unknown, but on one plane it
is the same: how the brightness changes over the plane says where the lamps are. Candidates for lamps fill the room;
each gets a probability, so that a lamp that the planes do not pin down becomes a large soft one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from insertion.scene.patches import Patches
from metric_base.arrays import BoolArray, FloatArray

__all__ = ["Lamp", "Shading", "fit_shading"]

#: Cells and planes that a fit rests on.
LEAST_CELLS, LEAST_PLANES = 60, 2
#: Candidates along the horizontal axes and up; lamps are in the upper part of the room.
GRID, LEVELS, LOWEST = 11, 6, 0.45
#: Most lamps hang in this upper part of the room, or are windows in a wall: the log odds of one that stands about.
OVERHEAD, STANDING = 0.8, -4.0
#: Walls that no picture shows are further out than what they show, by this share of it.
BEYOND = 0.12
#: A room whose ceiling is not seen is taken to be this high, in longer sides.
HEIGHT_SHARE = 0.55
#: A plane is upright if its normal's cosine with up is below this.
UPRIGHT = 0.3
#: Irradiance of a lamp of strength 1 at an ordinary place, in 1 / diagonal^2: a third of a diagonal away.
USUAL = 10.0
#: Direct over ambient irradiance at the middle distance: what is tried, and what is likely (log normal).
RATIOS = np.geomspace(0.15, 12.0, 9)
RATIO_MIDDLE, RATIO_SIGMA = 1.5, 1.2
#: One sigma of a cell's log luminance (texture, shadows, uneven ambient light), where errors count linearly beyond.
CELL_SIGMA, OUTLIER = 0.15, 1.5
#: Neighbouring cells err alike: all cells together count as so many.
INDEPENDENT_CELLS = 60
#: One sigma of log albedo between walls (often painted alike) and between other planes.
WALL_SIGMA, OTHER_SIGMA = 0.35, 0.8
#: A further lamp must raise the log posterior by this.
WORTH, MOST_LAMPS = 8.0, 3
#: Candidates less likely than this share of the best are dropped.
LEAST_WEIGHT = 0.02
#: The lightest planes (painted walls, ceilings, paper) reflect this: the median of the lightest tenth of the cells.
WHITE_ALBEDO, LIGHTEST = 0.65, 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Lamp:
    """One lamp as places it may be at.

    places : (c, 3) in the scene; facing : (c, 3) unit direction in which it shines most, by the cosine, or 0 where it
    shines alike to all sides; weights : (c,) summing to 1; strengths : (c,) such that the irradiance across the light
    is strength / r^2; size : about the diameter of what a place stands for, scene units.
    """

    places: FloatArray
    facing: FloatArray
    weights: FloatArray
    strengths: FloatArray
    size: float


@dataclass(frozen=True, slots=True, eq=False)
class Shading:
    """ambient : irradiance in units of the pictures' radiance that reaches every surface; lamps : the direct light."""

    ambient: float
    lamps: tuple[Lamp, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Candidates:
    """Places and directions (c, 3), irradiance of each on the cells at a strength of 1 (c, n), (c,), and spacing."""

    places: FloatArray
    facing: FloatArray
    irradiance: FloatArray
    log_prior: FloatArray
    spacing: float


@dataclass(frozen=True, slots=True, eq=False)
class _Fitted:
    """A lamp with the log posterior of all of them, and its best candidate's irradiance on the cells (n,)."""

    score: float
    irradiance: FloatArray
    lamp: Lamp


def fit_shading(
    patches: Patches, up: FloatArray, impossible: Callable[[FloatArray], BoolArray] | None = None
) -> Shading | None:
    """The light that explains the patches; None where they are too few.

    up : (3,) unit vector; impossible : which of (n, 3) places no lamp is at.
    """
    if len(patches.plane) < LEAST_CELLS or len(np.unique(patches.plane)) < LEAST_PLANES:
        return None
    candidates = _candidates(patches, up, impossible)
    if not len(candidates.places):
        return None
    walls = _walls(patches, up)
    score = float(_scores(patches, walls, np.ones((1, len(patches.plane))))[0])
    lamps: list[_Fitted] = []
    while len(lamps) < MOST_LAMPS:
        more = _refit([*lamps, _best_lamp(patches, walls, candidates, lamps)], patches, walls, candidates)
        if more[-1].score < score + WORTH * bool(lamps):
            break
        lamps, score = more, more[-1].score
    field = _field(lamps, patches)
    ambient = _ambient(patches, field)
    unit = ambient * patches.diagonal**2
    scaled = [replace(fitted.lamp, strengths=fitted.lamp.strengths * unit) for fitted in lamps]
    return Shading(ambient, tuple(scaled))


def _refit(lamps: list[_Fitted], patches: Patches, walls: BoolArray, candidates: _Candidates) -> list[_Fitted]:
    """The lamps, each fitted again beside the others, for the first of two stood for both.

    walls : (k,) whether each plane is upright.
    """
    for number in range(len(lamps) if len(lamps) > 1 else 0):
        others = lamps[:number] + lamps[number + 1 :]
        lamps = [*others[:number], _best_lamp(patches, walls, candidates, others), *others[number:]]
    return lamps


def _best_lamp(patches: Patches, walls: BoolArray, candidates: _Candidates, others: list[_Fitted]) -> _Fitted:
    """One lamp beside others; walls : (k,) whether each plane is upright."""
    field = _field(others, patches)
    scores = np.array([_scores(patches, walls, field + q * candidates.irradiance) for q in RATIOS]).T  # (c, q)
    scores = scores - 0.5 * ((np.log(RATIOS / RATIO_MIDDLE) / RATIO_SIGMA) ** 2) + candidates.log_prior[:, None]
    row, ratio = np.unravel_index(int(scores.argmax()), scores.shape)
    irradiance = float(RATIOS[ratio]) * candidates.irradiance[row]
    return _Fitted(float(scores.max()), irradiance, _lamp(candidates, scores))


def _field(lamps: list[_Fitted], patches: Patches) -> FloatArray:
    """(n,) irradiance of the lamps and the ambient light over the ambient one."""
    return np.asarray(1.0 + sum((fitted.irradiance for fitted in lamps), np.zeros(len(patches.plane))))


def _candidates(patches: Patches, up: FloatArray, impossible: Callable[[FloatArray], BoolArray] | None) -> _Candidates:
    """Where a lamp may be; up : (3,) unit vector; impossible : which of (n, 3) places no lamp is at, (n,)."""
    basis = _basis(patches, up)
    local = patches.places @ basis.T
    low, high = local.min(axis=0), local.max(axis=0)
    high[2] = max(high[2], low[2] + HEIGHT_SHARE * float((high - low)[:2].max()))
    beyond = BEYOND * (high - low)
    steps = [np.linspace(low[k] - beyond[k], high[k] + beyond[k], GRID) for k in range(2)]
    levels = np.linspace(low[2] + LOWEST * (high[2] - low[2]), high[2], LEVELS)
    grid = np.stack(np.meshgrid(*steps, levels, indexing="ij"), axis=-1).reshape(-1, 3)
    kept = np.ones(len(grid), dtype=bool) if impossible is None else ~impossible(grid @ basis)
    grid, facing = _with_facing(grid[kept], steps, levels)
    places, facing = grid @ basis, facing @ basis
    away = places[:, None] - patches.places  # (c, n, 3)
    distance = np.maximum(np.linalg.norm(away, axis=-1), 0.04 * patches.diagonal)
    cosine = np.maximum(np.einsum("cnk,nk->cn", away, patches.normals) / distance, 0.0)
    shone = np.maximum(-np.einsum("cnk,ck->cn", away, facing) / distance, 0.0)
    shone[~facing.any(axis=1)] = 1.0
    irradiance = cosine * shone * (patches.diagonal / distance) ** 2 / USUAL
    standing = ~facing.any(axis=1) & (grid[:, 2] < low[2] + OVERHEAD * (high[2] - low[2]))
    return _Candidates(places, facing, irradiance, np.where(standing, STANDING, 0.0), float(steps[0][1] - steps[0][0]))


def _with_facing(grid: FloatArray, steps: list[FloatArray], levels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places with how a lamp there may shine: to all sides, from high up downwards, from a wall inwards.

    grid : (m, 3) along two horizontal axes and up; steps : (g,) on each horizontal axis; levels : (l,) heights; places
    and directions are (c, 3).
    """
    ways = [(grid, np.zeros(3)), (grid[grid[:, 2] >= levels[LEVELS // 2]], np.array([0.0, 0.0, -1.0]))]
    for axis in range(2):
        for end, inward in ((0, 1.0), (-1, -1.0)):
            direction = np.zeros(3)
            direction[axis] = inward
            ways.append((grid[grid[:, axis] == steps[axis][end]], direction))
    return np.concatenate([some for some, _ in ways]), np.concatenate([np.tile(way, (len(s), 1)) for s, way in ways])


def _basis(patches: Patches, up: FloatArray) -> FloatArray:
    """(3, 3) rows two horizontal axes, along the walls where there are any, and up."""
    upright = patches.normals[np.abs(patches.normals @ up) < UPRIGHT]
    across = upright[0] if len(upright) else np.array([1.0, 0, 0] if abs(up[0]) < 0.8 else [0, 1.0, 0])
    across = across - (across @ up) * up
    across /= np.linalg.norm(across)
    return np.array([across, np.cross(up, across), up])


def _walls(patches: Patches, up: FloatArray) -> BoolArray:
    """(k,) whether each plane is upright."""
    first = [int(np.argmax(patches.plane == k)) for k in range(int(patches.plane.max()) + 1)]
    return np.asarray(np.abs(patches.normals[first] @ up) < UPRIGHT)


def _scores(patches: Patches, walls: BoolArray, fields: FloatArray) -> FloatArray:
    """(c,) log posterior of fields (c, n) of irradiance over the ambient one."""
    rest = patches.log_luminance - np.log(fields)  # (c, n)
    temper = min(1.0, INDEPENDENT_CELLS / len(patches.plane))
    total = np.zeros(len(fields))
    albedos = []
    for plane in range(len(walls)):
        own = rest[:, patches.plane == plane]
        middle = np.median(own, axis=1)
        albedos.append(middle)
        off = np.abs(own - middle[:, None]) / CELL_SIGMA
        total -= temper * np.where(off < OUTLIER, 0.5 * off**2, OUTLIER * (off - 0.5 * OUTLIER)).sum(axis=1)
    albedo = np.array(albedos)  # (k, c)
    for kind, sigma in ((walls, WALL_SIGMA), (np.ones(len(walls), dtype=bool), OTHER_SIGMA)):
        if kind.sum() > 1:
            total -= 0.5 * (((albedo[kind] - albedo[kind].mean(axis=0)) / sigma) ** 2).sum(axis=0)
    return total


def _lamp(candidates: _Candidates, scores: FloatArray) -> Lamp:
    """The likely candidates with their mean ratios; scores : (c, q) log posterior by candidate and ratio."""
    weight = np.exp(scores - scores.max())  # (c, q)
    kept = np.flatnonzero(weight.sum(axis=1) > LEAST_WEIGHT * weight.sum(axis=1).max())
    weight = weight[kept]
    ratio = (weight * RATIOS).sum(axis=1) / weight.sum(axis=1)
    share = weight.sum(axis=1) / weight.sum()
    return Lamp(candidates.places[kept], candidates.facing[kept], share, ratio / USUAL, candidates.spacing)


def _ambient(patches: Patches, field: FloatArray) -> float:
    """Ambient irradiance: the lightest planes have the albedo of white, radiance = albedo / pi * ambient * field.

    field : (n,) irradiance of the cells over the ambient one.
    """
    lightest = float(np.quantile(patches.log_luminance - np.log(field), 1 - LIGHTEST))
    return float(np.pi * np.exp(lightest) / WHITE_ALBEDO)
