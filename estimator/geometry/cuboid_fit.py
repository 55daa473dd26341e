"""The upright cuboid whose projection fits an object's outlines in all views, and its few points.

Points are few on small, far and half-hidden objects, and of a box most points are background. Outlines say more: each
is where the object ends in that direction. A cuboid seen from several sides has to fit them all, so that its sides come
with the spread that the views leave. Its depth comes from the points, each as good as its rays make it, from the
surface that it stands on, and from the parallax of the outlines themselves. Outlines and points are one likelihood.

Edges at the border of a picture, or behind another object, are not used; elsewhere an edge may lie inside the object's
outline, where something hides the rest, rather than outside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.geometry.mask_outlines import DIRECTIONS, Outlines
from metric_base.arrays import FloatArray

# Towards a corner the outline may stay inside the cuboid's by so many times more than it may elsewhere.
CORNER_TIMES = 3.0
DIAGONAL = np.arange(len(DIRECTIONS)) >= 4
# Residuals, in standard deviations, at which an edge counts half: inside the outline, where objects may be hidden, and
# outside.
HALF_INSIDE, HALF_OUTSIDE = 1.5, 2.5
# The same for a point before the cuboid's face and behind it: masks take in a piece of the wall behind.
HALF_BEFORE, HALF_BEHIND = 2.5, 1.5
# A point may lie behind the face where its ray enters by this share of the way to the other side: objects have hollows.
HOLLOW_SHARE = 0.3
# Points of one object err together where they share their views: all of them count as at most so many.
MAX_INDEPENDENT_POINTS = 8
# Neighbouring views err alike, by the same bulge that no cuboid has: all views count as at most so many.
MAX_INDEPENDENT_VIEWS = 4
# Footprints are between a rectangle and an ellipse: an octagon with corners cut off from this share of half a side.
CORNER = 0.75
# The corners (16, 3) of the octagon's prism with unit sides.
UNIT_CORNERS = np.array(
    [
        (x * a / 2, y * b / 2, z)
        for a, b in ((1, CORNER), (CORNER, 1))
        for x in (1, -1)
        for y in (1, -1)
        for z in (-0.5, 0.5)
    ]
)
# What is known of a cuboid before: its sides within a factor of 1.8 of what single outlines show. The centre is open by
# `CENTRE_SD` distances, which only says that it is somewhere ahead.
SIDE_SD, CENTRE_SD, YAW_SD = (0.6, 0.6, 0.5), 0.7, 2.0
# Length and width that a fit starts from, over what the outlines are wide: they show the one or the other.
START_LENGTH, START_WIDTH = 1.25, 0.75
# Steps of the fit, the change at which it ends, and its damping at the start and at most.
STEPS, COST_TOLERANCE, DAMPING, MOST_DAMPING = 40, 1e-6, 1e-2, 1e3
# Furthest that one step goes, in sizes, natural logs and radians.
MOST_STEP = 0.4
# Starts whose cost is higher by this much are no explanation of the outlines.
WORSE_COST = 12.0


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
    """All that a fit is of: outlines, points, height and standard deviation of the foot."""

    outlines: Outlines
    points: Sightings | None
    foot: tuple[float, float] | None


def fit_cuboid(
    outlines: Outlines,
    middle: FloatArray,
    yaw: float,
    foot: tuple[float, float] | None = None,
    points: Sightings | None = None,
    centre_sd: float | None = None,
) -> Cuboid:
    """The cuboid that fits best, by damped least squares with weights 1 / (1 + r^2 / c^2) from four headings.

    Where several headings explain the outlines, the extents and their covariance are of all of them together.

    Parameters
    ----------
    middle : (3,) about where the object is, in the level basis
    yaw : about how its footprint is turned
    foot : height and standard deviation of what it stands on, scene units
    points : its points, each as good as its rays
    centre_sd : one standard deviation of `middle` in scene units, where nothing else says how far away the object is
    """
    depth = (outlines.rotation @ middle + outlines.translation)[:, 2]
    near = depth > 0
    spans = (outlines.reach[:, :2] + outlines.reach[:, 2:4])[near] * depth[near, None]  # (k, 2) width and height
    across, tall = np.maximum(np.median(spans, axis=0), np.finfo(float).tiny) if near.any() else (1.0, 1.0)
    away = float(np.median(np.linalg.norm(outlines.rotation @ middle + outlines.translation, axis=1)))
    data = _Data(outlines, points, foot)
    fits = []
    for turn in np.arange(4) * np.pi / 4:
        start = np.array(
            [*middle, yaw + turn, np.log(START_LENGTH * across), np.log(START_WIDTH * across), np.log(tall)]
        )
        fits.append(_fit(data, start, float(np.sqrt(across * tall)), centre_sd or CENTRE_SD * away))
    return _join(fits)


def entry_depths(parameters: FloatArray, sight: Sightings) -> tuple[FloatArray, FloatArray]:
    """(k, n) depth at which each ray enters k cuboids, parameters (k, 7), and how long it stays inside.

    A ray that misses enters and leaves where it comes nearest to doing both.
    """
    c, s = np.cos(parameters[:, 3, None]), np.sin(parameters[:, 3, None])
    x, y, z = sight.eyes.T[:, None] - parameters.T[:3, :, None]  # (k, n) each
    p, q, r = sight.rays.T
    halves = np.exp(parameters.T[4:, :, None]) / 2  # (3, k, 1)
    enter, leave = np.array(-np.inf), np.array(np.inf)
    # in each cuboid's own axes, one after the other
    for start, ray, half in zip(
        (c * x + s * y, c * y - s * x, z), (c * p + s * q, c * q - s * p, r), halves, strict=True
    ):
        slope = np.where(np.abs(ray) < 1e-9, 1e-9, ray)
        one, two = (-half - start) / slope, (half - start) / slope
        enter, leave = np.maximum(enter, np.minimum(one, two)), np.minimum(leave, np.maximum(one, two))
    missed = enter > leave
    middle = (enter + leave) / 2
    return np.where(missed, middle, enter), np.where(missed, 0.0, leave - enter)


def _reaches(outlines: Outlines, parameters: FloatArray) -> FloatArray:
    """(k, v, 8) how far k cuboids reach in each picture, parameters (k, 7): centre, yaw, log extents."""
    c, s = np.cos(parameters[:, 3]), np.sin(parameters[:, 3])  # (k,)
    x, y, z = UNIT_CORNERS.T[:, :, None] * np.exp(parameters.T[4:, None])  # (16, k) each
    world = np.array([c * x - s * y, s * x + c * y, z]) + parameters.T[:3, None]  # (3, 16, k)
    turned = outlines.rotation.transpose(1, 2, 0)  # (3, 3, v)
    camera = world.reshape(3, -1).T @ turned + outlines.translation.T[:, None]  # (3, 16 k, v)
    # what is behind the camera is far to the side
    at = camera[:2] / np.maximum(camera[2], 1e-3 * np.abs(camera).max())
    furthest = (DIRECTIONS @ at.reshape(2, len(UNIT_CORNERS), -1).transpose(1, 0, 2)).max(axis=0)  # (8, k v)
    return np.asarray(furthest.reshape(len(DIRECTIONS), len(parameters), -1).transpose(1, 2, 0))


def _fit(data: _Data, start: FloatArray, size: float, centre_sd: float) -> tuple[float, FloatArray, FloatArray, float]:
    """Cost, parameters (7,), covariance (7, 7) of them, and misfit of one start."""
    unit = np.array([size, size, size, 1, 1, 1, 1])
    step, most = 1e-3 * unit, MOST_STEP * unit
    prior_sd = np.array([*[centre_sd] * 3, YAW_SD, *SIDE_SD])
    at = start.copy()
    damping, cost, centre = DAMPING, np.inf, start
    known = np.diag(prior_sd**-2)
    normal, pull, misfit = known, np.zeros(7), 1.0
    for _ in range(STEPS):
        rows, weight, residual, loss = _residuals(data, at, step)
        now = loss + float((((at - start) / prior_sd) ** 2).sum())
        if now < cost:
            done = cost - now < COST_TOLERANCE * max(now, 1.0)
            cost, centre, damping = now, at, damping / 3
            normal = rows.T @ (rows * weight[:, None]) + known
            pull = rows.T @ (weight * residual) + (at - start) / prior_sd**2
            misfit = float(np.sqrt((weight * residual**2).sum() / max(float(weight.sum()), 1.0)))
        else:
            done, damping = damping > MOST_DAMPING, damping * 10
        if done:
            break
        change = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), pull)
        at = centre + np.clip(change, -most, most)
    return cost, centre, np.asarray(np.linalg.inv(normal)), misfit


def _residuals(data: _Data, at: FloatArray, step: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Slopes (m, 7), weights (m,) and residuals (m,) of all that is fitted, and its robust cost."""
    trial = at + np.vstack([np.zeros(7), np.diag(step)])
    outlines = data.outlines
    reaches = _reaches(outlines, trial) / outlines.sigma
    residual = (reaches[0] - outlines.reach / outlines.sigma).ravel()
    slope = ((reaches[1:] - reaches[0]).reshape(7, -1) / step[:, None]).T
    # objects do not fill the corners of their cuboid
    loose = np.where((residual.reshape(-1, len(DIRECTIONS)) > 0) & DIAGONAL, 1 / CORNER_TIMES, 1.0).ravel()
    residual, slope = residual * loose, slope * loose[:, None]
    half = np.where(residual > 0, HALF_INSIDE, HALF_OUTSIDE)
    share = min(1.0, MAX_INDEPENDENT_VIEWS / len(outlines.reach))
    parts = [(slope, residual, half, share * outlines.free.ravel())]
    if data.points is not None and len(data.points.depths):
        parts.append(_point_residuals(data.points, trial, step))
    if data.foot is not None:
        height = np.exp(at[6])
        own = np.array([[0, 0, 1, 0, 0, 0, -height / 2]]) / data.foot[1]
        off = np.array([(at[2] - height / 2 - data.foot[0]) / data.foot[1]])
        parts.append((own, off, np.array([HALF_OUTSIDE]), np.ones(1)))
    rows, residuals, halves, counts = (np.concatenate(each) for each in zip(*parts, strict=True))
    weight = counts / (1 + (residuals / halves) ** 2)
    return rows, weight, residuals, float((counts * halves**2 * np.log1p((residuals / halves) ** 2)).sum())


