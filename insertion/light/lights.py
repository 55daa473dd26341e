"""Directional lights that stand in for an environment: the median cut of its energy (Debevec 2005).

The map is cut in two where both parts have the same energy, again and again; each part becomes a light at its
centre of energy. Bright parts get many lights close together, which is what makes their shadows soft.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insertion.light.environment import Environment, map_directions, solid_angles
from insertion.records.encoding import LUMINANCE
from metric_base.arrays import FloatArray

__all__ = ["Lights", "directional_lights"]


@dataclass(frozen=True, slots=True, eq=False)
class Lights:
    """directions : (n, 3) unit, towards the lights, in the scene; power : (n, 3) radiance times solid angle."""

    directions: FloatArray
    power: FloatArray

    def above(self, up: FloatArray) -> Lights:
        """The lights above the horizon; `up` is a unit vector (3,)."""
        kept = self.directions @ up > 0.01
        return Lights(self.directions[kept], self.power[kept])


def directional_lights(environment: Environment, cuts: int) -> Lights:
    """At most 2 ** cuts lights with the energy of the environment."""
    energy = environment.radiance.astype(np.float64) * solid_angles()[:, None, None]  # (h, w, 3)
    bright = energy @ LUMINANCE.astype(np.float64) + 1e-12
    directions = map_directions()
    boxes = [(0, energy.shape[0], 0, energy.shape[1])]
    for _ in range(cuts):
        boxes = [part for box in boxes for part in _halves(bright, box)]
    rows, powers = [], []
    for top, bottom, left, right in boxes:
        part = bright[top:bottom, left:right]
        centre = np.einsum("hw,hwc->c", part, directions[top:bottom, left:right])
        rows.append(centre / max(float(np.linalg.norm(centre)), 1e-12))
        powers.append(energy[top:bottom, left:right].sum(axis=(0, 1)))
    return Lights(np.array(rows) @ environment.basis, np.array(powers))


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
