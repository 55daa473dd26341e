"""Fit an upright cuboid to the outlines of an object in all views, and to its few points.

Small, distant and half-occluded objects have few points, and most points in a box are background. An outline determines
where the object ends in each direction. A cuboid seen from several sides must fit all outlines, so the uncertainty of
its sides follows from the views. Its depth is determined by the points, each with the error of its rays, by the surface
that it stands on, and by the parallax of the outlines. Outlines and points have a common likelihood.

Edges at the border of an image or at an occluder are not used. Elsewhere, an edge may be inside the outline of the
object, where an occluder hides the rest, rather than outside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from estimator.geometry.mask_outlines import DIRECTIONS, Outlines
from metric_base.arrays import FloatArray, IntArray

# Factor of the tolerance for an outline inside the cuboid in the diagonal directions: objects do not fill the
# corners of their cuboid.
CORNER_SLACK_FACTOR = 3.0
DIAGONAL = np.arange(len(DIRECTIONS)) >= 4
# Residual in standard deviations at which an edge has half of its weight: inside the outline of the cuboid, where the
# object may be occluded, and outside.
INSIDE_HALF_WEIGHT_SIGMAS = 1.5
OUTSIDE_HALF_WEIGHT_SIGMAS = 2.5
# The same for a point in front of the face of the cuboid, and behind it: masks include a part of the wall behind.
FRONT_HALF_WEIGHT_SIGMAS = 2.5
BEHIND_HALF_WEIGHT_SIGMAS = 1.5
# Distance of a point behind the face where its ray enters, relative to the path of the ray in the cuboid: objects have
# hollows.
HOLLOW_FRACTION = 0.3
# Maximum number of independent points: points of one object in the same views have common errors.
MAX_INDEPENDENT_POINTS = 8
# Maximum number of independent views: the deviations of the object from a cuboid are the same in adjacent views.
MAX_INDEPENDENT_VIEWS = 4
# Fraction of half a side at which the corners of a footprint are cut off: an octagon between rectangle and ellipse.
CORNER = 0.75
# Corners (16, 3) of the prism over this octagon, with unit sides.
UNIT_CORNERS = np.array(
    [
        (x * a / 2, y * b / 2, z)
        for a, b in ((1, CORNER), (CORNER, 1))
        for x in (1, -1)
        for y in (1, -1)
        for z in (-0.5, 0.5)
    ]
)
# Standard deviation of the log sides around the start: single outlines determine them within a factor of 1.8.
SIDE_SD = (0.6, 0.6, 0.5)
# Standard deviation of the centre around the start, relative to its distance: it is somewhere in front of the cameras.
CENTRE_SD = 0.7
# Standard deviation of the yaw around the start, in radians.
YAW_SD = 2.0
# Length and width at the start, relative to the width of the outlines, which show one or the other. Few outlines leave
# the width near its start, so their ratio is the geometric mean of that of objects in hard synthetic rooms (0.71; seeds
# 1000 to 1003). With 0.6, their widths were too small by 0.05 (median, natural log).
START_LENGTH = 1.2
START_WIDTH = 0.85
# Maximum number of steps of a fit.
MAX_STEPS = 40
# Relative decrease of the cost at which a fit ends.
COST_TOLERANCE = 1e-6
# Damping at the start, and the damping above which a fit ends.
DAMPING = 1e-2
MAX_DAMPING = 1e3
# Maximum change of a parameter in one step, in sizes, natural logarithms and radians.
MAX_PARAMETER_STEP = 0.4
# Values of the yaw at the starts, relative to the approximate one, in radians.
START_TURNS = np.arange(4) * np.pi / 4
# Maximum number of views of all problems of a batch; its projections take about 10 kB per view and start.
MAX_BATCH_VIEWS = 400
# Minimum difference from the lowest cost at which a start is discarded: it does not explain the outlines.
MIN_WORSE_COST = 12.0


@dataclass(frozen=True, slots=True, eq=False)
class PointRays:
    """Points of an object, each on one line of sight, in the level basis."""

    eyes: FloatArray  #: (n, 3)
    rays: FloatArray  #: (n, 3) unit vectors.
    depths: FloatArray  #: (n,) distance along the ray, in scene units.
    sigma: FloatArray  #: (n,) standard deviation of the depth.


@dataclass(frozen=True, slots=True, eq=False)
class Cuboid:
    """An upright cuboid in the level basis."""

    centre: FloatArray  #: (3,)
    yaw: float  #: In radians.
    extents: FloatArray  #: (3,) length >= width, height.
    covariance: FloatArray  #: (3, 3) of the log extents.
    misfit: float  #: Root mean square of the weighted residuals.


# Cost, parameters (7,), covariance (7, 7) and misfit of a fit.
_Fit = tuple[float, FloatArray, FloatArray, float]


@dataclass(frozen=True, slots=True, eq=False)
class CuboidProblem:
    """Data about an object to which a cuboid is fitted."""

    outlines: Outlines
    centre: FloatArray  #: (3,) approximate centre in the level basis.
    yaw: float  #: Approximate yaw in radians.
    foot: tuple[float, float] | None = None  #: Height of the surface below the object, and its standard deviation.
    points: PointRays | None = None
    centre_sd: float | None = None  #: Standard deviation of `centre`, if nothing else determines the distance.


@dataclass(frozen=True, slots=True, eq=False)
class _Batch:
    """Data of the fits of several problems, padded to v views and n points; padding has no weight."""

    rotation: FloatArray  #: (f, v, 3, 3)
    translation: FloatArray  #: (f, v, 3)
    projections: FloatArray  #: (f, v, 8) `max_projections`.
    projection_sigma: FloatArray  #: (f, v, 8)
    eyes: FloatArray  #: (f, n, 3)
    rays: FloatArray  #: (f, n, 3)
    depths: FloatArray  #: (f, n)
    depth_sigma: FloatArray  #: (f, n)
    foot: FloatArray  #: (f, 2)
    counts: (
        FloatArray  #: (f, 8 v + n + 1) numbers of independent observations that outlines, points and foot count for.
    )

    def take(self, rows: IntArray) -> _Batch:
        """Return the fits of some `rows` (k,)."""
        return _Batch(*(getattr(self, field.name)[rows] for field in fields(self)))


def fit_cuboids(problems: Sequence[CuboidProblem]) -> list[Cuboid]:
    """Fit cuboids by damped least squares with weights 1 / (1 + r^2 / c^2), from four values of the yaw.

    Problems with similar numbers of views and points are fitted together, because a fit is too small for NumPy alone.
    """
    sizes = [
        (len(problem.outlines.sigma), 0 if problem.points is None else len(problem.points.depths))
        for problem in problems
    ]
    order = sorted(range(len(problems)), key=lambda row: sizes[row])
    cuboids: dict[int, Cuboid] = {}
    while order:
        n_views = sizes[order[-1]][0]
        count = max(1, MAX_BATCH_VIEWS // n_views)
        rows, order = order[-count:], order[:-count]
        cuboids.update(zip(rows, _batch_cuboids([problems[row] for row in rows]), strict=True))
    return [cuboids[row] for row in range(len(problems))]


def _batch_cuboids(problems: Sequence[CuboidProblem]) -> list[Cuboid]:
    """Fit the cuboids of a batch of problems."""
    starts, sizes, centre_sds = [], [], []
    for problem in problems:
        outlines, centre = problem.outlines, problem.centre
        depth = (outlines.rotation @ centre + outlines.translation)[:, 2]
        is_ahead = depth > 0
        projections = outlines.max_projections
        spans = (projections[:, :2] + projections[:, 2:4])[is_ahead] * depth[is_ahead, None]  # (k, 2) width and height
        width, height = np.maximum(np.median(spans, axis=0), np.finfo(float).tiny) if is_ahead.any() else (1.0, 1.0)
        distance = float(np.median(np.linalg.norm(outlines.rotation @ centre + outlines.translation, axis=1)))
        sides = np.log([START_LENGTH * width, START_WIDTH * width, height])
        starts += [[*centre, problem.yaw + turn, *sides] for turn in START_TURNS]
        sizes.append(float(np.sqrt(width * height)))
        centre_sds.append(problem.centre_sd or CENTRE_SD * distance)
    n = len(START_TURNS)
    fits = _fits(_padded(problems), np.array(starts), np.repeat(sizes, n), np.repeat(centre_sds, n))
    return [_mixture(fits[n * row : n * (row + 1)]) for row in range(len(problems))]


def _mixture(fits: list[_Fit]) -> Cuboid:
    """Return the cuboid of fits from several starts: if several explain the outlines, the moments of their mixture."""
    fits = [fit for fit in fits if np.isfinite(fit[0])] or fits[:1]  # no yaw explains invalid cameras
    lowest = min(fit[0] for fit in fits)
    fits = [fit for fit in fits if not fit[0] - lowest >= MIN_WORSE_COST]
    weights = np.array([np.exp(-(fit[0] - lowest) / 2) if np.isfinite(lowest) else 1.0 for fit in fits])
    weights /= weights.sum()
    logs, covariances, yaws = [], [], []
    for _, parameters, covariance, misfit in fits:
        order = [4, 5, 6] if parameters[4] >= parameters[5] else [5, 4, 6]
        logs.append(parameters[order])
        covariances.append(covariance[np.ix_(order, order)] * max(misfit, 1.0) ** 2)
        yaws.append(parameters[3] + (0.0 if order[0] == 4 else np.pi / 2))
    mean = weights @ np.array(logs)
    offsets = np.array(logs) - mean
    covariance = np.einsum("k,kij->ij", weights, np.array(covariances) + offsets[:, :, None] * offsets[:, None, :])
    best = int(weights.argmax())
    return Cuboid(fits[best][1][:3], float(yaws[best]), np.exp(mean), covariance, fits[best][3])


def ray_entry_depths(eyes: FloatArray, rays: FloatArray, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the depths (f, k, n) at which rays (f, n, 3) enter cuboids (f, k, 7), and their paths inside (f, k, n).

    A ray that misses a cuboid has a path of 0 and the mean of the two depths at which it is closest.
    """
    yaw = parameters[:, :, 3, None]
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = np.moveaxis(eyes[:, None] - parameters[:, :, None, :3], -1, 0)  # (f, k, n) each
    p, q, r = np.moveaxis(rays[:, None], -1, 0)
    halves = np.moveaxis(np.exp(parameters[:, :, None, 4:]) / 2, -1, 0)  # (3, f, k, 1)
    enter, leave = np.array(-np.inf), np.array(np.inf)
    # Along each axis of the cuboids, one after the other.
    for start, ray, half in zip(
        (c * x + s * y, c * y - s * x, z), (c * p + s * q, c * q - s * p, r), halves, strict=True
    ):
        slope = np.where(np.abs(ray) < 1e-9, 1e-9, ray)
        low, high = (-half - start) / slope, (half - start) / slope
        enter, leave = np.maximum(enter, np.minimum(low, high)), np.minimum(leave, np.maximum(low, high))
    is_miss = enter > leave
    return np.where(is_miss, (enter + leave) / 2, enter), np.where(is_miss, 0.0, leave - enter)


