"""Support planes: the level surfaces that objects stand on (floor, desk tops, road), peaks of the heights of a cloud.

Points are first thinned to one per cell of space, so that a surface counts by its area and not by how richly it was
reconstructed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import binary_dilation, gaussian_filter1d, median_filter

from estimator.records.objects import SupportPlane
from metric_base.arrays import FloatArray, IntArray
from metric_base.statistics import robust_sigma

# Height bins over the middle 96 % of heights: 2 cm in a room, twice the noise of an ordinary dense cloud.
HEIGHT_BINS = 150
# Cells of space along the cloud's diagonal when thinning: 3 cm in a room of six metres.
THINNING_CELLS = 200
MAX_POINTS = 40_000
# A plane's bin holds this many times the bins around it; clutter varies by less.
PEAK_RATIO = 2.0
# Bins around a peak that say what is ordinary there: a third of all heights, so that a thick noisy floor is a minority.
SURROUNDING_BINS = 51
# Half the thickness of a level surface and the smoothing before its peak is sought, in bins.
HALF_THICKNESS_BINS = 2.5
SMOOTHING_BINS = 1.5
# A plane holds at least this share of the thinned points and this many of them: a table top is a hundredth of a room's
# surfaces.
MIN_SHARE = 0.008
MIN_POINTS = 25
# Two planes closer than this many bins are one surface with noise.
MIN_BINS_APART = 6
# Cells of a plane's map, in height bins: large enough that a sparse surface has no holes.
CELL_BINS = 6
# Below a floor lie only strays: one point in twenty. Below a table lie floor, legs and walls.
BELOW_FLOOR_SHARE = 0.05
# ... but below a glossy floor are mirror images of what stands on it: one point in seven. Only a plane that is as wide
# as this share of the widest may have as many.
BELOW_GLOSSY_SHARE, WIDE_SHARE = 0.15, 0.5
# Beyond this part along x a vertical counts as near the x axis.
NEAR_X = 0.9


def level_basis(up: FloatArray) -> FloatArray:
    """(3, 3) right-handed rows: two horizontal unit axes, then the unit vector `up` (3,).

    The first is the x axis without its part along `up`, or the y axis where up is near x: no jump near any vertical of
    a frame whose z is up.
    """
    seed = np.array([1.0, 0, 0]) if abs(up[0]) < NEAR_X else np.array([0, 1.0, 0])
    one = seed - (seed @ up) * up
    one /= np.linalg.norm(one)
    return np.stack([one, np.cross(up, one), up])


def support_planes(up: FloatArray, points: FloatArray) -> tuple[SupportPlane, ...]:
    """Level surfaces of the cloud (n, 3), lowest first."""
    thin = one_per_cell(points)
    if len(thin) < MIN_POINTS:
        return ()
    basis = level_basis(up)
    local = thin @ basis.T
    bin_width = height_bin(local[:, 2])
    planes = []
    for height in peaks(local[:, 2], bin_width):
        near = np.abs(local[:, 2] - height) < HALF_THICKNESS_BINS * bin_width
        inliers = local[near]
        planes.append(_plane(basis, inliers, bin_width))
    return tuple(planes)


def floor_of(planes: Sequence[SupportPlane], points: FloatArray) -> SupportPlane | None:
    """The plane that everything may stand on, None where the cloud (n, 3) shows none.

    It is the lowest plane with next to nothing below it. A glossy floor has mirror images below it, so a wide plane may
    have more: as wide as the widest of them.
    """
    widest = max((np.count_nonzero(plane.cells) for plane in planes), default=0)
    for plane in planes:
        below = points @ plane.basis[2] < plane.height - 2 * HALF_THICKNESS_BINS * plane.cell / CELL_BINS
        wide = np.count_nonzero(plane.cells) >= WIDE_SHARE * widest
        if np.count_nonzero(below) <= (BELOW_GLOSSY_SHARE if wide else BELOW_FLOOR_SHARE) * len(points):
            return plane if wide or plane is planes[0] else None
    return None


def peaks(heights: FloatArray, bin_width: float) -> list[float]:
    """Heights of the level surfaces in heights (n,), lowest first: bins that stand out, strongest kept."""
    counts, low = _histogram(heights, bin_width)
    smooth = gaussian_filter1d(counts, SMOOTHING_BINS, mode="constant")
    around = np.maximum(median_filter(smooth, SURROUNDING_BINS, mode="reflect"), 1.0)
    held = np.convolve(counts, np.ones(2 * int(HALF_THICKNESS_BINS) + 1), mode="same")
    strong = (smooth >= PEAK_RATIO * around) & (held >= max(MIN_POINTS, MIN_SHARE * len(heights)))
    kept: list[int] = []
    for index in np.argsort(-smooth):
        if strong[index] and all(abs(int(index) - other) >= MIN_BINS_APART for other in kept):
            kept.append(int(index))
    return sorted(low + (index + 0.5) * bin_width for index in kept)


def _plane(basis: FloatArray, inliers: FloatArray, bin_width: float) -> SupportPlane:
    """The plane of its inliers (n, 3) in level coordinates, whose axes are the rows of `basis` (3, 3)."""
    cell = CELL_BINS * bin_width
    origin = inliers[:, :2].min(axis=0) - cell
    index = ((inliers[:, :2] - origin) // cell).astype(np.int64)
    cells = np.zeros(index.max(axis=0) + 2, dtype=bool)
    cells[tuple(index.T)] = True
    middle, sigma = float(np.median(inliers[:, 2])), robust_sigma(inliers[:, 2])
    return SupportPlane(basis, middle, sigma, len(inliers), origin, cell, binary_dilation(cells))


def one_per_cell(points: FloatArray) -> FloatArray:
    """One of the points (n, 3) per cell of space, (m, 3), at most `MAX_POINTS`."""
    points = points[:: max(1, -(-len(points) // (4 * MAX_POINTS)))]
    if len(points) < MIN_POINTS:
        return points
    low, high = np.percentile(points, [2, 98], axis=0)
    cell = max(float(np.linalg.norm(high - low)) / THINNING_CELLS, np.finfo(float).tiny)
    index = np.clip((points - low) // cell, -THINNING_CELLS, 2 * THINNING_CELLS).astype(np.int64) + THINNING_CELLS
    side = 3 * THINNING_CELLS + 1
    keys = (index[:, 0] * side + index[:, 1]) * side + index[:, 2]
    rows: IntArray = np.unique(keys, return_index=True)[1]
    return points[rows[:: max(1, -(-len(rows) // MAX_POINTS))]]


def height_bin(heights: FloatArray) -> float:
    """Width of a bin of the heights (n,) of a whole scene."""
    low, high = np.percentile(heights, [2, 98])
    return max(float(high - low) / HEIGHT_BINS, np.finfo(float).tiny)


def _histogram(heights: FloatArray, bin_width: float) -> tuple[FloatArray, float]:
    """Counts per bin (b,) over the middle of the heights (n,), and the lower end of the first bin."""
    low, high = np.percentile(heights, [0.5, 99.5])
    index = ((heights - low) // bin_width).astype(np.int64)
    bins = int((high - low) // bin_width) + 1
    inside = (index >= 0) & (index < bins)
    return np.bincount(index[inside], minlength=bins).astype(float), float(low)
