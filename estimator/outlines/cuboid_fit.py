"""The upright solid that fits an object's outlines in all views and its points: one likelihood.

Outlines show where an object ends in each direction, points where its surfaces are. Of many points the edges of their
own box say most, and of few or none the outlines: each counts by its standard deviation. The depth comes from the
points, each as good as its rays make it, from the surface that the object stands on, and from the parallax of the
outlines themselves.

An outline at the border of a picture, or behind another object, is not used; elsewhere it may lie inside the object's,
where something hides the rest, rather than outside it. A footprint may be a rectangle or an ellipse: both are fitted,
and where both explain the data the result is of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.outlines.reaches import DIRECTIONS, Outlines
from estimator.outlines.solids import Shape, entry_depths, projected_reaches, supports
from metric_base.arrays import BoolArray, FloatArray

__all__ = ["BOX_BODIES", "Cuboid", "PointEdges", "Sightings", "fit_cuboid"]

# Towards a corner the outline may stay inside the solid's by so many times more than it may elsewhere.
CORNER_TIMES = 3.0
DIAGONAL = np.arange(len(DIRECTIONS)) >= 4
# Residuals, in standard deviations, at which a point counts half, before the solid's face and behind it: masks take in
# a piece of the wall behind.
HALF_BEFORE, HALF_BEHIND = 2.5, 1.5
# A point may lie behind the face where its ray enters by this share of the way to the other side: objects have hollows.
HOLLOW_SHARE = 0.3
# Points of one object err together where they share their views: all of them count as at most so many.
MAX_INDEPENDENT_POINTS = 8
# Neighbouring views err alike, by the same bulge that no solid has: all views count as at most so many, and of more
# than so many an even choice is used.
MAX_INDEPENDENT_VIEWS, MAX_VIEWS = 4, 16
# The same for edges of the points' box, and for the foot: nothing goes below what it stands on.
HALF_EDGE, HALF_FOOT = 2.5, 10.0
# What is known of an object before: its sides within a factor of 1.8 of what single outlines show. The centre is open
# by `CENTRE_SD` distances, which only says that it is somewhere ahead. Of a round object length and width are alike.
SIDE_SD, CENTRE_SD, YAW_SD, ROUND_SD = (0.6, 0.6, 0.5), 0.7, 2.0, 0.15
# Steps of the fit, the change at which it ends, and its damping at the start and at most.
STEPS, ENOUGH, DAMPING, MOST_DAMPING = 40, 1e-7, 1e-2, 1e3
# Furthest that one step goes, in sizes, natural logs and radians.
MOST_STEP = 0.4
# No start is worse than the best by more than this: it has no weight then.
MOST_COST = 200.0


@dataclass(frozen=True, slots=True)
class Body:
    """What an object may be like.

    shape : of its footprint; length, width : what a fit starts from, over what the outlines are wide: they show the one
    or the other; headings : that a fit starts from; half_inside, half_outside : residuals, in standard deviations, at
    which an outline counts half that stays inside the solid's, since objects do not fill their solid or something hides
    them, and one that goes beyond.
    """

    shape: Shape
    length: float
    width: float
    headings: int
    half_inside: float
    half_outside: float


#: Of objects with masks: full boxes and full cylinders. Of boxes alone, which say less: something between.
BODIES = (Body("box", 1.25, 0.75, 4, 0.5, 1.2), Body("round", 1.0, 1.0, 1, 0.5, 1.2))
BOX_BODIES = (Body("octagon", 1.25, 0.75, 4, 1.5, 2.5),)


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """Points of an object, each along one line of sight, in the level basis.

    eyes : (n, 3); rays : (n, 3) unit; depths : (n,) along them; sigma : (n,) one standard deviation of the depth.
    """

    eyes: FloatArray
    rays: FloatArray
    depths: FloatArray
    sigma: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class PointEdges:
    """The sides of the box of an object's points.

    directions : (m, 3) unit outward normals in the level basis; reach : (m,) how far the box goes along them from the
    origin; sigma, beyond : (m,) one standard deviation where the object ends before that, and where it goes further: a
    side that the points do not show to its end may go on. box : (7,) the whole as a solid, where a fit may start.
    """

    directions: FloatArray
    reach: FloatArray
    sigma: FloatArray
    beyond: FloatArray
    box: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Cuboid:
    """An upright cuboid: centre (3,) in the level basis, yaw in radians, extents (3,) length >= width, height.

    covariance : (3, 3) of the log extents; misfit : root mean square of the residuals that count.
    """

    centre: FloatArray
    yaw: float
    extents: FloatArray
    covariance: FloatArray
    misfit: float


@dataclass(frozen=True, slots=True, eq=False)
class _Data:
    """All that a fit is of: outlines, points, the edges of their box, height and standard deviation of the foot."""

    outlines: Outlines
    points: Sightings | None
    edges: PointEdges | None
    foot: tuple[float, float] | None


@dataclass(frozen=True, slots=True, eq=False)
class _Fits:
    """Fits from k starts: cost (k,), parameters (k, 7), their covariance (k, 7, 7), misfit (k,)."""

    cost: FloatArray
    at: FloatArray
    covariance: FloatArray
    misfit: FloatArray


def fit_cuboid(
    outlines: Outlines,
    middle: FloatArray,
    yaw: float,
    foot: tuple[float, float] | None = None,
    points: Sightings | None = None,
    centre_sd: float | None = None,
    edges: PointEdges | None = None,
    bodies: Sequence[Body] = BODIES,
) -> Cuboid:
    """The cuboid round the solid that fits best, by damped least squares with weights 1 / (1 + r^2 / c^2).

    Where several headings or shapes explain the data, the extents and their covariance are of all of them together.

    Parameters
    ----------
    middle : (3,) about where the object is, in the level basis
    yaw : about how its footprint is turned
    foot : height and standard deviation of what it stands on, scene units
    points : its points, each as good as its rays
    centre_sd : one standard deviation of `middle` in scene units, where nothing else says how far away the object is
    edges : the sides of its points' box, where there are points enough for one
    bodies : what it may be like
    """
    depth = (outlines.rotation @ middle + outlines.translation)[:, 2]
    near = depth > 0
    spans = (outlines.reach[:, :2] + outlines.reach[:, 2:4])[near] * depth[near, None]  # (k, 2) width and height
    across, tall = np.maximum(np.median(spans, axis=0), np.finfo(float).tiny) if near.any() else (1.0, 1.0)
    away = float(np.median(np.linalg.norm(outlines.rotation @ middle + outlines.translation, axis=1)))
    data = _Data(outlines.some(MAX_VIEWS), points, edges, foot)
    fits = []
    for body in bodies:
        turns = np.arange(body.headings) * np.pi / 4
        logs = np.log([body.length * across, body.width * across, tall])
        starts = np.array([[*middle, yaw + turn, *logs] for turn in turns])
        if edges is not None:
            starts = np.vstack([starts, edges.box])
        fits.append(_fit(data, body, starts, float(np.sqrt(across * tall)), centre_sd or CENTRE_SD * away))
    return _join(fits)


def _fit(data: _Data, body: Body, starts: FloatArray, size: float, centre_sd: float) -> _Fits:
    """The fits of one body from starts (k, 7), all at once."""
    unit = np.array([size, size, size, 1, 1, 1, 1])
    step = 1e-3 * unit
    weight = np.diag(np.array([*[centre_sd] * 3, YAW_SD, *SIDE_SD]) ** -2.0)
    if body.shape == "round":
        weight[4:6, 4:6] += np.array([[1, -1], [-1, 1]]) / ROUND_SD**2
    count = len(starts)
    at, best = starts.copy(), starts.copy()
    damping, cost, misfit = np.full(count, DAMPING), np.full(count, np.inf), np.ones(count)
    normal, pull = np.tile(weight, (count, 1, 1)), np.zeros((count, 7))
    active = np.ones(count, dtype=bool)
    for _ in range(STEPS):
        rows, weights, residual, loss = _residuals(data, body, at[active], step)
        off = at[active] - starts[active]
        now = loss + np.einsum("ki,ij,kj->k", off, weight, off)
        live = np.flatnonzero(active)
        better = now < cost[live]
        gain = cost[live] - now
        won = live[better]
        weighted = rows[better] * weights[better, :, None]
        normal[won] = rows[better].transpose(0, 2, 1) @ weighted + weight
        pull[won] = np.einsum("kmi,km->ki", weighted, residual[better]) + off[better] @ weight
        total = np.maximum(weights[better].sum(axis=1), 1.0)
        misfit[won] = np.sqrt((weights[better] * residual[better] ** 2).sum(axis=1) / total)
        cost[won], best[won] = now[better], at[won]
        damping[live] = np.where(better, damping[live] / 3, damping[live] * 10)
        active[live] = np.where(better, gain >= ENOUGH * np.maximum(now, 1.0), damping[live] <= MOST_DAMPING)
        if not active.any():
            break
        at[active] = best[active] + _steps(normal[active], pull[active], damping[active], MOST_STEP * unit)
    return _Fits(cost, best, np.asarray(np.linalg.inv(normal), dtype=np.float64), misfit)


def _steps(normal: FloatArray, pull: FloatArray, damping: FloatArray, most: FloatArray) -> FloatArray:
    """(k, 7) damped steps of the normal equations (k, 7, 7) with right sides (k, 7), none further than `most` (7,)."""
    diagonal = np.einsum("kii->ki", normal)
    damped = normal + (damping[:, None] * diagonal)[:, :, None] * np.eye(7)
    return np.clip(-np.linalg.solve(damped, pull[:, :, None])[..., 0], -most, most)


def _residuals(
    data: _Data, body: Body, at: FloatArray, step: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Slopes (k, m, 7), weights (k, m), residuals (k, m) of all that is fitted at (k, 7), and robust costs (k,)."""
    count = len(at)
    trial = (at[:, None] + np.vstack([np.zeros(7), np.diag(step)])).reshape(-1, 7)
    parts = [_outline_residuals(data.outlines, projected_reaches(data.outlines, trial, body.shape), body, count)]
    if data.points is not None and len(data.points.depths):
        enter, inside = entry_depths(trial, data.points.eyes, data.points.rays, body.shape)
        parts.append(_point_residuals(data.points, enter.reshape(count, 8, -1), inside.reshape(count, 8, -1)[:, 0]))
    if data.edges is not None:
        parts.append(
            _edge_residuals(data.edges, supports(trial, data.edges.directions, body.shape).reshape(count, 8, -1))
        )
    if data.foot is not None:
        bottom = (trial[:, 2] - np.exp(trial[:, 6]) / 2).reshape(count, 8, 1)
        off = (bottom - data.foot[0]) / data.foot[1]
        parts.append((off, np.full((count, 1), HALF_FOOT), np.ones((count, 1))))
    values, halves, counts = (np.concatenate(each, axis=-1) for each in zip(*parts, strict=True))
    residual = values[:, 0]
    slope = ((values[:, 1:] - values[:, :1]) / step[:, None]).transpose(0, 2, 1)
    square = (residual / halves) ** 2
    return slope, counts / (1 + square), residual, (counts * halves**2 * np.log1p(square)).sum(axis=1)


