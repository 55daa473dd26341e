"""Planes of one colour each, lit alike or not: how well a field of light explains the brightness of their cells."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insertion.colour import luminance
from insertion.light.lamp_candidates import UPRIGHT
from insertion.scene.occupancy import Occupancy
from insertion.scene.plane_cells import Patches
from metric_base.arrays import BoolArray, FloatArray

__all__ = ["LitPlanes", "lit_planes", "log_posterior"]

#: Widths of the errors of cells' log luminance (texture, uneven ambient light): what is tried. Shadows whose edge is
#: wrong make few large errors.
CELL_WIDTHS = np.geomspace(0.03, 0.4, 6)
#: Neighbouring cells err alike: all cells together count as so many.
INDEPENDENT_CELLS = 60
#: One sigma of log albedo between walls (often painted alike) and between other planes.
WALL_SIGMA, OTHER_SIGMA = 0.35, 0.8


@dataclass(frozen=True, slots=True, eq=False)
class LitPlanes:
    """What is explained: the cells, and what casts shadows on them.

    walls : (k,) whether each plane is upright; shown : (n,) irradiance of the cells by what the pictures show, over its
    mean; missing : (n,) that of what they do not show if it were as bright as the rest; times : how bright it is;
    tint : (n, 3) colour of the ambient light over its luminance.
    """

    patches: Patches
    occupancy: Occupancy | None
    walls: BoolArray
    shown: FloatArray
    missing: FloatArray
    unit: float
    times: float = 1.0
    tint: FloatArray | None = None

    def ambient(self, times: float) -> FloatArray:
        """(n,) ambient irradiance on the cells."""
        return np.asarray(self.shown + times * self.missing)


def lit_planes(patches: Patches, up: FloatArray, occupancy: Occupancy | None) -> LitPlanes:
    """The cells with which planes are walls; up : (3,) unit vector."""
    first = [int(np.argmax(patches.plane == k)) for k in range(int(patches.plane.max()) + 1)]
    walls = np.asarray(np.abs(patches.normals[first] @ up) < UPRIGHT)
    if occupancy is None:
        return LitPlanes(patches, None, walls, np.zeros(len(patches.plane)), np.ones(len(patches.plane)), 1.0)
    colours, missing = occupancy.gathered_light(patches.places, patches.normals)
    mean = colours.sum(axis=0) / max(float((1 - missing).sum()), 1e-9)  # pi times the mean radiance of what is shown
    whole = colours + missing[:, None] * mean
    tint = whole / np.maximum(luminance(whole), 1e-12)[:, None]
    shown, bright = luminance(colours).astype(np.float64), float(luminance(mean))
    unit = float((shown + bright * missing).mean())
    return LitPlanes(patches, occupancy, walls, shown / unit, bright * missing / unit, unit, tint=np.asarray(tint))


def log_posterior(planes: LitPlanes, fields: FloatArray, values: FloatArray | None = None) -> FloatArray:
    """(c,) log posterior of fields (c, n) of irradiance over the ambient one.

    values : (n,) log radiance that they explain, the luminance without.
    """
    plane, walls = planes.patches.plane, planes.walls
    own = planes.patches.log_luminance if values is None else values
    rest = (own - np.log(fields)).astype(np.float32)  # (c, n)
    albedos = []
    ends = np.searchsorted(plane, np.arange(len(walls) + 1))
    for start, end in itertools.pairwise(ends):
        middle = np.partition(rest[:, start:end], (end - start) // 2, axis=1)[:, (end - start) // 2]
        rest[:, start:end] -= middle[:, None]
        albedos.append(middle)
    total = min(INDEPENDENT_CELLS, len(plane)) * _log_likelihood(rest)
    albedo = np.array(albedos, dtype=np.float64)  # (k, c)
    for kind, sigma in ((walls, WALL_SIGMA), (np.ones(len(walls), dtype=bool), OTHER_SIGMA)):
        if kind.sum() > 1:
            total -= 0.5 * (((albedo[kind] - albedo[kind].mean(axis=0)) / sigma) ** 2).sum(axis=0)
    return total


def _log_likelihood(errors: NDArray[np.float32]) -> FloatArray:
    """(c,) mean log likelihood of errors (c, n) under the Cauchy distribution of the width that explains them best."""
    squares = np.square(errors)
    each = [np.log1p(squares / np.float32(width**2)).mean(axis=1) + np.log(width) for width in CELL_WIDTHS]
    return np.asarray(-np.min(each, axis=0), dtype=np.float64)