def _point_residuals(
    points: Sightings, trial: FloatArray, step: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Slopes (n, 7), residuals (n,), half-weight residuals (n,) and counts (n,) of the points against the faces."""
    enter, inside = entry_depths(trial, points)
    behind = points.depths > enter[0]
    sigma = np.hypot(points.sigma, np.where(behind, HOLLOW_SHARE * inside[0], 0.0))
    residual = (enter[0] - points.depths) / sigma
    slope = ((enter[1:] - enter[0]) / (sigma * step[:, None])).T
    half = np.where(behind, HALF_BEHIND, HALF_BEFORE)
    return slope, residual, half, np.full(len(sigma), min(1.0, MAX_INDEPENDENT_POINTS / len(sigma)))


def _join(fits: list[tuple[float, FloatArray, FloatArray, float]]) -> Cuboid:
    """The cuboid of several fits (cost, (7,), (7, 7), misfit), each with the weight of its cost."""
    fits = [fit for fit in fits if np.isfinite(fit[0])] or fits[:1]  # wild cameras make no sense of any heading
    least = min(fit[0] for fit in fits)
    kept = [fit for fit in fits if not fit[0] - least >= WORSE_COST]
    weights = np.array([np.exp(-(fit[0] - least) / 2) if np.isfinite(least) else 1.0 for fit in kept])
    weights /= weights.sum()
    logs, covariances, centres, yaws = [], [], [], []
    for _, at, covariance, misfit in kept:
        order = [4, 5, 6] if at[4] >= at[5] else [5, 4, 6]
        logs.append(at[order])
        covariances.append(covariance[np.ix_(order, order)] * max(misfit, 1.0) ** 2)
        centres.append(at[:3])
        yaws.append(at[3] + (0.0 if order[0] == 4 else np.pi / 2))
    mean = weights @ np.array(logs)
    off = np.array(logs) - mean
    spread = np.einsum("k,kij->ij", weights, np.array(covariances) + off[:, :, None] * off[:, None, :])
    best = int(weights.argmax())
    extents = np.exp(mean)
    return Cuboid(centres[best], float(yaws[best]), extents, spread, kept[best][3])