def cuboid_projections(rotation: FloatArray, translation: FloatArray, parameters: FloatArray) -> FloatArray:
    """Return the largest projections (f, k, v, 8) of cuboids (f, k, 7) on `DIRECTIONS` in views.

    The views have rotations (f, v, 3, 3) and translations (f, v, 3). The parameters of a cuboid are its centre, yaw and
    log extents.
    """
    n_fits, n_views = translation.shape[:2]
    yaw = parameters[:, :, 3, None]
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = np.moveaxis(UNIT_CORNERS * np.exp(parameters[:, :, None, 4:]), -1, 0)  # (f, k, 16) each
    world = np.stack([c * x - s * y, s * x + c * y, z], axis=-1) + parameters[:, :, None, :3]
    camera = world.reshape(n_fits, -1, 3) @ rotation.reshape(n_fits, -1, 3).transpose(0, 2, 1)
    camera = camera.reshape(*world.shape[:3], n_views, 3) + translation[:, None, None]
    # Corners behind the camera are far to the side.
    furthest = 1e-3 * np.abs(camera).max(axis=(1, 2, 3, 4), keepdims=True)
    image = camera[..., :2] / np.maximum(camera[..., 2:], furthest)
    along = image.reshape(-1, 2) @ DIRECTIONS.T  # as one product, which is faster than many small ones
    return np.asarray(along.reshape(*image.shape[:-1], -1).max(axis=2))


