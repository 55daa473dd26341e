"""The one extent rule: where a cloud of surface points begins and ends along an axis, for every method alike.

Extents decide a scale more than anything but the outliers, so the rule is stated once, with its bias, and all methods
that are compared use it. Percentiles alone are short where a side fades out (a bottle's wall from top to bottom loses 3
% of its height) and long where noise thickens a face; both are corrected by stated functions.
"""

from __future__ import annotations

import numpy as np

from metric_base.arrays import BoolArray, FloatArray, IntArray

__all__ = [
    "HIDDEN_TOP_SIGMA",
    "TOP_SIGMA",
    "edges",
    "end_quantiles",
    "extent_sigma",
    "level_top",
    "quantiles",
    "surface_cells",
]

# The share cut off at either end: enough to lose flying points, and little against any face.
TRIM = 0.015
# Where points thin out evenly, the next two shares of the same size say how much the first one cut off:
# edge = q(t) - (q(3t) - q(t)) / 2. On a face the quantiles coincide and nothing is added.
OUTER, INNER = TRIM, 3 * TRIM
END_SHARES = np.array([OUTER, INNER, 1 - INNER, 1 - OUTER])
EXTRAPOLATION = 0.5
# An even fade holds 3 % of the extent between the two quantiles; more than this is a stray beyond a gap, not a fade.
MAX_FADE = 0.05
# The outer quantile lies this many standard deviations of the noise outside the edge: LEAST where noise is thin against
# the extent, MOST where it drowns it, half way at HALF_WAY extents of noise. On made clouds LEAST is 1.7 on a face and
# 0.2 where the surface fades out evenly; in quick synthetic rooms, seeds 1000 to 1002, 0.6 does better than 0.3 at a
# depth noise of 1 and 3 %, and as well at 0.4 %.
LEAST_OVERSHOOT, MOST_OVERSHOOT, HALF_WAY = 0.6, 2.1, 0.3
# Few points do not reach the edges: on synthetic shapes what is missing is about one part in n.
MISSING_SHARE = 1.0
# Points that say where an edge is; more cost time and change the third digit.
MAX_POINTS = 4000
# One standard deviation of an edge, as a share of the extent, from the rule on synthetic shapes: what remains with many
# points, and what few points add, share / sqrt(n).
RULE_SIGMA = 0.015
SAMPLING_SIGMA = 0.25
# ... and that few points cannot tell a stray from an edge: share / n. In synthetic rooms 20 points are off by a sixth,
# 100 by a fifteenth.
STRAY_SIGMA = 3.0
# ... and that a fading edge is placed half a fade beyond its outer quantile, and is off by about as much.
FADE_SIGMA = 0.6
# A level top is a window of this share of the height, in its upper part, with so many of the points and so many times
# what they have elsewhere. Without a peak the quantile stays.
TOP_WINDOW, LOWEST_TOP, TOP_SHARE, TOP_POINTS, TOP_TIMES = 0.06, 0.5, 0.2, 6, 2.5
# The window takes in the rim of a table's top too, whose upper end is the top.
TOP_QUANTILE = 0.75
# One standard deviation of the log height that a level top ends, from hard synthetic rooms with clutter, seeds 1100 and
# 1101: what lies on a small table may be larger than its top.
TOP_SIGMA = 0.08
# ... and of one whose level top cannot be seen: where things on it were in its masks, and there alone, heights there
# are half as large again to twice as large.
HIDDEN_TOP_SIGMA = 0.5


