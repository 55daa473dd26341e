"""The vertical of a cloud: from the cameras and all level surfaces together; where these scatter, its sigma is wider.

Walls spread evenly over heights and level surfaces pile up at one, so the right vertical is the one whose histogram of
heights is most peaked. Near it every surface has a plane of its own, and is level but for its own slope. The camera and
the surfaces are then combined by their covariances; if they scatter by more than these say, the sum is as doubtful.

Up: the vertical of a scene, from the cameras and then from the planes in it (paper section 4.2).

The paper takes the unit vector most orthogonal to all camera x axes. That is undefined when the cameras hardly turn, so
the eigen-gap decides: where it is too small only the direction across the x axes is known, the mean camera up fills in
the rest, and a level surface of the scene settles it where there is one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from estimator.geometry.planes import (
    HALF_THICKNESS_BINS,
    MIN_POINTS,
    SMOOTHING_BINS,
    height_bin,
    level_basis,
    one_per_cell,
    peaks,
)
from estimator.records.objects import Up
from estimator.records.scene import SceneProblem, View
from metric_base.arrays import BoolArray, FloatArray
from metric_base.errors import InputError

# People hold a camera level within about two degrees from frame to frame; fewer views than would show that
# spread cannot prove a better one.
ROLL_DEG = 2.0
# Neighbouring frames of a video lean together: about four make one independent reading.
FRAMES_PER_READING = 4.0
# Beyond this the vertical from x axes is worse than the mean camera up with a level surface: a height of a metre-wide
# object is then off by a tenth.
OBSERVABLE_DEG = 6.0
# Pitch of hand-held cameras: they look down on objects by some 15 degrees, and the mean camera up leans by as much.
PITCH_DEG = 15.0
# Gravity by an inertial unit is good to some tenths of a degree at rest, and to about this on a moving hand.
GIVEN_DEG = 1.0
# Two verticals within this tilt, in their standard deviations, are believed to be one.
BELIEVED_SIGMAS = 3.0
#: How the methods begin by which the vertical is observed, or given: not guessed from how people hold cameras.
OBSERVED_METHODS = ("camera-x-axes", "given")
#: Heights along an up that is so far off are a seventh short, or take in the sides: no scale follows from them.
WRONG_UP_DEG = 30.0
MAX_SEARCH_POINTS = 6_000
# A surface is thinner than a height bin: with bins of this share of it the sharpest vertical is 0.2 degrees off in the
# median where a floor has few points, 0.7 with whole bins (hard synthetic rooms, seeds 1100 to 1103).
FINE_BIN = 0.25
# Sums of this power of the counts are of a few full bins; sums of squares are of all bins that are not empty.
POWER = 3
# Steps of the search to either side, and the widest tilt that they cover with fine bins. A wider search, of cameras
# that hardly turn, begins with whole bins.
STEPS, WIDEST_DEG = 12, 15.0
# One point in so many at either end is a stray.
STRAYS = 200
# Roll of a hand-held camera about a known horizontal axis, and where the search from the best of the grid ends.
KNOWN_DEG, FINEST_DEG = 1.0, 0.05
# A peak twice as sharp outweighs a tilt of two and a half standard deviations.
BELIEF_WEIGHT = 0.2
# The window about a plane cuts a tilted surface short, so each fit goes part of the way.
ROUNDS = 12
# Bins of the planes' own fits, in height bins: thinner than for support planes, so that what lies on one takes no part.
FIT_BIN = 0.5
# A fit that ends further from the start than this is of a slope or a wall.
MOST_SLOPE_DEG = 8.0
# Errors of neighbouring points go together: every tenth counts as one of its own.
POINTS_PER_READING = 10.0
# However many points a level surface has, reconstructions bend by about a hundredth of their width and floors slope a
# little; a surface of a part of the scene's width slopes by as much more. With 0.7, 80 to 97 % of hard synthetic rooms
# with tilted tables (seeds 1100 to 1103) are within 1.5 standard deviations.
SLOPE_DEG = 0.7
# What no scatter shows: all surfaces bend alike.
COMMON_DEG = 0.3


def camera_up(views: Sequence[View]) -> Up:
    """Up from the cameras alone.

    Equation: n = argmin |R x| over unit x, R the (v, 3) camera x axes; n is the eigenvector of the smallest eigenvalue
    of R^T R. Its tilt towards eigenvector j has variance k roll^2 / (lambda_j - lambda_1), k frames making one reading,
    so the gap to the second eigenvalue decides. The sign is that of the mean camera up. Without views: ValueError.
    """
    if not views:
        raise ValueError("up needs at least one view")
    x_axes = np.stack([view.rotation[0] for view in views])
    mean_up = -np.mean([view.rotation[1] for view in views], axis=0)
    values, vectors = np.linalg.eigh(x_axes.T @ x_axes)
    roll = max(np.sqrt(max(values[0], 0.0) / max(len(views) - 2, 1)), np.radians(ROLL_DEG))
    sigma = np.degrees(roll * np.sqrt(FRAMES_PER_READING / max(values[1] - values[0], 1e-12)))
    normal = vectors[:, 0]
    if sigma <= OBSERVABLE_DEG and abs(normal @ mean_up) > 0.5 * np.linalg.norm(mean_up):
        return Up(normal * np.sign(normal @ mean_up), "camera-x-axes", float(sigma))
    return _mean_up(mean_up, vectors[:, 2])


def up_from_vector(vector: Sequence[float] | FloatArray) -> Up:
    """Up that is known from outside, such as from an inertial unit: a vector (3,) of any length but 0.

    Raises
    ------
    InputError
        It is not three finite numbers, or all are 0.
    """
    direction = np.asarray(vector, dtype=float)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        raise InputError.at("up", "direction", "three finite numbers, not all 0", tuple(vector))
    direction = direction / np.abs(direction).max()  # its square may be no number
    return Up(direction / np.linalg.norm(direction), "given", GIVEN_DEG)


def up_problems(given: Up, seen: Up) -> tuple[SceneProblem, ...]:
    """Return the contradiction between a given vertical and that of the cameras and level surfaces, if there is one."""
    if seen.method == "none":
        return ()
    angle = float(np.degrees(np.arccos(np.clip(given.vector @ seen.vector, -1, 1))))
    limit = BELIEVED_SIGMAS * float(np.hypot(given.sigma_deg, seen.sigma_deg))
    if angle <= limit:
        return ()
    if 180 - angle <= limit:
        return (SceneProblem(f"the given up points down ({seen.method}): gravity points down, up is its opposite"),)
    sentence = f"the given up is {angle:.0f}° from what the scene shows ({seen.method}, ±{seen.sigma_deg:.1f}°)"
    return (SceneProblem(sentence, min(angle, 180 - angle) > WRONG_UP_DEG + limit),)


def _mean_up(mean_up: FloatArray, x_axis: FloatArray) -> Up:
    """Mean camera up (3,) made orthogonal to the common x axis (3,); scattered cameras leave it wide open."""
    across = mean_up - (mean_up @ x_axis) * x_axis
    length = float(np.linalg.norm(across))
    if length < 0.1:
        return Up(
            np.cross(x_axis, [1.0, 0, 0]) if abs(x_axis[0]) < 0.9 else np.cross(x_axis, [0, 1.0, 0]), "none", 90.0
        )
    return Up(across / length, "mean-camera-up", PITCH_DEG, x_axis)


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    """A plane fitted to points of its own: unit normal (3,), the points' standard deviations (3,) along `axes` (3, 3).

    The first axis is the normal; rows : (n,) which points.
    """

    normal: FloatArray
    spread: FloatArray
    axes: FloatArray
    rows: BoolArray


def refine_up(up: Up, points: FloatArray) -> Up:
    """Up after the level surfaces of the cloud (n, 3); the same where there is none to believe."""
    thin = one_per_cell(points)
    if len(thin) < MIN_POINTS or up.method == "none":
        return up
    bin_width = height_bin(thin @ up.vector)
    start = _most_peaked(up, thin[:: -(-len(thin) // MAX_SEARCH_POINTS)], bin_width)
    surfaces = _surfaces(start, thin, bin_width)
    return _combine(up, start, surfaces, thin) if surfaces else up


def _most_peaked(up: Up, points: FloatArray, bin_width: float) -> FloatArray:
    """(3,) the vertical near `up` whose histogram of heights is most peaked, the cameras' own belief counted in."""
    basis = level_basis(up.vector)
    known = up.known if up.known is not None else basis[0]
    known = known - (known @ up.vector) * up.vector
    known /= np.linalg.norm(known)
    # the tilt about the known axis is open by sigma, the other one by the roll of a hand-held camera
    sigma = np.array([up.sigma_deg, KNOWN_DEG if up.known is not None else up.sigma_deg])
    axes = np.stack([np.cross(known, up.vector), known])
    middle, reach = np.zeros(2), BELIEVED_SIGMAS * sigma
    for width in (bin_width, FINE_BIN * bin_width) if reach[0] > WIDEST_DEG else (FINE_BIN * bin_width,):
        steps = np.linspace(-1, 1, 2 * STEPS + 1)
        grid = middle + np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2) * reach
        middle = grid[_sharpness(grid, sigma, up.vector, axes, points, width).argmax()]
        reach = np.minimum(reach, WIDEST_DEG)
    step = float(reach.max()) / STEPS
    while step > FINEST_DEG:
        around = middle + step * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        best = int(_sharpness(around, sigma, up.vector, axes, points, FINE_BIN * bin_width).argmax())
        middle, step = around[best], step / (1 if best else 2)
    return np.asarray(_directions(up.vector, axes, middle[None])[0])


