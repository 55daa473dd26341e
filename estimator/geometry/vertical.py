"""Estimate the vertical of a scene from its cameras (paper section 4.2) and its level surfaces.

Cameras. The paper uses the unit vector most orthogonal to the x axes of all cameras. It is undefined if the cameras
hardly turn, so the gap between the eigenvalues decides. If it is too small, only the direction orthogonal to the mean x
axis is known, and the mean camera up is used within it.

Level surfaces. The heights of walls are spread evenly and those of level surfaces coincide, so the correct vertical has
the sharpest histogram of heights. Near it, a plane is fitted to each level surface. Cameras and surfaces are combined
by their covariances; if they scatter by more than these, the standard deviation is increased. The vertical departs from
the cameras' own only as far as each cloud supports.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from estimator.geometry.planes import (
    HALF_THICKNESS_BINS,
    MIN_POINTS,
    SMOOTHING_BINS,
    height_bin_width,
    height_peaks,
    level_basis,
)
from estimator.records.objects import Up
from estimator.records.scene import SceneProblem, View
from metric_base.arrays import BoolArray, FloatArray
from metric_base.errors import InputError

# Minimum standard deviation of the roll of a camera, in degrees. People hold a camera level within about two degrees,
# and a small scatter of few views may be due to chance.
ROLL_DEG = 2.0
# Number of frames per independent observation of the roll: the rolls of consecutive frames of a video are correlated.
FRAMES_PER_READING = 4.0
# Maximum standard deviation of a vertical from x axes, in degrees. Beyond it, the mean camera up with a level surface
# is better: the height of an object that is as wide as high is then off by a tenth.
OBSERVABLE_DEG = 6.0
# Standard deviation of the pitch of hand-held cameras, in degrees: they look down on objects by about this angle, and
# the mean camera up is tilted by as much.
PITCH_DEG = 15.0
# Minimum length of the mean camera up orthogonal to the x axis; a shorter one has no meaningful direction.
MIN_MEAN_UP = 0.1
# Minimum cosine of the angle between the mean line of sight and the axis around which cameras turn, and the maximum
# length of their mean up, for cameras that look straight down: 25 degrees, and turns over more than half a circle.
MIN_DOWNWARD_COSINE = 0.9
MAX_DOWNWARD_MEAN_UP = 0.5
# Minimum fraction of the points on a surface that the cameras look straight at, without any level surface: it is a
# wall, or the ground below an aircraft, and the vertical is open.
MIN_FACED_FRACTION = 0.3
# Standard deviation of a vertical from an inertial unit, in degrees: some tenths at rest, and about this in motion.
GIVEN_DEG = 1.0
# Maximum angle between two verticals that are the same, in standard deviations.
MAX_TILT_SIGMAS = 3.0
#: Prefixes of the methods in which the vertical is observed or given, not derived from how people hold cameras.
OBSERVED_METHODS = ("camera-x-axes", "given")
#: Maximum error in degrees of a usable given vertical. Beyond it, heights are a seventh too small, or include the
#: sides.
MAX_UP_ERROR_DEG = 30.0
# Maximum number of points for the search of the sharpest histogram.
MAX_SEARCH_POINTS = 6_000
# Width of a fine bin relative to a height bin: a surface is thinner than a height bin. With 0.25, the median error of
# the sharpest vertical is 0.2 degrees if a floor has few points, and 0.7 with 1 (hard synthetic rooms, seeds 1100 to
# 1103).
FINE_BIN = 0.25
# Exponent of the counts in the sharpness: a few full bins determine sums of cubes, all occupied bins sums of squares.
SHARPNESS_POWER = 3
# Number of steps of the search in each direction.
STEPS = 12
# Maximum tilt in degrees that is searched with fine bins only. A wider search, for cameras that hardly turn, begins
# with height bins.
MAX_FINE_DEG = 15.0
# The highest and the lowest 1 / TRIM_DENOMINATOR of the points are outliers.
TRIM_DENOMINATOR = 200
# Standard deviation in degrees of the roll of a hand-held camera about a known horizontal axis.
KNOWN_AXIS_DEG = 1.0
# Step in degrees at which the search ends.
MIN_STEP_DEG = 0.05
# Weight of the cameras' estimate in the search: a peak twice as sharp outweighs a tilt of 2.5 standard deviations.
CAMERA_PRIOR_WEIGHT = 0.2
# Number of rounds of a plane fit. The window around the plane truncates a tilted surface, so each round covers a part
# of the correction.
FIT_ROUNDS = 12
# Width of the bins of plane fits relative to a height bin, to exclude objects on the surface.
FIT_BIN = 0.5
# Maximum angle in degrees between the normal of a level surface and the start; a larger one is a slope or a wall.
MAX_SLOPE_DEG = 8.0
# Squared distance of the cameras' vertical from the result, in their covariance, above which it enters the stated
# error: the mean of consistent cameras. On a steep street, the cameras are right and its surface is not level.
MAX_CAMERA_DISTANCE2 = 2.0
# Maximum angle in degrees between the verticals of two clouds that agree: about two standard deviations of the slope
# of a surface (0.7). Beyond it, one of them is bent or smeared.
MAX_CLOUD_ANGLE_DEG = 1.5
# Number of points per independent observation of a plane: the errors of neighbouring points are correlated.
POINTS_PER_READING = 10.0
# Standard deviation in degrees of the slope of a surface that is as wide as the scene, whatever its number of points:
# reconstructions bend by about a hundredth of their width, and floors slope slightly. It is inversely proportional to
# the width. With 0.7, 80 to 97 % of hard synthetic rooms with tilted tables (seeds 1100 to 1103) are within 1.5
# standard deviations.
SLOPE_DEG = 0.7
# Standard deviation in degrees of an error that all surfaces share.
COMMON_DEG = 0.3
# The same for cameras that hardly turn: they may follow a sloping street, and streets of more than 10 % (5.7 degrees)
# are rare.
STREET_SLOPE_DEG = 3.0

# Normal (3,), standard deviations (3,) of the points along the axes (3, 3), whose first is the normal; rows (n,) bool.
_Surface = tuple[FloatArray, FloatArray, FloatArray, BoolArray]


def camera_up(views: Sequence[View]) -> Up:
    """Estimate the vertical from the cameras.

    It is n = argmin ``|R x|`` over unit vectors x, with the x axes R (v, 3) of the cameras: the eigenvector of the
    smallest eigenvalue of R^T R. The variance of its tilt towards eigenvector j is k roll^2 / (lambda_j - lambda_1),
    with k frames per independent observation. The sign is that of the mean camera up.

    Parameters
    ----------
    views : sequence of View

    Raises
    ------
    ValueError
        There are no views.
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
    along = float(np.mean([view.rotation[2] for view in views], axis=0) @ normal)
    if sigma <= OBSERVABLE_DEG and abs(along) > MIN_DOWNWARD_COSINE and np.linalg.norm(mean_up) < MAX_DOWNWARD_MEAN_UP:
        return Up(-normal * np.sign(along), "camera-x-axes", float(sigma))
    x_axis = vectors[:, 2]
    across = mean_up - (mean_up @ x_axis) * x_axis
    length = float(np.linalg.norm(across))
    if length >= MIN_MEAN_UP:
        return Up(across / length, "mean-camera-up", PITCH_DEG, x_axis)
    other = [1.0, 0, 0] if abs(x_axis[0]) < 0.9 else [0, 1.0, 0]
    return Up(np.cross(x_axis, other), "none", 90.0)


