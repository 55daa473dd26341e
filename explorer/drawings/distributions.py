"""The distribution of one dimension: the prior's density, the items' histogram by kind, the median and the interval."""

from __future__ import annotations

import numpy as np

from explorer.content.units import length_text, range_text
from explorer.drawings.axis import LEAST_GAP, LogAxis, path_data, svg
from metric_base.arrays import FloatArray
from metric_tree.prior import Prior

__all__ = ["KINDS", "distribution", "length_axis"]

#: Kinds of evidence in the order in which they are stacked: the strongest at the bottom.
KINDS = ("measured", "product", "standard", "norm", "statistic", "museum", "asset", "curated", "judged", "default")

WIDTH, TOP, BOTTOM = 340, 8, 118

#: Half of the widest length in words stands beside the ends of the axis.
MARGIN = LEAST_GAP / 2

#: Points of the curve and bins of the histogram.
POINTS, BINS = 49, 24

#: Fewest items for a histogram; fewer are drawn as marks under the curve.
LEAST_BARS = 8

#: Half-width of the axis in standard deviations of ln size, which holds 99.7 % of a normal distribution.
REACH_SD = 3.0

#: Items at either end that the axis may leave out.
TRIM = 0.5


def length_axis(prior: Prior, sizes: FloatArray) -> LogAxis:
    """The axis of a prior of one dimension and the sizes (n,) in mm of its items."""
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
    if sizes.size < LEAST_BARS:
        return []
    width = float(np.log(edges[1] / edges[0])) * sizes.size
    counts = {kind: np.histogram(sizes[kinds == kind], edges)[0] / width for kind in KINDS if (kinds == kind).any()}
    return [{kind: float(count[bin_]) for kind, count in counts.items() if count[bin_]} for bin_ in range(BINS)]


def _bars(bars: list[dict[str, float]], edges: FloatArray, axis: LogAxis, height: float) -> str:
    """One path for each kind: rectangles that stand on those of the kinds before it."""
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
