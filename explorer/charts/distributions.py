"""The distribution of one dimension: the prior's density, the items' histogram by kind, the median and the interval.

One dimension against another: the items by kind, and the curve that holds nine tenths of the prior.
"""

from __future__ import annotations

import numpy as np

from explorer.charts.axis import MIN_TICK_GAP_PX, LogAxis, length_text, path_data, range_text, svg
from metric_base.arrays import FloatArray
from metric_tree.prior import Prior

#: Kinds of evidence in the order in which they are stacked: the strongest at the bottom.
KINDS = ("measured", "product", "standard", "norm", "statistic", "museum", "asset", "curated", "judged", "default")
WIDTH, TOP, BOTTOM = 340, 8, 118
#: Margin at the ends of the axis in pixels: half of the widest label.
MARGIN = MIN_TICK_GAP_PX / 2
#: Points of the curve and bins of the histogram.
POINTS, BINS = 49, 24
#: Minimum number of items for a histogram.
MIN_HISTOGRAM_ITEMS = 8
#: Half-width of the axis in standard deviations of ln size, which holds 99.7 % of a normal distribution.
REACH_SD = 3.0
#: Items at either end that the axis may leave out.
TRIM = 0.5
SCATTER_WIDTH, HEIGHT, LEFT, SCATTER_BOTTOM, SCATTER_TOP, RIGHT = 340, 230, 46, 206, 8, 330
#: Maximum number of items in a scatter chart.
MAX_SCATTER_POINTS = 300
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


def distribution(name: str, prior: Prior, interval: FloatArray, sizes: FloatArray, kinds: FloatArray) -> str:
    """The SVG of one dimension.

    Parameters
    ----------
    name : of the dimension; prior : over it alone; interval : (3,) mm, its 5 %, 50 % and 95 % quantile
    sizes : (n,) mm of the shipped items; kinds : (n,) their kinds of evidence
    """
    axis = length_axis(prior, sizes)
    grid = np.geomspace(axis.low, axis.high, POINTS)
    density = np.exp(prior.log_density(grid[:, None]))
    edges = np.geomspace(axis.low, axis.high, BINS + 1)
    bars = _stacks(sizes, kinds, edges)
    top = max(float(density.max()), max((sum(stack.values()) for stack in bars), default=0.0))
    low, median, high = interval.tolist()
    height = (BOTTOM - TOP) / top
    curve = path_data(zip(axis.along(grid), BOTTOM - density * height, strict=True))
    band = f'<path class="band" d="M{axis.at(low):.1f} {TOP}H{axis.at(high):.1f}V{BOTTOM}H{axis.at(low):.1f}Z"/>'
    middle = f'<path class="median" d="M{axis.at(median):.1f} {TOP}V{BOTTOM}"/>'
    said = f"{name}: median {length_text(median)}, 90 % interval {range_text(low, high)}, {sizes.size} shipped items"
    body = (
        band + axis.svg(BOTTOM, TOP) + _bars(bars, edges, axis, height) + middle + f'<path class="curve" d="{curve}"/>'
    )
    return svg(WIDTH, BOTTOM + 18, said, body, "distribution")


def _stacks(sizes: FloatArray, kinds: FloatArray, edges: FloatArray) -> list[dict[str, float]]:
    """The density of items over ln mm by kind in each bin."""
    if sizes.size < MIN_HISTOGRAM_ITEMS:
        return []
    width = float(np.log(edges[1] / edges[0])) * sizes.size
    counts = {kind: np.histogram(sizes[kinds == kind], edges)[0] / width for kind in KINDS if (kinds == kind).any()}
    return [{kind: float(count[bin_]) for kind, count in counts.items() if count[bin_]} for bin_ in range(BINS)]


