"""Charts of sizes: density and histogram of one dimension, and a scatter chart of two dimensions.

The density is that of the prior, with its median and 90 % interval. Histogram and points are the published items by
kind of evidence. The contours of the scatter chart contain 90 % of each component of the prior.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from explorer.charts.axis import MIN_TICK_GAP_PX, LogAxis, length_text, path_data, range_text, svg
from metric_base.arrays import FloatArray
from metric_tree.prior import Prior

#: Kinds of evidence from the bottom of a stacked bar to its top, the strongest first.
KINDS = ("measured", "product", "standard", "norm", "statistic", "museum", "asset", "curated", "judged", "default")
WIDTH, TOP, BOTTOM = 340, 8, 118
#: Margin at the ends of the axis in pixels: half of the widest label.
MARGIN = MIN_TICK_GAP_PX / 2
#: Number of points of the curve and of bins of the histogram.
POINTS, BINS = 49, 24
#: Minimum number of items for a histogram.
MIN_HISTOGRAM_ITEMS = 8
#: Half-width of the axis in standard deviations of ln size, which holds 99.7 % of a normal distribution.
REACH_SD = 3.0
#: Percentage of the items at each end that may be outside of the axis.
TRIM = 0.5
#: Factor by which the axis is longer than the sizes of a norm at each end, so that it contains several round lengths.
NORM_MARGIN = 1.8
#: Minimum weight of a size of a norm for a line.
MIN_STATED_WEIGHT = 0.005
SCATTER_WIDTH, HEIGHT, LEFT, SCATTER_BOTTOM, SCATTER_TOP, RIGHT = 340, 230, 46, 206, 8, 330
#: Maximum number of items in a scatter chart.
MAX_SCATTER_POINTS = 300
#: Minimum weight of a component of the prior for a contour.
MIN_CONTOUR_WEIGHT = 0.05
#: Squared Mahalanobis radius that holds 0.9 of a Gaussian of two dimensions: -2 ln 0.1.
RADIUS_SQUARED = -2 * np.log(0.1)


def length_axis(prior: Prior, sizes: FloatArray) -> LogAxis:
    """Return the axis for a prior of one dimension and the sizes (n,) of items in mm."""
    mean, sd = float(prior.weights @ prior.means[:, 0]), float(prior.log_sd()[0])
    low, high = np.exp(mean - REACH_SD * sd), np.exp(mean + REACH_SD * sd)
    if sizes.size:
        ends = np.percentile(sizes, [TRIM, 100 - TRIM])
        low, high = min(low, ends[0]), max(high, ends[1])
    return LogAxis(float(low), float(high), MARGIN, WIDTH - MARGIN)


def distribution(
    name: str, prior: Prior, interval: FloatArray, sizes: FloatArray, kinds: FloatArray, is_norm: bool = False
) -> str:
    """Return the SVG of the distribution of one dimension.

    The bars of a kind have the area of its share of the prior, so that kinds without shipped items leave a gap.

    Parameters
    ----------
    name : str
        Dimension.
    prior : Prior
        Prior over this dimension.
    interval : (3,) ndarray of float
        5, 50 and 95 % quantile of the prior in mm.
    sizes : (n,) ndarray of float
        Sizes of the published items in mm.
    kinds : (n,) ndarray of str
        Their kinds of evidence, which have a share in the prior.
    is_norm : bool
        Whether a norm fixes the sizes: a line for each of them in place of a curve, which would be that of a tolerance.
    """
    if is_norm:
        sizes, kinds = sizes[:0], kinds[:0]
    axis = length_axis(prior, sizes)
    if is_norm:  # the axis of a tolerance has no round tick
        axis = LogAxis(axis.low / NORM_MARGIN, axis.high * NORM_MARGIN, MARGIN, WIDTH - MARGIN)
    grid = np.geomspace(axis.low, axis.high, POINTS)
    density = np.exp(prior.log_density(grid[:, None]))
    edges = np.geomspace(axis.low, axis.high, BINS + 1)
    # Density of the items over ln mm by kind (rows) and bin, and the height of the stacked bars
    counts: dict[str, FloatArray] = {}
    if sizes.size >= MIN_HISTOGRAM_ITEMS:
        width = float(np.log(edges[1] / edges[0]))
        for kind in KINDS:
            of_kind = sizes[kinds == kind]
            if of_kind.size:
                share = prior.share_by_kind.get(kind, 0.0)
                counts[kind] = share * np.histogram(of_kind, edges)[0] / (of_kind.size * width)
    top = max(float(density.max()), *(sum(column) for column in zip(*counts.values(), strict=True)), 0.0)
    low, median, high = interval.tolist()
    height = (BOTTOM - TOP) / top
    curve = path_data(zip(axis.along(grid), BOTTOM - density * height, strict=True))
    # One path per kind: stacked rectangles
    paths: dict[str, str] = {}
    for bin_index, (left, right) in enumerate(pairwise(axis.along(edges).tolist())):
        floor = float(BOTTOM)
        for kind, count in counts.items():
            if count[bin_index]:
                up = float(count[bin_index]) * height
                rectangle = f"M{left:.1f} {floor:.1f}v{-up:.1f}h{right - left - 0.6:.1f}v{up:.1f}z"
                paths[kind] = paths.get(kind, "") + rectangle
                floor -= up
    bars = "".join(f'<path class="kind-{kind}" d="{data}"/>' for kind, data in paths.items())
    band = f'<path class="band" d="M{axis.at(low):.1f} {TOP}H{axis.at(high):.1f}V{BOTTOM}H{axis.at(low):.1f}Z"/>'
    middle = f'<path class="median" d="M{axis.at(median):.1f} {TOP}V{BOTTOM}"/>'
    said = f"{name}: median {length_text(median)}, 90 % interval {range_text(low, high)}, {sizes.size} shipped items"
    if is_norm:
        stated = np.exp(prior.means[prior.weights >= MIN_STATED_WEIGHT, 0])
        curve = "".join(f"M{x:.1f} {TOP}V{BOTTOM}" for x in sorted(set(axis.along(stated).tolist())))
    body = band + axis.svg(BOTTOM, TOP) + bars + middle + f'<path class="curve" d="{curve}"/>'
    return svg(WIDTH, BOTTOM + 18, said, body, "distribution")


def scatter(prior: Prior, sizes: FloatArray, kinds: FloatArray) -> str:
    """Return the SVG of a scatter chart of two dimensions, the first to the right and the second up.

    Parameters
    ----------
    prior : Prior
        Prior over the two dimensions.
    sizes : (n, 2) ndarray of float
        Sizes in mm of the published items with both dimensions.
    kinds : (n,) ndarray of str
        Their kinds of evidence.
    """
    across = length_axis(prior.marginal(prior.dims[:1]), sizes[:, 0])
    upward = length_axis(prior.marginal(prior.dims[1:]), sizes[:, 1])
    right = LogAxis(across.low, across.high, LEFT, RIGHT)
    up = LogAxis(upward.low, upward.high, SCATTER_BOTTOM, SCATTER_TOP)
    side = up.svg(LEFT, RIGHT, is_vertical=True)
    chosen = np.linspace(0, len(sizes) - 1, min(len(sizes), MAX_SCATTER_POINTS)).astype(int)
    drawn = ""
    for kind in KINDS:
        of_kind = sizes[chosen][kinds[chosen] == kind]
        if len(of_kind):
            data = "".join(
                f"M{x:.0f} {y:.0f}h0" for x, y in zip(right.along(of_kind[:, 0]), up.along(of_kind[:, 1]), strict=True)
            )
            drawn += f'<path class="dots dots-{kind}" d="{data}"/>'
    # Ellipses with 90 % of the mass of the components
    angles = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)  # (36, 2)
    for k, weight in enumerate(prior.weights):
        if weight >= MIN_CONTOUR_WEIGHT:
            covariance = prior.covariances[k] + prior.shared_covariance
            lower = np.linalg.cholesky(covariance) * np.sqrt(RADIUS_SQUARED)
            outline = np.exp(prior.means[k] + circle @ lower.T)
            pixels = zip(right.along(outline[:, 0]).tolist(), up.along(outline[:, 1]).tolist(), strict=True)
            drawn += f'<path class="contour" d="{path_data(pixels)}Z"/>'
    window = f'x="{LEFT}" y="{SCATTER_TOP}" width="{RIGHT - LEFT}" height="{SCATTER_BOTTOM - SCATTER_TOP}"'
    # the view box clips points outside of the axes
    view = f'viewBox="{LEFT} {SCATTER_TOP} {RIGHT - LEFT} {SCATTER_BOTTOM - SCATTER_TOP}"'
    inside = f"<svg {window} {view}>{drawn}</svg>"
    title = f"{prior.dims[0]} (across) against {prior.dims[1]} (up), {len(chosen)} of {len(sizes)} items"
    return svg(SCATTER_WIDTH, HEIGHT, title, right.svg(SCATTER_BOTTOM, SCATTER_TOP) + side + inside, "scatter")