def _directions(up: FloatArray, axes: FloatArray, degrees: FloatArray) -> FloatArray:
    """(k, 3) unit vectors that lean from `up` along the two `axes` (2, 3) by angles (k, 2)."""
    leaning = up + np.tan(np.radians(degrees)) @ axes
    return np.asarray(leaning / np.linalg.norm(leaning, axis=1, keepdims=True))


def _sharpness(
    degrees: FloatArray, sigma: FloatArray, up: FloatArray, axes: FloatArray, points: FloatArray, bin_width: float
) -> FloatArray:
    """(k,) how peaked the heights of the points (n, 3) are along each of the tilts (k, 2), and how likely these are."""
    score = np.empty(len(degrees))
    for row, vector in enumerate(_directions(up, axes, degrees)):
        heights = points @ vector
        ends = len(heights) // STRAYS
        heights = np.partition(heights, (ends, -1 - ends))[ends : len(heights) - ends]
        counts = np.bincount(((heights - heights[0]) / bin_width).astype(np.int64))
        sharp = gaussian_filter1d(counts.astype(float), SMOOTHING_BINS, mode="constant")
        score[row] = 2 / POWER * np.log((sharp**POWER).sum())
    return np.asarray(score - BELIEF_WEIGHT / 2 * np.square(degrees / sigma).sum(axis=1))