def _bars(bars: list[dict[str, float]], edges: FloatArray, axis: LogAxis, height: float) -> str:
    """Return one path per kind: stacked rectangles."""
    paths: dict[str, list[str]] = {}
    at = axis.along(edges).tolist()
    for number, stack in enumerate(bars):
        left, right = at[number : number + 2]
        floor = float(BOTTOM)
        for kind in KINDS:
            if kind in stack:
                up = stack[kind] * height
                paths.setdefault(kind, []).append(
                    f"M{left:.1f} {floor:.1f}v{-up:.1f}h{right - left - 0.6:.1f}v{up:.1f}z"
                )
                floor -= up
    return "".join(f'<path class="kind-{kind}" d="{"".join(data)}"/>' for kind, data in paths.items())


def scatter(prior: Prior, sizes: FloatArray, kinds: FloatArray) -> str:
    """The SVG of the two dimensions of a prior, the first to the right and the second up.

    Parameters
    ----------
    prior : over two dimensions; sizes : (n, 2) mm of items with both; kinds : (n,)
    """
    across = length_axis(prior.marginal(prior.dims[:1]), sizes[:, 0])
    upward = length_axis(prior.marginal(prior.dims[1:]), sizes[:, 1])
    right = LogAxis(across.low, across.high, LEFT, RIGHT)
    up = LogAxis(upward.low, upward.high, SCATTER_BOTTOM, SCATTER_TOP)
    ticks = [(up.at(tick), length_text(tick)) for tick in up.ticks()]
    lines = "".join(f"M{LEFT} {y:.0f}H{RIGHT}" for y, _ in ticks)
    side = f'<path class="grid" d="{lines}"/>' + "".join(
        f'<text class="end" x="{LEFT - 4}" y="{y + 4:.0f}">{text}</text>' for y, text in ticks
    )
    chosen = np.linspace(0, len(sizes) - 1, min(len(sizes), MAX_SCATTER_POINTS)).astype(int)
    points = "".join(_points(kind, sizes[chosen][kinds[chosen] == kind], right, up) for kind in KINDS)
    curves = "".join(
        f'<path class="contour" d="{path_data(_ellipse(prior, k, right, up))}Z"/>'
        for k in range(len(prior.weights))
        if prior.weights[k] >= 0.05
    )
    window = f'x="{LEFT}" y="{SCATTER_TOP}" width="{RIGHT - LEFT}" height="{SCATTER_BOTTOM - SCATTER_TOP}"'
    # the view box clips points outside of the axes
    view = f'viewBox="{LEFT} {SCATTER_TOP} {RIGHT - LEFT} {SCATTER_BOTTOM - SCATTER_TOP}"'
    inside = f"<svg {window} {view}>{points}{curves}</svg>"
    title = f"{prior.dims[0]} (across) against {prior.dims[1]} (up), {len(chosen)} of {len(sizes)} items"
    return svg(SCATTER_WIDTH, HEIGHT, title, right.svg(SCATTER_BOTTOM, SCATTER_TOP) + side + inside, "scatter")


def _points(kind: str, sizes: FloatArray, right: LogAxis, up: LogAxis) -> str:
    if not len(sizes):
        return ""
    places = zip(right.along(sizes[:, 0]).tolist(), up.along(sizes[:, 1]).tolist(), strict=True)
    data = "".join(f"M{x:.0f} {y:.0f}h0" for x, y in places)
    return f'<path class="dots dots-{kind}" d="{data}"/>'


def _ellipse(prior: Prior, k: int, right: LogAxis, up: LogAxis) -> list[tuple[float, float]]:
    """Return the pixels of the ellipse with 90 % of the mass of one component."""
    covariance = prior.covariances[k] + prior.shared_covariance
    lower = np.linalg.cholesky(covariance) * np.sqrt(RADIUS_SQUARED)
    angles = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    logs = prior.means[k] + np.stack([np.cos(angles), np.sin(angles)], axis=1) @ lower.T  # (36, 2)
    sizes = np.exp(logs)
    return list(zip(right.along(sizes[:, 0]).tolist(), up.along(sizes[:, 1]).tolist(), strict=True))
