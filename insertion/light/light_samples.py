"""Lights that stand in for an environment: points of its lamps, and the median cut of the rest (Debevec 2005).

The map of the rest is cut in two where both parts have the same energy, again and again; each part becomes a light at
its centre of energy, infinitely far away. A lamp becomes points all over it, which is what makes its shadow soft; each
has its distance, for the light of a lamp two metres away changes over an object half a metre wide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insertion.colour import LUMINANCE, luminance
from insertion.light.environment_map import Environment, LampSpots, map_directions, solid_angles
from metric_base.arrays import BoolArray, FloatArray

#: One sigma of the points of a lamp about its middle, in its diameters.
LAMP_SIGMA = 0.35
#: The map is cut by its energy plus so much of its mean everywhere.
EVEN = 1.0
#: A light is no nearer than so many radii of what it shines at, where its shadow map would need a wider angle.
LEAST_RADII = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Lights:
    """directions : (n, 3) unit, towards the lights; power : (n, 3) irradiance across the light at the middle.

    near : (n,) one over the distance, 0 for infinitely far; angle : (n,) solid angle in steradians that the light
    stands for, 0 for a point.
    """

    directions: FloatArray
    power: FloatArray
    near: FloatArray
    angle: FloatArray

    def rows(self, kept: BoolArray) -> Lights:
        """Those lights of which `kept` (n,) says so."""
        return Lights(self.directions[kept], self.power[kept], self.near[kept], self.angle[kept])

    def above(self, up: FloatArray) -> Lights:
        """The lights above the horizon; `up` is a unit vector (3,)."""
        return self.rows(self.directions @ up > 0.01)

    def in_unit(self, unit: float) -> Lights:
        """The lights with lengths in another unit."""
        return Lights(self.directions, self.power, self.near * unit, self.angle)

    def about(self, offset: FloatArray, radius: float) -> Lights:
        """The lights as seen from a place at `offset` (3,) from their middle, about which something has the radius."""
        away = self.directions - offset * self.near[:, None]  # (n, 3) in units of the distance
        length = np.maximum(np.linalg.norm(away, axis=1), 1e-6)
        near = np.minimum(self.near / length, 1 / max(LEAST_RADII * radius, 1e-9))
        return Lights(away / length[:, None], self.power / length[:, None] ** 2, near, self.angle)


def environment_lights(environment: Environment, cuts: int) -> Lights:
    """At most 2 ** cuts lights with the energy of the environment, and half as many for its lamps where it has any."""
    if environment.lamps is None or environment.rest is None:
        return _cut(environment, environment.radiance, cuts)
    lamps, rest = (_points(environment.lamps, 2 ** (cuts - 1)), _cut(environment, environment.rest, cuts))
    pairs = [(getattr(lamps, k), getattr(rest, k)) for k in ("directions", "power", "near", "angle")]
    return Lights(*(np.concatenate(pair) for pair in pairs))


def _points(lamps: LampSpots, count: int) -> Lights:
    """`count` points of the lamps, each with the same luminance at the middle."""
    from scipy.special import ndtri

    distance = np.linalg.norm(lamps.places - lamps.middle, axis=1)
    reaching = luminance(lamps.power) / np.maximum(distance, 1e-9) ** 2
    share = np.cumsum(reaching) / max(float(reaching.sum()), 1e-12)
    row = np.searchsorted(share, (np.arange(count) + 0.5) / count).clip(0, len(share) - 1)
    # Roberts' sequence: points that cover a cube evenly, here made normal
    steps = np.mod(0.5 + np.outer(np.arange(1, count + 1), [0.8191725, 0.6710436, 0.5497005]), 1.0)
    away = lamps.places[row] + LAMP_SIGMA * lamps.size[row, None] * ndtri(steps) - lamps.middle
    length = np.maximum(np.linalg.norm(away, axis=1), lamps.size[row] / 2)
    away = away / np.linalg.norm(away, axis=1, keepdims=True)
    colour = lamps.power[row] / np.maximum(luminance(lamps.power[row]), 1e-12)[:, None]
    return Lights(away, colour * float(reaching.sum()) / count, 1 / length, np.zeros(count))


def _cut(environment: Environment, radiance: NDArray[np.float32], cuts: int) -> Lights:
    """At most 2 ** cuts infinitely far lights with the energy of a map (h, w, 3)."""
    area = np.broadcast_to(solid_angles()[:, None], radiance.shape[:2])
    energy = radiance.astype(np.float64) * area[..., None]  # (h, w, 3)
    bright = energy @ LUMINANCE.astype(np.float64) + 1e-12
    # no light stands for a wide dark part, or what hides it would have a hard edge
    bright += EVEN * area * (bright.sum() / area.sum())
    directions = map_directions()
    boxes = [(0, energy.shape[0], 0, energy.shape[1])]
    for _ in range(cuts):
        boxes = [part for box in boxes for part in _halves(bright, box)]
    rows, powers, angles = [], [], []
    for top, bottom, left, right in boxes:
        part = bright[top:bottom, left:right]
        centre = np.einsum("hw,hwc->c", part, directions[top:bottom, left:right])
        rows.append(centre / max(float(np.linalg.norm(centre)), 1e-12))
        powers.append(energy[top:bottom, left:right].sum(axis=(0, 1)))
        angles.append(float(area[top:bottom, left:right].sum()))
    return Lights(np.array(rows) @ environment.basis, np.array(powers), np.zeros(len(rows)), np.array(angles))


def _halves(bright: FloatArray, box: tuple[int, int, int, int]) -> list[tuple[int, int, int, int]]:
    """The box of a map (h, w) cut across its longer side on the sphere where the energy halves; a cell stays whole."""
    top, bottom, left, right = box
    height, width = bottom - top, right - left
    middle = np.sin((top + bottom) / 2 * np.pi / bright.shape[0])
    part = bright[top:bottom, left:right]
    if height <= 1 and width <= 1:
        return [box]
    if width > 1 and (width * middle >= height or height <= 1):
        cut = left + _half(part.sum(axis=0))
        return [(top, bottom, left, cut), (top, bottom, cut, right)]
    cut = top + _half(part.sum(axis=1))
    return [(top, cut, left, right), (cut, bottom, left, right)]


def _half(sums: FloatArray) -> int:
    """Cells on the first side of the cut of sums (n,), at least one on each."""
    total = np.cumsum(sums)
    return int(np.clip(np.searchsorted(total, total[-1] / 2) + 1, 1, len(sums) - 1))
