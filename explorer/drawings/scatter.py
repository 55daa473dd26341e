"""One dimension against another: the items by kind, and the curve that holds nine tenths of the prior."""

from __future__ import annotations

import numpy as np

from explorer.content.units import length_text
from explorer.drawings.axis import LogAxis, path_data, svg
from explorer.drawings.distributions import KINDS, length_axis
from metric_base.arrays import FloatArray
from metric_tree.prior import Prior

__all__ = ["scatter"]

WIDTH, HEIGHT, LEFT, BOTTOM, TOP, RIGHT = 340, 230, 46, 206, 8, 330

#: Items drawn at most: a page stays light, and more points are one blot.
MOST_POINTS = 300

#: Squared Mahalanobis radius that holds 0.9 of a Gaussian of two dimensions: -2 ln 0.1.
RADIUS_SQUARED = -2 * np.log(0.1)


def scatter(prior: Prior, sizes: FloatArray, kinds: FloatArray) -> str:
    """The SVG of the two dimensions of a prior, the first to the right and the second up.

    Parameters
    ----------
    prior : over two dimensions; sizes : (n, 2) mm of items with both; kinds : (n,)
    """
    across = length_axis(prior.marginal(prior.dims[:1]), sizes[:, 0])
    upward = length_axis(prior.marginal(prior.dims[1:]), sizes[:, 1])
    right = LogAxis(across.low, across.high, LEFT, RIGHT)
    up = LogAxis(upward.low, upward.high, BOTTOM, TOP)
    ticks = [(up.at(tick), length_text(tick)) for tick in up.ticks()]
    lines = "".join(f"M{LEFT} {y:.0f}H{RIGHT}" for y, _ in ticks)
    side = f'<path class="grid" d="{lines}"/>' + "".join(
        f'<text class="end" x="{LEFT - 4}" y="{y + 4:.0f}">{text}</text>' for y, text in ticks
    )
    chosen = np.linspace(0, len(sizes) - 1, min(len(sizes), MOST_POINTS)).astype(int)
    points = "".join(_points(kind, sizes[chosen][kinds[chosen] == kind], right, up) for kind in KINDS)
    curves = "".join(
        f'<path class="contour" d="{path_data(_ellipse(prior, k, right, up))}Z"/>'
        for k in range(len(prior.weights))
        if prior.weights[k] >= 0.05
    )
    window = f'x="{LEFT}" y="{TOP}" width="{RIGHT - LEFT}" height="{BOTTOM - TOP}"'
    view = f'viewBox="{LEFT} {TOP} {RIGHT - LEFT} {BOTTOM - TOP}"'  # what leaves the axes is cut off at their frame
    inside = f"<svg {window} {view}>{points}{curves}</svg>"
    title = f"{prior.dims[0]} (across) against {prior.dims[1]} (up), {len(chosen)} of {len(sizes)} items"
    return svg(WIDTH, HEIGHT, title, right.svg(BOTTOM, TOP) + side + inside, "scatter")


def _points(kind: str, sizes: FloatArray, right: LogAxis, up: LogAxis) -> str:
    if not len(sizes):
        return ""
    places = zip(right.along(sizes[:, 0]).tolist(), up.along(sizes[:, 1]).tolist(), strict=True)
    data = "".join(f"M{x:.0f} {y:.0f}h0" for x, y in places)
    return f'<path class="dots dots-{kind}" d="{data}"/>'


def _ellipse(prior: Prior, k: int, right: LogAxis, up: LogAxis) -> list[tuple[float, float]]:
    """Pixels of the curve that holds nine tenths of one component."""
    covariance = prior.covariances[k] + prior.shared_covariance
    lower = np.linalg.cholesky(covariance) * np.sqrt(RADIUS_SQUARED)
    angles = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    logs = prior.means[k] + np.stack([np.cos(angles), np.sin(angles)], axis=1) @ lower.T  # (36, 2)
    sizes = np.exp(logs)
    return list(zip(right.along(sizes[:, 0]).tolist(), up.along(sizes[:, 1]).tolist(), strict=True))
