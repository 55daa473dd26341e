"""Fit an upright cuboid to the outlines of an object in all views, and to its few points.

Small, distant and half-occluded objects have few points, and most points in a box are background. An outline determines
where the object ends in each direction. A cuboid seen from several sides must fit all outlines, so the uncertainty of
its sides follows from the views. Its depth is determined by the points, each with the error of its rays, by the surface
that it stands on, and by the parallax of the outlines. Outlines and points have a common likelihood.

Edges at the border of an image or at an occluder are not used. Elsewhere, an edge may be inside the outline of the
object, where an occluder hides the rest, rather than outside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.geometry.mask_outlines import DIRECTIONS, Outlines
from metric_base.arrays import FloatArray

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
# Length and width at the start, relative to the width of the outlines, which show one or the other.
START_LENGTH = 1.25
START_WIDTH = 0.75
# Maximum number of steps of a fit.
MAX_STEPS = 40
# Relative decrease of the cost at which a fit ends.
COST_TOLERANCE = 1e-6
# Damping at the start, and the damping above which a fit ends.
DAMPING = 1e-2
MAX_DAMPING = 1e3
# Maximum change of a parameter in one step, in sizes, natural logarithms and radians.
MAX_PARAMETER_STEP = 0.4
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


# Outlines, points, and height and standard deviation of the foot.
_Data = tuple[Outlines, PointRays | None, tuple[float, float] | None]
# Cost, parameters (7,), covariance (7, 7) and misfit of a fit.
_Fit = tuple[float, FloatArray, FloatArray, float]


def fit_cuboid(
    outlines: Outlines,
    centre: FloatArray,
    yaw: float,
    foot: tuple[float, float] | None = None,
    points: PointRays | None = None,
    centre_sd: float | None = None,
) -> Cuboid:
    """Fit a cuboid by damped least squares with weights 1 / (1 + r^2 / c^2), from four values of the yaw.

    If several of them explain the outlines, the extents and their covariance refer to the mixture.

    Parameters
    ----------
    outlines : Outlines
    centre : (3,) ndarray of float
        Approximate centre in the level basis.
    yaw : float
        Approximate yaw in radians.
    foot : tuple of float, optional
        Height of the surface below the object and its standard deviation, in scene units.
    points : PointRays, optional
    centre_sd : float, optional
        Standard deviation of `centre` in scene units, if nothing else determines the distance of the object.
    """
    depth = (outlines.rotation @ centre + outlines.translation)[:, 2]
    is_ahead = depth > 0
    projections = outlines.max_projections
    spans = (projections[:, :2] + projections[:, 2:4])[is_ahead] * depth[is_ahead, None]  # (k, 2) width and height
    width, height = np.maximum(np.median(spans, axis=0), np.finfo(float).tiny) if is_ahead.any() else (1.0, 1.0)
    distance = float(np.median(np.linalg.norm(outlines.rotation @ centre + outlines.translation, axis=1)))
    size = float(np.sqrt(width * height))
    starts = np.array(
        [
            [*centre, yaw + turn, np.log(START_LENGTH * width), np.log(START_WIDTH * width), np.log(height)]
            for turn in np.arange(4) * np.pi / 4
        ]
    )
    fits = _fits((outlines, points, foot), starts, size, centre_sd or CENTRE_SD * distance)

    # Mixture of the fits, weighted by their costs, at the centre and yaw of the best one.
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


def ray_entry_depths(parameters: FloatArray, points: PointRays) -> tuple[FloatArray, FloatArray]:
    """Return the depth (k, n) at which each ray enters k cuboids with parameters (k, 7), and its path inside (k, n).

    A ray that misses a cuboid has a path of 0 and the mean of the two depths at which it is closest.
    """
    c, s = np.cos(parameters[:, 3, None]), np.sin(parameters[:, 3, None])
    x, y, z = points.eyes.T[:, None] - parameters.T[:3, :, None]  # (k, n) each
    p, q, r = points.rays.T
    halves = np.exp(parameters.T[4:, :, None]) / 2  # (3, k, 1)
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


def cuboid_projections(outlines: Outlines, parameters: FloatArray) -> FloatArray:
    """Return the largest projections (k, v, 8) of k cuboids on `DIRECTIONS` in each view.

    The parameters (k, 7) of a cuboid are its centre, yaw and log extents.
    """
    c, s = np.cos(parameters[:, 3]), np.sin(parameters[:, 3])  # (k,)
    x, y, z = UNIT_CORNERS.T[:, :, None] * np.exp(parameters.T[4:, None])  # (16, k) each
    world = np.array([c * x - s * y, s * x + c * y, z]) + parameters.T[:3, None]  # (3, 16, k)
    rotation = outlines.rotation.transpose(1, 2, 0)  # (3, 3, v)
    camera = world.reshape(3, -1).T @ rotation + outlines.translation.T[:, None]  # (3, 16 k, v)
    # Corners behind the camera are far to the side.
    image = camera[:2] / np.maximum(camera[2], 1e-3 * np.abs(camera).max())
    furthest = (DIRECTIONS @ image.reshape(2, len(UNIT_CORNERS), -1).transpose(1, 0, 2)).max(axis=0)  # (8, k v)
    return np.asarray(furthest.reshape(len(DIRECTIONS), len(parameters), -1).transpose(1, 2, 0))


def _fits(data: _Data, starts: FloatArray, size: float, centre_sd: float) -> list[_Fit]:
    """Fit cuboids of about `size` from several parameters `starts` (s, 7), all of them in each step."""
    unit = np.array([size, size, size, 1, 1, 1, 1])
    step, max_change = 1e-3 * unit, MAX_PARAMETER_STEP * unit
    prior_sd = np.array([*[centre_sd] * 3, YAW_SD, *SIDE_SD])
    prior_precision = np.diag(prior_sd**-2)
    n = len(starts)
    trials, best = starts.copy(), starts.copy()
    best_costs, damping, misfits = np.full(n, np.inf), np.full(n, DAMPING), np.ones(n)
    normals, gradients = np.tile(prior_precision, (n, 1, 1)), np.zeros((n, 7))
    rows = np.arange(n)  # of the fits that have not ended
    for _ in range(MAX_STEPS):
        jacobian, weight, residual, loss = _residuals(data, trials[rows], step)
        change = (trials[rows] - starts[rows]) / prior_sd
        costs = loss + (change**2).sum(axis=1)
        is_better = costs < best_costs[rows]
        gain = best_costs[rows] - costs
        is_done = np.where(is_better, gain < COST_TOLERANCE * np.maximum(costs, 1.0), damping[rows] > MAX_DAMPING)
        damping[rows] = np.where(is_better, damping[rows] / 3, damping[rows] * 10)
        better = rows[is_better]
        best[better], best_costs[better] = trials[better], costs[is_better]
        transposed = jacobian[is_better].transpose(0, 2, 1)
        weighted = weight[is_better, :, None] * np.concatenate([jacobian, residual[:, :, None]], axis=2)[is_better]
        products = transposed @ weighted  # (b, 7, 8)
        normals[better] = products[:, :, :7] + prior_precision
        gradients[better] = products[:, :, 7] + change[is_better] / prior_sd
        squares, total = (weight * residual**2).sum(axis=1), weight.sum(axis=1)
        misfits[better] = np.sqrt(squares / np.maximum(total, 1.0))[is_better]
        rows = rows[~is_done]
        if not len(rows):
            break
        damped = normals[rows] + np.eye(7) * (damping[rows, None, None] * normals[rows])
        changes = -np.linalg.solve(damped, gradients[rows, :, None])[:, :, 0]
        trials[rows] = best[rows] + np.clip(changes, -max_change, max_change)
    return list(zip(best_costs.tolist(), best, np.linalg.inv(normals), misfits.tolist(), strict=True))


def _residuals(
    data: _Data, parameters: FloatArray, step: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return Jacobians (s, m, 7), weights (s, m), residuals (s, m) and robust costs (s,) at `parameters` (s, 7).

    The Jacobian is by finite differences of size `step` (7,).
    """
    outlines, points, foot = data
    n = len(parameters)
    trials = (parameters[:, None] + np.vstack([np.zeros(7), np.diag(step)])).reshape(-1, 7)
    # 1. Outlines.
    projections = (cuboid_projections(outlines, trials) / outlines.sigma).reshape(n, 8, -1)
    residual = projections[:, 0] - (outlines.max_projections / outlines.sigma).ravel()
    jacobian = ((projections[:, 1:] - projections[:, :1]) / step[:, None]).transpose(0, 2, 1)
    is_slack = (residual > 0) & np.tile(DIAGONAL, len(outlines.max_projections))
    slack = np.where(is_slack, 1 / CORNER_SLACK_FACTOR, 1.0)
    residual, jacobian = residual * slack, jacobian * slack[:, :, None]
    half = np.where(residual > 0, INSIDE_HALF_WEIGHT_SIGMAS, OUTSIDE_HALF_WEIGHT_SIGMAS)
    view_weight = min(1.0, MAX_INDEPENDENT_VIEWS / len(outlines.max_projections))
    parts = [(jacobian, residual, half, view_weight * outlines.is_free.ravel())]
    # 2. Points, against the faces where their rays enter.
    if points is not None and len(points.depths):
        enter, inside = (depths.reshape(n, 8, -1) for depths in ray_entry_depths(trials, points))
        is_behind = points.depths > enter[:, 0]
        sigma = np.hypot(points.sigma, np.where(is_behind, HOLLOW_FRACTION * inside[:, 0], 0.0))
        residual = (enter[:, 0] - points.depths) / sigma
        jacobian = ((enter[:, 1:] - enter[:, :1]) / (sigma[:, None] * step[:, None])).transpose(0, 2, 1)
        half = np.where(is_behind, BEHIND_HALF_WEIGHT_SIGMAS, FRONT_HALF_WEIGHT_SIGMAS)
        count = len(points.depths)
        parts.append((jacobian, residual, half, np.full(count, min(1.0, MAX_INDEPENDENT_POINTS / count))))
    # 3. Foot.
    if foot is not None:
        height = np.exp(parameters[:, 6])
        jacobian = np.zeros((n, 1, 7))
        jacobian[:, 0, 2], jacobian[:, 0, 6] = 1 / foot[1], -height / 2 / foot[1]
        residual = ((parameters[:, 2] - height / 2 - foot[0]) / foot[1])[:, None]
        parts.append((jacobian, residual, np.full((n, 1), OUTSIDE_HALF_WEIGHT_SIGMAS), np.ones(1)))
    jacobians, residuals, halves = (np.concatenate([part[k] for part in parts], axis=1) for k in range(3))
    counts = np.concatenate([part[3] for part in parts])
    weights = counts / (1 + (residuals / halves) ** 2)
    costs = (counts * halves**2 * np.log1p((residuals / halves) ** 2)).sum(axis=1)
    return jacobians, weights, residuals, costs