def up_from_vector(vector: Sequence[float] | FloatArray) -> Up:
    """Return a known vertical, such as that of an inertial unit; `vector` (3,) has any length except 0.

    Raises
    ------
    InputError
        The vector is not three finite numbers, or all are 0.
    """
    direction = np.asarray(vector, dtype=float)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        raise InputError.at("up", "direction", "three finite numbers, not all 0", tuple(vector))
    direction = direction / np.abs(direction).max()  # its square may overflow
    return Up(direction / np.linalg.norm(direction), "given", GIVEN_DEG)


def up_problems(given: Up, estimated: Up) -> tuple[SceneProblem, ...]:
    """Return the contradiction between a given vertical and that of the cameras and level surfaces, if there is one."""
    if estimated.method == "none":
        return ()
    angle = float(np.degrees(np.arccos(np.clip(given.vector @ estimated.vector, -1, 1))))
    limit = MAX_TILT_SIGMAS * float(np.hypot(given.sigma_deg, estimated.sigma_deg))
    if angle <= limit:
        return ()
    if 180 - angle <= limit:
        gravity = "gravity points down, up is its opposite"
        return (SceneProblem(f"the given up points down ({estimated.method}): {gravity}"),)
    uncertainty = f"{estimated.method}, ±{estimated.sigma_deg:.1f}°"
    message = f"the given up is {angle:.0f}° from what the scene shows ({uncertainty})"
    return (SceneProblem(message, min(angle, 180 - angle) > MAX_UP_ERROR_DEG + limit),)