def _view_share(outlines: Outlines) -> float:
    """What one view counts."""
    return min(1.0, MAX_INDEPENDENT_VIEWS / len(outlines.reach))


def _outline_residuals(
    outlines: Outlines, reaches: FloatArray, body: Body, count: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (k, 8, m), half-weight residuals (k, m) and counts (k, m) of the projections (8 k, v, 8)."""
    residual = ((reaches - outlines.reach) / outlines.sigma).reshape(count, 8, -1)
    outside = residual[:, 0] > 0
    # objects do not fill the corners of their solid
    loose = np.where(outside & np.tile(DIAGONAL, len(outlines.reach)), 1 / CORNER_TIMES, 1.0)
    counts = np.broadcast_to(_view_share(outlines) * outlines.free.ravel(), outside.shape)
    return residual * loose[:, None], np.where(outside, body.half_inside, body.half_outside), counts


def _point_residuals(
    points: Sightings, enter: FloatArray, inside: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same for the points, whose rays enter at depths (k, 8, n) and stay inside for (k, n)."""
    behind: BoolArray = points.depths > enter[:, 0]
    sigma = np.hypot(points.sigma, np.where(behind, HOLLOW_SHARE * inside, 0.0))
    counts = np.full(behind.shape, min(1.0, MAX_INDEPENDENT_POINTS / len(points.sigma)))
    half = np.where(behind, HALF_BEHIND, HALF_BEFORE)
    return (enter - points.depths) / sigma[:, None], half, counts


def _edge_residuals(edges: PointEdges, reach: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same for the edges of the points' box, which the solids pass by `reach` (k, 8, m) from the origin."""
    further = reach[:, 0] > edges.reach
    sigma = np.where(further, edges.beyond, edges.sigma)
    half = np.full(further.shape, HALF_EDGE)
    return (reach - edges.reach) / sigma[:, None], half, np.ones(further.shape)


def _join(parts: list[_Fits]) -> Cuboid:
    """The cuboid of the fits of several bodies: each body by its best cost, the starts of one share its weight."""
    cost, at, covariance, misfit = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("cost", "at", "covariance", "misfit")
    )
    finite = np.isfinite(cost)
    # wild cameras make no sense of any heading
    least = float(cost[finite].min()) if finite.any() else 0.0
    chance = np.where(finite, np.exp(-np.minimum(np.where(finite, cost, np.inf) - least, MOST_COST) / 2), 0.0)
    if not finite.any():
        chance[0] = 1.0
    body = np.repeat(np.arange(len(parts)), [len(part.cost) for part in parts])
    best, total = np.zeros(len(parts)), np.zeros(len(parts))
    np.maximum.at(best, body, chance)
    np.add.at(total, body, chance)
    weights = chance * (best / np.maximum(total, np.finfo(float).tiny))[body]
    weights /= weights.sum()
    swapped = at[:, 4] < at[:, 5]
    order = np.where(swapped[:, None], [5, 4, 6], [4, 5, 6])
    logs = np.take_along_axis(at, order, axis=1)
    own = np.array([each[np.ix_(rows, rows)] for each, rows in zip(covariance, order, strict=True)])
    own *= np.maximum(misfit, 1.0)[:, None, None] ** 2
    mean = weights @ logs
    off = logs - mean
    spread = np.einsum("k,kij->ij", weights, own + off[:, :, None] * off[:, None, :])
    top = int(weights.argmax())
    yaw = float(at[top, 3] + (np.pi / 2 if swapped[top] else 0.0))
    return Cuboid(at[top, :3], yaw, np.exp(mean), spread, float(misfit[top]))