def _padded(problems: Sequence[CuboidProblem]) -> _Batch:
    """Return the data of the fits of problems from `START_TURNS`."""
    n_views = max(len(problem.outlines.sigma) for problem in problems)
    n_points = max(0 if problem.points is None else len(problem.points.depths) for problem in problems)
    rows: list[tuple[FloatArray, ...]] = []
    for problem in problems:
        outlines, points = problem.outlines, problem.points
        own = len(outlines.sigma)
        views = np.minimum(np.arange(n_views), own - 1)  # padding repeats the last view
        free = outlines.is_free[views] * min(1.0, MAX_INDEPENDENT_VIEWS / own)
        free[own:] = 0.0
        if points is None:
            points = PointRays(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0))
        known = len(points.depths)
        more = (0, n_points - known)
        counted = np.pad(np.full(known, min(1.0, MAX_INDEPENDENT_POINTS / max(known, 1))), more)
        foot, has_foot = ((0.0, 1.0), 0.0) if problem.foot is None else (problem.foot, 1.0)
        rows.append(
            (
                outlines.rotation[views],
                outlines.translation[views],
                outlines.max_projections[views],
                outlines.sigma[views],
                np.pad(points.eyes, (more, (0, 0))),
                np.pad(points.rays, (more, (0, 0)), constant_values=1.0),
                np.pad(points.depths, more, constant_values=1.0),
                np.pad(points.sigma, more, constant_values=1.0),
                np.array(foot),
                np.concatenate([free.ravel(), counted, [has_foot]]),
            )
        )
    return _Batch(*(np.repeat(np.stack(column), len(START_TURNS), axis=0) for column in zip(*rows, strict=True)))