def _surfaces(start: FloatArray, points: FloatArray, bin_width: float) -> list[_Surface]:
    """The planes near level of points (n, 3) at the peaks of their heights along `start` (3,), those of most first.

    A surface that leans is no peak in fine bins, and one with things on it no plane in coarse ones.
    """
    widths = (bin_width, FIT_BIN * bin_width)
    fits = [
        _fit(start, height, points, width, widths[1]) for width in widths for height in peaks(points @ start, width)
    ]
    kept: list[_Surface] = []
    for fit in sorted((fit for fit in fits if fit is not None), key=lambda one: -np.count_nonzero(one.rows)):
        # two peaks may be one surface
        if all(2 * np.count_nonzero(fit.rows & other.rows) < np.count_nonzero(fit.rows) for other in kept):
            kept.append(fit)
    return kept


def _fit(start: FloatArray, height: float, points: FloatArray, first: float, last: float) -> _Surface | None:
    """The plane of points (n, 3) about a height along `start` (3,), its normal free; None if it is not near level.

    first, last : bin widths of the window about the plane in the first and the last round
    """
    normal, centre = start, height * start
    for width in np.geomspace(first, last, ROUNDS):
        rows = np.abs((points - centre) @ normal) < HALF_THICKNESS_BINS * width
        if np.count_nonzero(rows) < MIN_POINTS:
            return None
        centre = points[rows].mean(axis=0)
        values, vectors = np.linalg.eigh(np.cov(points[rows].T))
        normal = vectors[:, 0] * np.sign(vectors[:, 0] @ start)
    if normal @ start < np.cos(np.radians(MOST_SLOPE_DEG)):
        return None
    return _Surface(normal, np.sqrt(np.maximum(values, 0.0)), vectors.T, rows)


def _combine(up: Up, start: FloatArray, surfaces: list[_Surface], points: FloatArray) -> Up:
    """Up from the cameras and the surfaces among the points (n, 3), by their covariances.

    Equation: with x_k the tilt of cue k against `start` (3,) and C_k its covariance, x = S sum C_k^-1 x_k and S = (sum
    C_k^-1)^-1, times the sum of (x_k - x)^T C_k^-1 (x_k - x) over 2 (k - 1) where that is more than 1 (Birge 1932). A
    surface's C is along each of its axes (flatness / width)^2 / readings + (0.7 degrees, times the scene's width over
    its own if that is larger)^2.
    """
    basis = level_basis(start)
    across = np.percentile(points @ basis[:2].T, [84, 16], axis=0)
    width = float(np.sqrt(np.prod(across[0] - across[1])) / 2)
    tilts = [
        np.degrees(basis[:2] @ normal / (basis[2] @ normal)) for normal in (up.vector, *(s.normal for s in surfaces))
    ]
    precisions = [np.eye(2) / up.sigma_deg**2]
    for one in surfaces:
        readings = max(np.count_nonzero(one.rows) / POINTS_PER_READING, 1.0)
        fitted = np.degrees(one.spread[0] / one.spread[1:] / np.sqrt(readings))
        sloping = SLOPE_DEG * np.maximum(width / one.spread[1:], 1.0)
        sides = one.axes[1:] @ basis[:2].T
        precisions.append(np.linalg.inv((sides.T * (fitted**2 + sloping**2)) @ sides))
    covariance = np.linalg.inv(sum(precisions))
    tilt = covariance @ sum(own @ x for own, x in zip(precisions, tilts, strict=True))
    scatter = sum(float((x - tilt) @ own @ (x - tilt)) for own, x in zip(precisions, tilts, strict=True))
    variance = np.trace(covariance) / 2 * max(scatter / (2 * len(surfaces)), 1.0)
    vector = _directions(start, basis[:2], tilt[None])[0]
    return Up(vector, f"{up.method}+plane", float(np.sqrt(variance + COMMON_DEG**2)))
