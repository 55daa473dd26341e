"""Find the level surfaces of a cloud (floor, table tops, road) as peaks of the histogram of its heights.

The points are first reduced to one per voxel, so that a surface is weighted by its area and not by the density of its
points.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import binary_dilation, gaussian_filter1d, median_filter

from estimator.records.objects import SupportPlane
from metric_base.arrays import FloatArray, IntArray, evenly_spaced
from metric_base.statistics import robust_sigma

# Number of height bins over the central 96 % of heights: 2 cm in a room, twice the noise of a typical dense cloud.
HEIGHT_BINS = 150
# Number of voxels along the diagonal of the cloud: 3 cm in a room of six metres.
VOXELS_PER_DIAGONAL = 200
# Maximum number of points after downsampling.
MAX_POINTS = 40_000
# Minimum ratio of the smoothed count of a peak to the median count around it; clutter varies by less.
MIN_PEAK_TO_MEDIAN = 2.0
# Number of bins of this median, a third of all heights, so that a thick noisy floor is a minority.
SURROUNDING_BINS = 51
# Half thickness of a level surface, in bins.
HALF_THICKNESS_BINS = 2.5
# Standard deviation of the Gaussian that smooths the histogram, in bins.
SMOOTHING_BINS = 1.5
# Minimum fraction of the points in a plane. A table top has a hundredth of the surface of a room.
MIN_PLANE_FRACTION = 0.008
# Minimum number of points in a plane.
MIN_POINTS = 25
# Minimum distance of two planes in bins; closer ones are one surface with noise.
MIN_BINS_APART = 6
# Side of the cells in the map of a plane, in height bins: large enough for a sparse surface without holes.
CELL_BINS = 6
# Maximum fraction of points below a floor, which are outliers. More points are below a table: floor, legs and walls.
MAX_BELOW_FLOOR_FRACTION = 0.05
# Maximum fraction of points below a glossy floor, where the mirror images of objects are. It applies to wide planes.
MAX_BELOW_GLOSSY_FLOOR_FRACTION = 0.15
# Minimum area of a wide plane relative to the widest one.
MIN_WIDE_FRACTION = 0.5
# Minimum x component of a vertical that is treated as parallel to the x axis.
NEAR_X = 0.9


def level_basis(up: FloatArray) -> FloatArray:
    """Return right-handed unit rows (3, 3): two horizontal axes, then the unit vector `up` (3,).

    The first is the x axis without its component along `up`, or the y axis if `up` is close to x. It is continuous
    around the vertical of a frame whose z axis is up.
    """
    seed = np.array([1.0, 0, 0]) if abs(up[0]) < NEAR_X else np.array([0, 1.0, 0])
    first = seed - (seed @ up) * up
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first), up])


def support_planes(up: FloatArray, downsampled: FloatArray) -> tuple[SupportPlane, ...]:
    """Find the level surfaces of a cloud, lowest first.

    Parameters
    ----------
    up : (3,) ndarray of float
        Unit vertical.
    downsampled : (n, 3) ndarray of float
        Result of `voxel_downsample`.
    """
    if len(downsampled) < MIN_POINTS:
        return ()
    basis = level_basis(up)
    local = downsampled @ basis.T
    bin_width = height_bin_width(local[:, 2])
    cell = CELL_BINS * bin_width
    planes = []
    for peak in height_peaks(local[:, 2], bin_width):
        inliers = local[np.abs(local[:, 2] - peak) < HALF_THICKNESS_BINS * bin_width]
        origin = inliers[:, :2].min(axis=0) - cell
        index = ((inliers[:, :2] - origin) // cell).astype(np.int64)
        cells = np.zeros(index.max(axis=0) + 2, dtype=bool)
        cells[tuple(index.T)] = True
        height, sigma = float(np.median(inliers[:, 2])), robust_sigma(inliers[:, 2])
        planes.append(SupportPlane(basis, height, sigma, len(inliers), origin, cell, binary_dilation(cells)))
    return tuple(planes)


def floor_of(planes: Sequence[SupportPlane], points: FloatArray) -> SupportPlane | None:
    """Return the plane that objects can stand on, or None if the cloud (n, 3) shows none.

    It is the lowest plane with almost no points below it. A plane that is almost as wide as the widest may be a glossy
    floor and have more points below it, which are mirror images.
    """
    widest = max((np.count_nonzero(plane.cells) for plane in planes), default=0)
    for plane in planes:
        is_below = points @ plane.basis[2] < plane.height - 2 * HALF_THICKNESS_BINS * plane.cell / CELL_BINS
        is_wide = np.count_nonzero(plane.cells) >= MIN_WIDE_FRACTION * widest
        max_fraction = MAX_BELOW_GLOSSY_FLOOR_FRACTION if is_wide else MAX_BELOW_FLOOR_FRACTION
        if np.count_nonzero(is_below) <= max_fraction * len(points):
            return plane if is_wide or plane is planes[0] else None
    return None


def height_peaks(heights: FloatArray, bin_width: float) -> list[float]:
    """Find the level surfaces among heights (n,): bins that stand out from those around them.

    Of peaks closer than `MIN_BINS_APART`, the highest is kept. The result is sorted.
    """
    low, high = np.percentile(heights, [0.5, 99.5])
    index = ((heights - low) // bin_width).astype(np.int64)
    bins = int((high - low) // bin_width) + 1
    counts = np.bincount(index[(index >= 0) & (index < bins)], minlength=bins).astype(float)
    smooth = gaussian_filter1d(counts, SMOOTHING_BINS, mode="constant")
    around = np.maximum(median_filter(smooth, SURROUNDING_BINS, mode="reflect"), 1.0)
    in_plane = np.convolve(counts, np.ones(2 * int(HALF_THICKNESS_BINS) + 1), mode="same")
    is_peak = (smooth >= MIN_PEAK_TO_MEDIAN * around) & (in_plane >= max(MIN_POINTS, MIN_PLANE_FRACTION * len(heights)))
    peaks: list[int] = []
    for peak in np.argsort(-smooth):
        if is_peak[peak] and all(abs(int(peak) - other) >= MIN_BINS_APART for other in peaks):
            peaks.append(int(peak))
    return sorted(float(low) + (peak + 0.5) * bin_width for peak in peaks)


def voxel_downsample(points: FloatArray) -> FloatArray:
    """Return one of the points (n, 3) per voxel, (m, 3), at most `MAX_POINTS`."""
    points = evenly_spaced(points, 4 * MAX_POINTS)
    if len(points) < MIN_POINTS:
        return points
    low, high = np.percentile(points, [2, 98], axis=0)
    voxel = max(float(np.linalg.norm(high - low)) / VOXELS_PER_DIAGONAL, np.finfo(float).tiny)
    index = np.clip((points - low) // voxel, -VOXELS_PER_DIAGONAL, 2 * VOXELS_PER_DIAGONAL).astype(np.int64)
    index += VOXELS_PER_DIAGONAL
    side = 3 * VOXELS_PER_DIAGONAL + 1
    keys = (index[:, 0] * side + index[:, 1]) * side + index[:, 2]
    rows: IntArray = np.unique(keys, return_index=True)[1]
    return points[evenly_spaced(rows, MAX_POINTS)]


def height_bin_width(heights: FloatArray) -> float:
    """Return the width of a height bin for the heights (n,) of a scene."""
    low, high = np.percentile(heights, [2, 98])
    return max(float(high - low) / HEIGHT_BINS, np.finfo(float).tiny)