def end_quantiles(points: FloatArray) -> FloatArray:
    """(4, d) of points (n, d): the shares t, 3 t, 1 - 3 t and 1 - t along each column, which edges are made of."""
    return quantiles(points[:: max(1, -(-len(points) // MAX_POINTS))], END_SHARES)


def edges(
    points: FloatArray, noise: float | FloatArray = 0.0, ends: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Lower and upper edge (d,) of points (n, d) along each column; `noise` of the surface, one for all or (d,).

    ends : their `end_quantiles`, where these are known

    Equation: edge = q(t) - (q(3 t) - q(t)) / 2 + overshoot - extent / (2 n) at the lower end, the mirror image at the
    upper one, with t = 1.5 % (`_overshoot`).
    """
    outer_low, inner_low, inner_high, outer_high = end_quantiles(points) if ends is None else ends
    most = MAX_FADE * (outer_high - outer_low)
    low = outer_low - EXTRAPOLATION * np.minimum(inner_low - outer_low, most)
    high = outer_high + EXTRAPOLATION * np.minimum(outer_high - inner_high, most)
    missing = MISSING_SHARE * (high - low) / (2 * max(len(points), 1))
    over = _overshoot(high - low, noise)
    return low + over - missing, high - over + missing


def _overshoot(extents: FloatArray, noise: float | FloatArray) -> FloatArray:
    """What noise adds to observed extents (d,) at either end.

    Equation: observed = E + 2 noise c, c = LEAST + (MOST - LEAST) noise / (noise + HALF_WAY E), solved for E. A sheet
    is as thick as its noise: what is taken away stays under a quarter of the extent.
    """
    plain = extents - 2 * LEAST_OVERSHOOT * noise
    linear = HALF_WAY * plain - noise
    constant = noise * (plain - 2 * (MOST_OVERSHOOT - LEAST_OVERSHOOT) * noise)
    true = (linear + np.sqrt(np.maximum(linear**2 + 4 * HALF_WAY * constant, 0.0))) / (2 * HALF_WAY)
    return np.asarray(np.minimum((extents - true) / 2, extents / 4))


def extent_sigma(
    points: FloatArray, extents: FloatArray, noise: float | FloatArray, ends: FloatArray | None = None
) -> FloatArray:
    """(2, d) standard deviation of the lower and of the upper edge of points (n, d), as shares of the extents (d,).

    Equation: sigma^2 = 0.015^2 + 0.25^2 / n + (3 / n)^2 + (noise / extent)^2 / 2 + (0.6 fade / extent)^2 for an edge,
    fade the distance between its q(t) and q(3 t): a face has none, leaves of a plant much. The log extent's is the root
    of the sum of both squares.
    """
    safe = np.maximum(extents, np.finfo(float).tiny)
    outer_low, inner_low, inner_high, outer_high = end_quantiles(points) if ends is None else ends
    fade = np.array([inner_low - outer_low, outer_high - inner_high])
    count = max(len(points), 1)
    common = RULE_SIGMA**2 + SAMPLING_SIGMA**2 / count + (STRAY_SIGMA / count) ** 2 + (noise / safe) ** 2 / 2
    return np.asarray(np.sqrt(common + (FADE_SIGMA * fade / safe) ** 2))


def level_top(heights: FloatArray, low: float, high: float) -> float | None:
    """Height of the level top of points whose heights (n,) are between `low` and `high`, by and large.

    It is the fullest window of heights; None where no window stands out, or where the top is not below `high`.
    """
    size = high - low
    near = np.sort(heights[(heights > low + LOWEST_TOP * size) & (heights <= high + TOP_WINDOW * size)])
    if len(near) < TOP_POINTS:
        return None
    counts = np.searchsorted(near, near + TOP_WINDOW * size, side="right") - np.arange(len(near))
    first = int(counts.argmax())
    most = int(counts[first])
    even = TOP_WINDOW / (1 - LOWEST_TOP) * len(near)
    if most < max(TOP_POINTS, TOP_SHARE * len(heights), TOP_TIMES * even):
        return None
    inside = near[first : first + most]
    top = float(np.quantile(inside, TOP_QUANTILE))
    return top if top < high else None


def surface_cells(points: FloatArray, per_cell: int, most: int) -> tuple[IntArray, BoolArray]:
    """(n, 3) index of each point's cubic cell, and (n,) whether it lies within reach of the middle 96 %.

    Cells are as large as `per_cell` points of an evenly covered box need, but at most about `most` along a side; the
    grid reaches half a box beyond the middle part, and points outside it are not inside.
    """
    low, high = quantiles(points, np.array([0.02, 0.98]))
    sides = np.maximum(high - low, np.finfo(float).tiny)
    surface = 2 * (sides[0] * sides[1] + sides[1] * sides[2] + sides[2] * sides[0])
    longest = float(sides.max())
    cell = max(float(np.sqrt(surface * per_cell / len(points))), longest / most)
    reach = 0.5 * longest
    # column by column: a test along rows of three is five times as slow
    columns = [(column - start) / cell for column, start in zip(points.T, low - reach, strict=True)]
    ends = (high - low + 2 * reach) / cell
    inside = np.logical_and.reduce([(column >= 0) & (column <= end) for column, end in zip(columns, ends, strict=True)])
    index = np.array(columns).T
    return (index if inside.all() else np.where(inside[:, None], index, 0)).astype(np.int64), inside


def quantiles(points: FloatArray, shares: FloatArray) -> FloatArray:
    """(k, ...) quantiles of points (n, ...) along their first axis, between order statistics."""
    position = shares * (len(points) - 1)
    below = np.floor(position).astype(np.int64)
    above = np.minimum(below + 1, len(points) - 1)
    # only these few need their places: an eighth of the time of sorting
    ordered = np.partition(points, np.concatenate([below, above]), axis=0)
    part = (position - below).reshape(-1, *[1] * (points.ndim - 1))
    return np.asarray(ordered[below] * (1 - part) + ordered[above] * part)
