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
    side = "".join(
        f'<path class="grid" d="M{LEFT} {up.at(tick):.1f}H{RIGHT}"/>'
        f'<text x="{LEFT - 4}" y="{up.at(tick) + 4:.1f}" text-anchor="end">{length_text(tick)}</text>'
        for tick in up.ticks()
    )
    chosen = np.linspace(0, len(sizes) - 1, min(len(sizes), MOST_POINTS)).astype(int)
    points = "".join(_points(kind, sizes[chosen][kinds[chosen] == kind], right, up) for kind in KINDS)
    curves = "".join(
        f'<path class="contour" d="{path_data(_ellipse(prior, k, right, up))}Z"/>'
        for k in range(len(prior.weights))
        if prior.weights[k] >= 0.05
    )
    title = f"{prior.dims[0]} (across) against {prior.dims[1]} (up), {len(chosen)} of {len(sizes)} items"
    return svg(WIDTH, HEIGHT, title, right.svg(BOTTOM, TOP) + side + points + curves, "scatter")


def _points(kind: str, sizes: FloatArray, right: LogAxis, up: LogAxis) -> str:
    if not len(sizes):
        return ""
    data = "".join(f"M{right.at(a):.1f} {up.at(b):.1f}h0" for a, b in sizes)
    return f'<path class="dots dots-{kind}" d="{data}"/>'


def _ellipse(prior: Prior, k: int, right: LogAxis, up: LogAxis) -> list[tuple[float, float]]:
    """Pixels of the curve that holds nine tenths of one component."""
    covariance = prior.covariances[k] + prior.shared_covariance
    lower = np.linalg.cholesky(covariance) * np.sqrt(RADIUS_SQUARED)
    angles = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    logs = prior.means[k] + np.stack([np.cos(angles), np.sin(angles)], axis=1) @ lower.T  # (36, 2)
    return [(right.at(a), up.at(b)) for a, b in np.exp(logs)]