def _fits(batch: _Batch, starts: FloatArray, sizes: FloatArray, centre_sds: FloatArray) -> list[_Fit]:
    """Fit f cuboids of about `sizes` (f,) from the parameters `starts` (f, 7), all of them in each step."""
    n = len(starts)
    units = np.ones((n, 7))
    units[:, :3] = sizes[:, None]
    prior_sd = np.tile([0.0, 0.0, 0.0, YAW_SD, *SIDE_SD], (n, 1))
    prior_sd[:, :3] = centre_sds[:, None]
    prior_precision = np.eye(7) * prior_sd[:, :, None] ** -2
    trials, best = starts.copy(), starts.copy()
    best_costs, damping, misfits = np.full(n, np.inf), np.full(n, DAMPING), np.ones(n)
    normals, gradients = prior_precision.copy(), np.zeros((n, 7))
    rows, data = np.arange(n), batch  # of the fits that have not ended
    for _ in range(MAX_STEPS):
        jacobian, weight, residual, loss = _residuals(data, trials[rows], 1e-3 * units[rows])
        change = (trials[rows] - starts[rows]) / prior_sd[rows]
        costs = loss + (change**2).sum(axis=1)
        is_better = costs < best_costs[rows]
        gain = best_costs[rows] - costs
        is_done = np.where(is_better, gain < COST_TOLERANCE * np.maximum(costs, 1.0), damping[rows] > MAX_DAMPING)
        damping[rows] = np.where(is_better, damping[rows] / 3, damping[rows] * 10)
        better = rows[is_better]
        best[better], best_costs[better] = trials[better], costs[is_better]
        weighted = weight[:, :, None] * np.concatenate([jacobian, residual[:, :, None]], axis=2)
        products = jacobian[is_better].transpose(0, 2, 1) @ weighted[is_better]  # (b, 7, 8)
        normals[better] = products[:, :, :7] + prior_precision[better]
        gradients[better] = products[:, :, 7] + change[is_better] / prior_sd[better]
        squares, total = (weight * residual**2).sum(axis=1), weight.sum(axis=1)
        misfits[better] = np.sqrt(squares / np.maximum(total, 1.0))[is_better]
        if is_done.any():
            rows, data = rows[~is_done], data.take(np.flatnonzero(~is_done))
        if not len(rows):
            break
        damped = normals[rows] + np.eye(7) * (damping[rows, None, None] * normals[rows])
        changes = -np.linalg.solve(damped, gradients[rows, :, None])[:, :, 0]
        limits = MAX_PARAMETER_STEP * units[rows]
        trials[rows] = best[rows] + np.clip(changes, -limits, limits)
    return list(zip(best_costs.tolist(), best, np.linalg.inv(normals), misfits.tolist(), strict=True))


