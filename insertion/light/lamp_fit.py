"""Lamps from the shading of planes: where the light of a scene comes from, and how much of it comes from nowhere.

A matt plane of one colour with albedo a has the radiance a / pi (A + sum_l P_l v_l c_l / r_l^2): the ambient
irradiance A, which is what the rest of the room sends and the pictures show, and, from each lamp l at the distance r_l
that it sees (v_l), its strength times the cosine c_l. The colour is unknown, but on one plane it is the same: how the
brightness changes over the plane, above all in shadows, says where the lamps are and how strong. Candidates for lamps
fill the room; the best are moved about until they fit. The albedo of the lightest planes has a say in their strength.

Planes of one colour each, lit alike or not: how well a field of light explains the brightness of their cells.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from insertion.colour import luminance
from insertion.light.lamp_candidates import (
    NEARBY,
    UPRIGHT,
    USUAL,
    Candidates,
    candidates_in,
    candidates_near,
    lamp_irradiance,
    open_share,
)
from insertion.scene.occupancy import Occupancy
from insertion.scene.plane_cells import Patches
from metric_base.arrays import BoolArray, FloatArray

#: Widths of the errors of cells' log luminance (texture, uneven ambient light): what is tried. Shadows whose edge is
#: wrong make few large errors.
CELL_WIDTHS = np.geomspace(0.03, 0.4, 6)
#: Neighbouring cells err alike: all cells together count as so many.
INDEPENDENT_CELLS = 60
#: One sigma of log albedo between walls (often painted alike) and between other planes.
WALL_SIGMA, OTHER_SIGMA = 0.35, 0.8
#: Cells and planes that a fit rests on.
LEAST_CELLS, LEAST_PLANES = 60, 2
#: Direct over ambient irradiance of one lamp at an ordinary place: what is tried.
RATIOS = np.geomspace(0.6, 25.0, 7)
#: Radiance of what no picture shows over the mean of the rest: what is tried, and one sigma of its logarithm.
UNSEEN, UNSEEN_SIGMA = np.geomspace(0.5, 5.0, 9), 0.3
#: What no picture shows is the ceiling above all: it reflects so much of what the pictures show and the lamps send up.
CEILING_ALBEDO = 0.85
#: All lamps together at an ordinary place over the ambient irradiance, and one sigma of its logarithm: what keeps the
#: energy of a closed room whose surfaces reflect a quarter to a half. The ten rooms that it was read off had 9 to 24.
DIRECT, DIRECT_SIGMA = 16.0, 0.3
#: How far the contrast counts: shadows whose edges are a little wrong say too little of the lamps.
CONTRAST = 0.25
#: Lamps that a pair is built on, and the best of these pairs that are moved about for a few turns.
SEEDS, TRIED, FEW_TURNS = 8, 4, 3
#: One sigma of the logarithm of a lamp's colour over grey in each channel: a camera balances its white for the light of
#: the scene, and not for each lamp of it. What is tried.
TINT_SIGMA, TINTS = 0.12, np.linspace(-0.6, 0.6, 25)
#: A further lamp must raise the log posterior by this.
WORTH, MOST_LAMPS = 2.0, 3
#: How often each lamp is moved, how much less far every time, and the ratios that are tried, over the last one.
TURNS, SHRINK = 9, 0.72
#: A lamp's place is known to this share of the candidates' spacing, and a cell is taken as lit, or in shadow, if no
#: more than this share of its spots and such places says otherwise.
PLACE_SPREAD, LIT_MARGIN = 0.3, 0.1
LOCAL_RATIOS = np.array([0.6, 0.78, 1.0, 1.28, 1.65])
#: Candidates less likely than this share of the best are dropped.
LEAST_WEIGHT = 0.02
#: The lightest planes of what is seen (a painted wall) reflect this: the median of the lightest tenth of the cells, and
#: one sigma of its logarithm.
LIGHTEST_ALBEDO, LIGHTEST_SIGMA, LIGHTEST = 0.55, 0.1, 0.05
#: Strengths of the lamps over those that were found, and brightness of what is not shown, that are tried at the end.
LAMPS_TIMES, UNSEEN_AT_END = np.geomspace(0.25, 4.0, 33), np.geomspace(0.3, 5.0, 25)


@dataclass(frozen=True, slots=True, eq=False)
class LitPlanes:
    """What is explained: the cells, and what casts shadows on them.

    walls : (k,) whether each plane is upright; shown : (n,) irradiance of the cells by what the pictures show, over its
    mean; missing : (n,) that of what they do not show if it were as bright as the rest; times : how bright it is;
    tint : (n, 3) colour of the ambient light over its luminance.
    """

    patches: Patches
    occupancy: Occupancy | None
    walls: BoolArray
    shown: FloatArray
    missing: FloatArray
    unit: float
    times: float = 1.0
    tint: FloatArray | None = None

    def ambient(self, times: float) -> FloatArray:
        """(n,) ambient irradiance on the cells."""
        return np.asarray(self.shown + times * self.missing)


def lit_planes(patches: Patches, up: FloatArray, occupancy: Occupancy | None) -> LitPlanes:
    """The cells with which planes are walls; up : (3,) unit vector."""
    first = [int(np.argmax(patches.plane == k)) for k in range(int(patches.plane.max()) + 1)]
    walls = np.asarray(np.abs(patches.normals[first] @ up) < UPRIGHT)
    if occupancy is None:
        return LitPlanes(patches, None, walls, np.zeros(len(patches.plane)), np.ones(len(patches.plane)), 1.0)
    colours, missing = occupancy.gathered_light(patches.places, patches.normals)
    mean = colours.sum(axis=0) / max(float((1 - missing).sum()), 1e-9)  # pi times the mean radiance of what is shown
    whole = colours + missing[:, None] * mean
    tint = whole / np.maximum(luminance(whole), 1e-12)[:, None]
    shown, bright = luminance(colours).astype(np.float64), float(luminance(mean))
    unit = float((shown + bright * missing).mean())
    return LitPlanes(patches, occupancy, walls, shown / unit, bright * missing / unit, unit, tint=np.asarray(tint))


def log_posterior(planes: LitPlanes, fields: FloatArray, values: FloatArray | None = None) -> FloatArray:
    """(c,) log posterior of fields (c, n) of irradiance over the ambient one.

    values : (n,) log radiance that they explain, the luminance without.
    """
    plane, walls = planes.patches.plane, planes.walls
    own = planes.patches.log_luminance if values is None else values
    rest = (own - np.log(fields)).astype(np.float32)  # (c, n)
    albedos = []
    ends = np.searchsorted(plane, np.arange(len(walls) + 1))
    for start, end in itertools.pairwise(ends):
        middle = np.partition(rest[:, start:end], (end - start) // 2, axis=1)[:, (end - start) // 2]
        rest[:, start:end] -= middle[:, None]
        albedos.append(middle)
    total = min(INDEPENDENT_CELLS, len(plane)) * _log_likelihood(rest)
    albedo = np.array(albedos, dtype=np.float64)  # (k, c)
    for kind, sigma in ((walls, WALL_SIGMA), (np.ones(len(walls), dtype=bool), OTHER_SIGMA)):
        if kind.sum() > 1:
            total -= 0.5 * (((albedo[kind] - albedo[kind].mean(axis=0)) / sigma) ** 2).sum(axis=0)
    return total


def _log_likelihood(errors: NDArray[np.float32]) -> FloatArray:
    """(c,) mean log likelihood of errors (c, n) under the Cauchy distribution of the width that explains them best."""
    squares = np.square(errors)
    each = [np.log1p(squares / np.float32(width**2)).mean(axis=1) + np.log(width) for width in CELL_WIDTHS]
    return np.asarray(-np.min(each, axis=0), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Lamp:
    """One lamp as places it may be at.

    places : (c, 3) in the scene; facing : (c, 3) unit direction in which it shines most, by the cosine, or 0 where it
    shines alike to all sides; weights : (c,) summing to 1; strengths : (c,) such that the irradiance across the light
    is strength / r^2; size : about the diameter of what a place stands for, scene units; colour : (3,) linear, of
    luminance 1.
    """

    places: FloatArray
    facing: FloatArray
    weights: FloatArray
    strengths: FloatArray
    size: float
    colour: FloatArray = field(default_factory=lambda: np.ones(3))


@dataclass(frozen=True, slots=True, eq=False)
class Shading:
    """The light without the lamps, as irradiance in units of the pictures' radiance, and the lamps.

    ambient : on the planes, their mean; unseen : radiance of what no picture shows, the ceiling above all; occupancy :
    what stands between the lamps and a place, None where nothing is known to.
    """

    ambient: float
    unseen: float
    lamps: tuple[Lamp, ...]
    occupancy: Occupancy | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Fitted:
    """A lamp with the log posterior of all of them, and its best candidate.

    irradiance : (n,) on the cells; place, facing : (3,); ratio : of direct over ambient irradiance; sent_up : mean
    irradiance of the ceiling.
    """

    score: float
    irradiance: FloatArray
    lamp: Lamp
    place: FloatArray
    facing: FloatArray
    ratio: float
    sent_up: float

    def times(self, by: float) -> _Fitted:
        """The same lamp `by` times as strong."""
        lamp = replace(self.lamp, strengths=by * self.lamp.strengths)
        return replace(
            self, irradiance=by * self.irradiance, lamp=lamp, ratio=by * self.ratio, sent_up=by * self.sent_up
        )


def fit_shading(
    patches: Patches,
    up: FloatArray,
    impossible: Callable[[FloatArray], BoolArray] | None = None,
    occupancy: Occupancy | None = None,
) -> Shading | None:
    """The light that explains the patches; None where they are too few.

    up : (3,) unit vector; impossible : which of (n, 3) places no lamp is at; occupancy : what casts shadows, and how
    bright it is; without it nothing does, and the irradiance by all but lamps is 1.
    """
    if len(patches.plane) < LEAST_CELLS or len(np.unique(patches.plane)) < LEAST_PLANES:
        return None
    candidates = candidates_in(patches, up, impossible, occupancy)
    if not len(candidates.places):
        return None
    planes = lit_planes(patches, up, occupancy)
    lamps, planes = _lamps(planes, candidates)
    if occupancy is not None:
        lamps, planes = _polish_sure(lamps, planes, up, candidates)
    lamps, planes = _lamps_at_end(lamps, planes)
    unit = planes.unit
    scaled = [
        replace(fitted.lamp, strengths=fitted.lamp.strengths * unit * patches.diagonal**2, colour=colour)
        for fitted, colour in zip(lamps, _lamp_colours(planes, lamps), strict=True)
    ]
    ambient = unit * float(planes.ambient(planes.times).mean())
    return Shading(ambient, unit * _shown_mean(planes) * planes.times / np.pi, tuple(scaled), occupancy)


def _lamp_colours(planes: LitPlanes, lamps: list[_Fitted]) -> list[FloatArray]:
    """(3,) colour of each lamp, of luminance 1: how the colour of a plane changes from shadow to light says it.

    The ambient light has the colour of what the pictures show. Each channel is fitted alone, the lamps in turn.
    """
    if planes.patches.hue is None or planes.tint is None:
        return [np.ones(3) for _ in lamps]
    logs = np.zeros((len(lamps), 3))
    for channel in range(3):
        own = planes.patches.log_luminance + planes.patches.hue[:, channel]
        ambient = planes.ambient(planes.times) * planes.tint[:, channel]
        for turn in range(2 * len(lamps)):
            number = turn % len(lamps)
            others = [np.exp(logs[k, channel]) * lamps[k].irradiance for k in range(len(lamps)) if k != number]
            fields = ambient + sum(others, np.zeros(len(ambient)))
            fields = fields + np.exp(TINTS)[:, None] * lamps[number].irradiance
            scores = log_posterior(planes, fields, own) - 0.5 * (TINTS / TINT_SIGMA) ** 2
            logs[number, channel] = TINTS[int(scores.argmax())]
    return [np.exp(row) / float(luminance(np.exp(row))) for row in logs]


def _lamps(planes: LitPlanes, candidates: Candidates) -> tuple[list[_Fitted], LitPlanes]:
    """One lamp, and further ones while each explains enough."""
    score = -np.inf
    lamps: list[_Fitted] = []
    while len(lamps) < MOST_LAMPS:
        if len(lamps) == 1:
            more = _best_pair(planes, candidates)
        else:
            more = [*lamps, _best_lamp(planes, candidates, lamps, RATIOS)]
        more, changed = _polish(more, planes, candidates)
        if more[-1].score < score + WORTH:
            break
        lamps, planes, score = more, changed, more[-1].score
    return lamps, planes


def _best_pair(planes: LitPlanes, candidates: Candidates) -> list[_Fitted]:
    """Two lamps that explain the cells together; what explains most alone may stand between them.

    The first of the two is one of the best alone that are not near to each other.
    """
    scores = _all_scores(planes, candidates, [], RATIOS)
    order = np.argsort(-scores.max(axis=1))
    seeds: list[int] = []
    for row in order:
        away = candidates.places[seeds] - candidates.places[row]
        if len(seeds) < SEEDS and (not seeds or np.linalg.norm(away, axis=1).min() > 1.5 * candidates.spacing):
            seeds.append(int(row))
    pairs = []
    for row in seeds:
        ratio = float(RATIOS[scores[row].argmax()]) / 2
        one = _lamp_of_row(candidates, row, ratio, scores, RATIOS)
        pairs.append([one, _best_lamp(planes, candidates, [one], RATIOS)])
    pairs.sort(key=lambda pair: -pair[1].score)
    tried = [_polish(pair, planes, candidates, FEW_TURNS)[0] for pair in pairs[:TRIED]]
    return max(tried, key=lambda pair: pair[1].score)


def _polish_sure(
    lamps: list[_Fitted], planes: LitPlanes, up: FloatArray, candidates: Candidates
) -> tuple[list[_Fitted], LitPlanes]:
    """The lamps polished on the cells that are clearly lit or clearly in shadow; up : (3,) unit vector.

    A cell taken for lit that is in shadow, or the other way round, makes every lamp look weaker than it is.
    """
    assert planes.occupancy is not None
    generator = np.random.default_rng(1)
    settled = np.ones(len(planes.shown), dtype=bool)
    for fitted in lamps:
        places = fitted.place + generator.normal(0.0, PLACE_SPREAD * candidates.spacing, (NEARBY, 3))
        share = open_share(planes.patches, planes.occupancy, places).mean(axis=0)
        settled &= (share < LIT_MARGIN) | (share > 1 - LIT_MARGIN) | (fitted.irradiance < LIT_MARGIN)
    some = planes.patches.cells(settled)
    if len(some.plane) < LEAST_CELLS or len(np.unique(some.plane)) < LEAST_PLANES:
        return lamps, planes
    fewer = replace(lit_planes(some, up, planes.occupancy), times=planes.times)
    lamps, fewer = _polish([_on_cells(fitted, fewer) for fitted in lamps], fewer, candidates)
    return [_on_cells(fitted, planes) for fitted in lamps], replace(planes, times=fewer.times)


def _on_cells(fitted: _Fitted, planes: LitPlanes) -> _Fitted:
    """The same lamp over other cells."""
    light = lamp_irradiance(planes.patches, fitted.place[None], fitted.facing[None], planes.occupancy)[0]
    return replace(fitted, irradiance=fitted.ratio * light)


def _polish(
    lamps: list[_Fitted], planes: LitPlanes, candidates: Candidates, turns: int = TURNS
) -> tuple[list[_Fitted], LitPlanes]:
    """The lamps moved about, one after another, ever less far: shadows say where they are to a hand's breadth."""
    generator = np.random.default_rng(0)
    for turn in range(turns * len(lamps)):
        number = turn % len(lamps)
        if number == 0:
            lamps, planes = _balance_lamps(lamps, planes)
        old, others = lamps[number], lamps[:number] + lamps[number + 1 :]
        spread = candidates.spacing * SHRINK ** (turn // len(lamps))
        near = candidates_near(candidates, old.place, old.facing, spread, planes.patches, planes.occupancy, generator)
        new = _best_lamp(planes, near, others, old.ratio * LOCAL_RATIOS)
        lamps = [*others[:number], new, *others[number:]]
    last = lamps[-1].score
    return [replace(fitted, score=last) for fitted in lamps], planes


def _balance_lamps(lamps: list[_Fitted], planes: LitPlanes) -> tuple[list[_Fitted], LitPlanes]:
    """The lamps, all brighter or darker, with the brightness of what is not shown: what explains the planes best.

    The two go together: a stronger lamp beside more light from everywhere leaves shadows as they are.
    """
    factor, times = (grid.ravel() for grid in np.meshgrid(LOCAL_RATIOS, UNSEEN))
    best = int(_scores(planes, *_sums(lamps, planes, factor), times).argmax())
    return [fitted.times(float(factor[best])) for fitted in lamps], replace(planes, times=float(times[best]))


def _best_lamp(planes: LitPlanes, candidates: Candidates, others: list[_Fitted], ratios: FloatArray) -> _Fitted:
    """One lamp beside others; ratios : (q,) of direct over ambient irradiance that are tried."""
    scores = _all_scores(planes, candidates, others, ratios)
    row, best = (int(k) for k in np.unravel_index(int(scores.argmax()), scores.shape))
    return _lamp_of_row(candidates, row, float(ratios[best]), scores, ratios)


def _all_scores(planes: LitPlanes, candidates: Candidates, others: list[_Fitted], ratios: FloatArray) -> FloatArray:
    """(c, q) log posterior of each candidate beside others, by its ratio (q,)."""
    direct, ratio, sent_up = _sums(others, planes)
    scores = [
        _scores(planes, direct + q * candidates.irradiance, ratio + q, sent_up + q * candidates.sent_up, planes.times)
        for q in ratios
    ]
    return np.asarray(np.array(scores).T + candidates.log_prior[:, None])


def _sums(
    lamps: list[_Fitted], planes: LitPlanes, factor: FloatArray | float = 1.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of all lamps, `factor` (c,) times as strong: what they send to the cells (c, n), their ratio, what they send up.

    ratio, sent up : (c,) direct over ambient irradiance, and irradiance of the ceiling; one factor leaves out the c.
    """
    direct = sum((fitted.irradiance for fitted in lamps), np.zeros(len(planes.shown)))
    ratio, sent_up = sum(fitted.ratio for fitted in lamps), sum(fitted.sent_up for fitted in lamps)
    return np.multiply.outer(factor, direct), np.multiply.outer(factor, ratio), np.multiply.outer(factor, sent_up)


def _scores(
    planes: LitPlanes, direct: FloatArray, ratio: FloatArray | float, sent_up: FloatArray, times: FloatArray | float
) -> FloatArray:
    """(c,) log posterior of lamps, and of what no picture shows, by all that is known of both.

    The contrast of shadows alone leaves a ridge: stronger lamps beside more light from everywhere explain it as well,
    and shadows whose edges are a little wrong make lamps look weak. The albedo of the lightest planes says how much
    light there is in all, and the lamps say how bright the ceiling is.
    direct : (c, n) irradiance of the cells by the lamps; ratio, sent_up, times : (c,) or one for all.
    """
    fields = planes.shown + np.multiply.outer(np.asarray(times), planes.missing) + direct
    ceiling = CEILING_ALBEDO * (1 + sent_up / _shown_mean(planes))
    scores = CONTRAST * log_posterior(planes, fields) - 0.5 * (np.log(ratio / DIRECT) / DIRECT_SIGMA) ** 2
    scores = scores - 0.5 * (np.log(times / ceiling) / UNSEEN_SIGMA) ** 2
    lightest = np.quantile(planes.patches.log_luminance - np.log(fields), 1 - LIGHTEST, axis=1)
    albedo = np.pi * np.exp(lightest) / planes.unit
    return np.asarray(scores - 0.5 * (np.log(albedo / LIGHTEST_ALBEDO) / LIGHTEST_SIGMA) ** 2)


def _lamp_of_row(candidates: Candidates, row: int, ratio: float, scores: FloatArray, ratios: FloatArray) -> _Fitted:
    """The candidate of a row; scores : (c, q) by candidate and ratio (q,)."""
    lamp = _lamp(candidates, scores, ratios)
    place, facing = candidates.places[row], candidates.facing[row]
    light, sent_up = ratio * candidates.irradiance[row], ratio * float(candidates.sent_up[row])
    return _Fitted(float(scores.max()), light, lamp, place, facing, ratio, sent_up)


def _lamp(candidates: Candidates, scores: FloatArray, ratios: FloatArray) -> Lamp:
    """The likely candidates with their mean ratios (q,); scores : (c, q) log posterior by candidate and ratio."""
    weight = np.exp(scores - scores.max())  # (c, q)
    kept = np.flatnonzero(weight.sum(axis=1) > LEAST_WEIGHT * weight.sum(axis=1).max())
    weight = weight[kept]
    ratio = (weight * ratios).sum(axis=1) / weight.sum(axis=1)
    share = weight.sum(axis=1) / weight.sum()
    return Lamp(candidates.places[kept], candidates.facing[kept], share, ratio / USUAL, candidates.spacing)


def _lamps_at_end(lamps: list[_Fitted], planes: LitPlanes) -> tuple[list[_Fitted], LitPlanes]:
    """The lamps, all stronger or weaker, with the brightness of what is not shown: the mean over the posterior."""
    factor, times = (grid.ravel() for grid in np.meshgrid(LAMPS_TIMES, UNSEEN_AT_END))
    scores = _scores(planes, *_sums(lamps, planes, factor), times)
    weights = np.exp(scores - scores.max())
    by, unseen = (float(np.exp(np.average(np.log(values), weights=weights))) for values in (factor, times))
    return [fitted.times(by) for fitted in lamps], replace(planes, times=unseen)


def _shown_mean(planes: LitPlanes) -> float:
    """Irradiance of a place that sees the mean of what the pictures show all around, in units of `planes.unit`."""
    return float((planes.missing.sum() + planes.shown.sum()) / len(planes.shown))