def refine_up(up: Up, clouds: Sequence[FloatArray]) -> Up:
    """Refine a vertical by the level surfaces of the clouds of a scene.

    Parameters
    ----------
    up : Up
        Vertical of the cameras.
    clouds : sequence of (n, 3) ndarray of float
        Results of `voxel_downsample`, the densest last.

    Returns
    -------
    Up
        The vertical of the last cloud that has level surfaces. If another cloud differs by more than
        `MAX_CLOUD_ANGLE_DEG`, the one nearest to the cameras' vertical, with the angle in its standard deviation. `up`
        itself if it is unknown or no cloud has a level surface. It is unknown if the mean camera up has no level
        surface and the cameras look straight at a surface, which may be a wall or the ground.
    """
    refined = [_refine_by_cloud(up, cloud) for cloud in clouds]
    # A cloud without level surfaces has too few points to judge and does not veto.
    supported = [one for one in refined if one.method.endswith("+plane")]
    if not supported or refined[-1].method == "none":
        return refined[-1]
    cosines = np.array([one.vector for one in supported]) @ supported[-1].vector
    angle = np.degrees(np.arccos(min(cosines.min(), 1.0)))
    if angle <= MAX_CLOUD_ANGLE_DEG:
        return supported[-1]
    nearest = max(supported, key=lambda one: float(one.vector @ up.vector))
    return replace(nearest, sigma_deg=float(np.hypot(nearest.sigma_deg, angle)))