def _residuals(
    batch: _Batch, parameters: FloatArray, step: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return Jacobians (f, m, 7), weights (f, m), residuals (f, m) and robust costs (f,) at `parameters` (f, 7).

    The Jacobian is by finite differences of size `step` (f, 7).
    """
    n = len(parameters)
    trials = parameters[:, None] + np.concatenate([np.zeros((n, 1, 7)), np.eye(7) * step[:, None]], axis=1)
    # 1. Outlines.
    projections = cuboid_projections(batch.rotation, batch.translation, trials) / batch.projection_sigma[:, None]
    residual = (projections[:, 0] - batch.projections / batch.projection_sigma).reshape(n, -1)
    jacobian = ((projections[:, 1:] - projections[:, :1]).reshape(n, 7, -1) / step[:, :, None]).transpose(0, 2, 1)
    is_slack = (residual > 0) & np.tile(DIAGONAL, batch.projections.shape[1])
    slack = np.where(is_slack, 1 / CORNER_SLACK_FACTOR, 1.0)
    residual, jacobian = residual * slack, jacobian * slack[:, :, None]
    half = np.where(residual > 0, INSIDE_HALF_WEIGHT_SIGMAS, OUTSIDE_HALF_WEIGHT_SIGMAS)
    parts = [(jacobian, residual, half)]
    # 2. Points, against the faces where their rays enter.
    enter, inside = ray_entry_depths(batch.eyes, batch.rays, trials)
    is_behind = batch.depths > enter[:, 0]
    sigma = np.hypot(batch.depth_sigma, np.where(is_behind, HOLLOW_FRACTION * inside[:, 0], 0.0))
    residual = (enter[:, 0] - batch.depths) / sigma
    jacobian = ((enter[:, 1:] - enter[:, :1]) / (sigma[:, None] * step[:, :, None])).transpose(0, 2, 1)
    half = np.where(is_behind, BEHIND_HALF_WEIGHT_SIGMAS, FRONT_HALF_WEIGHT_SIGMAS)
    parts.append((jacobian, residual, half))
    # 3. Foot.
    bottom, sigma = batch.foot.T
    height = np.exp(parameters[:, 6])
    jacobian = np.zeros((n, 1, 7))
    jacobian[:, 0, 2], jacobian[:, 0, 6] = 1 / sigma, -height / 2 / sigma
    residual = ((parameters[:, 2] - height / 2 - bottom) / sigma)[:, None]
    parts.append((jacobian, residual, np.full((n, 1), OUTSIDE_HALF_WEIGHT_SIGMAS)))
    jacobians, residuals, halves = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    weights = batch.counts / (1 + (residuals / halves) ** 2)
    costs = (batch.counts * halves**2 * np.log1p((residuals / halves) ** 2)).sum(axis=1)
    return jacobians, weights, residuals, costs