def _refine_by_cloud(up: Up, downsampled: FloatArray) -> Up:
    """Refine a vertical by the level surfaces of one cloud (n, 3)."""
    if len(downsampled) < MIN_POINTS or up.method == "none":
        return up
    bin_width = height_bin_width(downsampled @ up.vector)
    start = _sharpest_vertical(up, downsampled[:: -(-len(downsampled) // MAX_SEARCH_POINTS)], bin_width)
    # Level surfaces with many points; of surfaces that share half of their points, the one with more points.
    widths = (bin_width, FIT_BIN * bin_width)
    fits = [
        _fit_plane(start, height, downsampled, width, widths[1])
        for width in widths
        for height in height_peaks(downsampled @ start, width)
    ]
    surfaces: list[_Surface] = []
    for fit in sorted((fit for fit in fits if fit is not None), key=lambda fit: -np.count_nonzero(fit[3])):
        rows = fit[3]
        if all(2 * np.count_nonzero(rows & other[3]) < np.count_nonzero(rows) for other in surfaces):
            surfaces.append(fit)
    if not surfaces:
        return Up(up.vector, "none", 90.0) if _faces_surface(up, downsampled) else up

    # Combine the verticals of the cameras and of the surfaces by their covariances. With the tilt x_k of vertical k
    # against `start` and its covariance C_k, x = S sum C_k^-1 x_k and S = (sum C_k^-1)^-1, times the sum of
    # (x_k - x)^T C_k^-1 (x_k - x) over 2 (k - 1) if that is more than 1 (Birge 1932). Along each axis of a surface, C_k
    # is (flatness / width)^2 per independent observation, plus (0.7 degrees * max(width of the scene / width, 1))^2.
    basis = level_basis(start)
    across = np.percentile(downsampled @ basis[:2].T, [84, 16], axis=0)
    scene_width = float(np.sqrt(np.prod(across[0] - across[1])) / 2)
    normals = (up.vector, *(normal for normal, _, _, _ in surfaces))
    tilts = [np.degrees(basis[:2] @ normal / (basis[2] @ normal)) for normal in normals]
    precisions = [np.eye(2) / up.sigma_deg**2]
    for _, deviations, axes, rows in surfaces:
        readings = max(np.count_nonzero(rows) / POINTS_PER_READING, 1.0)
        fit_deg = np.degrees(deviations[0] / deviations[1:] / np.sqrt(readings))
        slope_deg = SLOPE_DEG * np.maximum(scene_width / deviations[1:], 1.0)
        sides = axes[1:] @ basis[:2].T
        precisions.append(np.linalg.inv((sides.T * (fit_deg**2 + slope_deg**2)) @ sides))
    covariance = np.linalg.inv(sum(precisions))
    tilt = covariance @ sum(precision @ x for precision, x in zip(precisions, tilts, strict=True))
    scatter = sum(float((x - tilt) @ precision @ (x - tilt)) for precision, x in zip(precisions, tilts, strict=True))
    variance = np.trace(covariance) / 2 * max(scatter / (2 * len(surfaces)), 1.0)
    off = tilts[0] - tilt
    if off @ precisions[0] @ off > MAX_CAMERA_DISTANCE2:
        variance += off @ off / 2
    vector = _tilt_up(start, basis[:2], tilt[None])[0]
    common_deg = COMMON_DEG if up.reliable_axis is None else STREET_SLOPE_DEG
    return Up(vector, f"{up.method}+plane", float(np.hypot(np.sqrt(variance), common_deg)))


def _faces_surface(up: Up, points: FloatArray) -> bool:
    """Return whether cameras that hardly turn look straight at a surface with many of the points (n, 3)."""
    if up.reliable_axis is None:
        return False
    distances = points @ np.cross(up.reliable_axis, up.vector)
    width = height_bin_width(distances)
    counts = [np.abs(distances - peak) < HALF_THICKNESS_BINS * width for peak in height_peaks(distances, width)]
    return any(np.count_nonzero(is_near) >= MIN_FACED_FRACTION * len(points) for is_near in counts)


def _sharpest_vertical(up: Up, points: FloatArray, bin_width: float) -> FloatArray:
    """Return the vertical (3,) near `up` with the sharpest histogram of the heights of points (n, 3).

    The estimate of the cameras is a prior with the weight `CAMERA_PRIOR_WEIGHT`. The search evaluates a grid of tilts,
    followed by a pattern search.
    """
    basis = level_basis(up.vector)
    axis = up.reliable_axis if up.reliable_axis is not None else basis[0]
    axis = axis - (axis @ up.vector) * up.vector
    axis /= np.linalg.norm(axis)
    # The standard deviation is that of the tilt about the known axis; the other tilt is the roll of the camera.
    sigma = np.array([up.sigma_deg, KNOWN_AXIS_DEG if up.reliable_axis is not None else up.sigma_deg])
    axes = np.stack([np.cross(axis, up.vector), axis])
    centre, radius = np.zeros(2), MAX_TILT_SIGMAS * sigma
    for width in (bin_width, FINE_BIN * bin_width) if radius[0] > MAX_FINE_DEG else (FINE_BIN * bin_width,):
        steps = np.linspace(-1, 1, 2 * STEPS + 1)
        grid = centre + np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2) * radius
        centre = grid[_sharpness(grid, sigma, up.vector, axes, points, width).argmax()]
        radius = np.minimum(radius, MAX_FINE_DEG)
    step = float(radius.max()) / STEPS
    while step > MIN_STEP_DEG:
        around = centre + step * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        best = int(_sharpness(around, sigma, up.vector, axes, points, FINE_BIN * bin_width).argmax())
        centre, step = around[best], step / (1 if best else 2)
    return np.asarray(_tilt_up(up.vector, axes, centre[None])[0])


def _tilt_up(up: FloatArray, axes: FloatArray, degrees: FloatArray) -> FloatArray:
    """Return `up` (3,) tilted along the two `axes` (2, 3) by angles (k, 2), as unit vectors (k, 3)."""
    vectors = up + np.tan(np.radians(degrees)) @ axes
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def _sharpness(
    degrees: FloatArray, sigma: FloatArray, up: FloatArray, axes: FloatArray, points: FloatArray, bin_width: float
) -> FloatArray:
    """Return the log sharpness (k,) of the heights of points (n, 3) for tilts (k, 2), plus the log prior of the tilt.

    `axes` (2, 3) are the directions of the tilts and `sigma` (2,) their standard deviations in degrees.
    """
    score = np.empty(len(degrees))
    for row, vector in enumerate(_tilt_up(up, axes, degrees)):
        heights = points @ vector
        ends = len(heights) // TRIM_DENOMINATOR
        heights = np.partition(heights, (ends, -1 - ends))[ends : len(heights) - ends]
        counts = np.bincount(((heights - heights[0]) / bin_width).astype(np.int64))
        smooth = gaussian_filter1d(counts.astype(float), SMOOTHING_BINS, mode="constant")
        score[row] = 2 / SHARPNESS_POWER * np.log((smooth**SHARPNESS_POWER).sum())
    return np.asarray(score - CAMERA_PRIOR_WEIGHT / 2 * np.square(degrees / sigma).sum(axis=1))


def _fit_plane(start: FloatArray, height: float, points: FloatArray, first: float, last: float) -> _Surface | None:
    """Fit a plane to points (n, 3) around a height along `start` (3,); None if it is not nearly level.

    The window around the plane shrinks from the bin width `first` in the first round to `last` in the last.
    """
    normal, centre = start, height * start
    for width in np.geomspace(first, last, FIT_ROUNDS):
        rows = np.abs((points - centre) @ normal) < HALF_THICKNESS_BINS * width
        if np.count_nonzero(rows) < MIN_POINTS:
            return None
        centre = points[rows].mean(axis=0)
        values, vectors = np.linalg.eigh(np.cov(points[rows].T))
        normal = vectors[:, 0] * np.sign(vectors[:, 0] @ start)
    if normal @ start < np.cos(np.radians(MAX_SLOPE_DEG)):
        return None
    return normal, np.sqrt(np.maximum(values, 0.0)), vectors.T, rows
