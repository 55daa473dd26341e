"""Light samples of an environment: points of its lamps, and the median cut of the ambient light (Debevec 2005).

The ambient map is divided in two parts of equal energy, repeatedly; each part becomes a directional light at its centre
of energy. A lamp becomes points in its volume, which makes its shadow soft. Each point has a distance, because the
light of a lamp at two metres changes over an object of half a metre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insertion.colour import LUMINANCE, luminance
from insertion.light.environment_map import Environment, SphereLights, map_directions, solid_angles
from metric_base.arrays import BoolArray, FloatArray

#: Standard deviation of the points of a lamp about its centre, in diameters.
LAMP_SIGMA = 0.35
#: Energy that is added everywhere before the map is divided, as a multiple of the mean. It limits the size of the parts
#: without much light, whose shadow would have a hard edge.
UNIFORM_ENERGY = 1.0
#: Minimum distance of a light, in radii of the lit object: closer lights need a wider angle than a shadow map has.
MIN_DISTANCE_RADII = 2.0
#: Minimum cosine with the vertical of a light above the horizon.
MIN_ELEVATION_COSINE = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class LightSamples:
    """Point and directional lights about a position."""

    directions: FloatArray  #: (n, 3) unit vectors towards the lights
    power: FloatArray  #: (n, 3) irradiance across the light at the position
    near: FloatArray  #: (n,) inverse of the distance, 0 for a directional light
    angle: FloatArray  #: (n,) solid angle in steradians that the light represents, 0 for a point

    def subset(self, keep: BoolArray) -> LightSamples:
        """Return the lights selected by `keep` (n,)."""
        return LightSamples(self.directions[keep], self.power[keep], self.near[keep], self.angle[keep])

    def above_horizon(self, up: FloatArray) -> LightSamples:
        """Return the lights above the horizon; `up` is a unit vector (3,)."""
        return self.subset(self.directions @ up > MIN_ELEVATION_COSINE)

    def scaled(self, unit: float) -> LightSamples:
        """Return the lights with lengths in multiples of `unit`."""
        return LightSamples(self.directions, self.power, self.near * unit, self.angle)

    def seen_from(self, offset: FloatArray, radius: float) -> LightSamples:
        """Return the lights about the position at `offset` (3,), for an object of a radius."""
        toward = self.directions - offset * self.near[:, None]  # (n, 3) in multiples of the distance
        length = np.maximum(np.linalg.norm(toward, axis=1), 1e-6)
        near = np.minimum(self.near / length, 1 / max(MIN_DISTANCE_RADII * radius, 1e-9))
        return LightSamples(toward / length[:, None], self.power / length[:, None] ** 2, near, self.angle)


def sample_lights(environment: Environment, cuts: int) -> LightSamples:
    """Return lights with the energy of an environment.

    Parameters
    ----------
    environment : Environment
        Environment map, with or without lamps.
    cuts : int
        Number of divisions. There are at most 2 ** cuts directional lights, and half as many points of lamps.
    """
    if environment.lamps is None or environment.ambient is None:
        return median_cut(environment, environment.radiance, cuts)
    lamps = sample_lamps(environment.lamps, 2 ** (cuts - 1))
    ambient = median_cut(environment, environment.ambient, cuts)
    pairs = [(getattr(lamps, name), getattr(ambient, name)) for name in ("directions", "power", "near", "angle")]
    return LightSamples(*(np.concatenate(pair) for pair in pairs))


def sample_lamps(lamps: SphereLights, count: int) -> LightSamples:
    """Return `count` points of the lamps that contribute the same luminance at the centre of the environment."""
    from scipy.special import ndtri

    distance = np.linalg.norm(lamps.positions - lamps.centre, axis=1)
    received = luminance(lamps.power) / np.maximum(distance, 1e-9) ** 2
    cumulative = np.cumsum(received) / max(float(received.sum()), 1e-12)
    row = np.searchsorted(cumulative, (np.arange(count) + 0.5) / count).clip(0, len(cumulative) - 1)
    # Roberts' sequence covers a cube evenly; the inverse normal distribution makes a ball of it
    steps = np.mod(0.5 + np.outer(np.arange(1, count + 1), [0.8191725, 0.6710436, 0.5497005]), 1.0)
    toward = lamps.positions[row] + LAMP_SIGMA * lamps.size[row, None] * ndtri(steps) - lamps.centre
    length = np.maximum(np.linalg.norm(toward, axis=1), lamps.size[row] / 2)
    toward = toward / np.linalg.norm(toward, axis=1, keepdims=True)
    colour = lamps.power[row] / np.maximum(luminance(lamps.power[row]), 1e-12)[:, None]
    return LightSamples(toward, colour * float(received.sum()) / count, 1 / length, np.zeros(count))


def median_cut(environment: Environment, radiance: NDArray[np.float32], cuts: int) -> LightSamples:
    """Return at most 2 ** cuts directional lights with the energy of a map (h, w, 3) on the axes of `environment`."""
    area = np.broadcast_to(solid_angles()[:, None], radiance.shape[:2])
    energy = radiance.astype(np.float64) * area[..., None]  # (h, w, 3)
    weight = energy @ LUMINANCE.astype(np.float64) + 1e-12
    weight += UNIFORM_ENERGY * area * (weight.sum() / area.sum())
    directions = map_directions()
    boxes = [(0, energy.shape[0], 0, energy.shape[1])]
    for _ in range(cuts):
        boxes = [part for box in boxes for part in divide_box(weight, box)]
    centres, powers, angles = [], [], []
    for top, bottom, left, right in boxes:
        centre = np.einsum("hw,hwc->c", weight[top:bottom, left:right], directions[top:bottom, left:right])
        centres.append(centre / max(float(np.linalg.norm(centre)), 1e-12))
        powers.append(energy[top:bottom, left:right].sum(axis=(0, 1)))
        angles.append(float(area[top:bottom, left:right].sum()))
    none = np.zeros(len(centres))
    return LightSamples(np.array(centres) @ environment.basis, np.array(powers), none, np.array(angles))


def divide_box(weight: FloatArray, box: tuple[int, int, int, int]) -> list[tuple[int, int, int, int]]:
    """Divide a box of a map across its longer side on the sphere, at half of its energy.

    Parameters
    ----------
    weight : (h, w) ndarray of float
        Energy of each cell.
    box : tuple of int
        First and last row and column, without the ends.

    Returns
    -------
    list of tuple of int
        Two boxes of at least one cell; the box itself if it is one cell.
    """
    top, bottom, left, right = box
    height, width = bottom - top, right - left
    shortening = np.sin((top + bottom) / 2 * np.pi / weight.shape[0])
    part = weight[top:bottom, left:right]
    if height <= 1 and width <= 1:
        return [box]
    is_wide = width > 1 and (width * shortening >= height or height <= 1)
    sums = part.sum(axis=0) if is_wide else part.sum(axis=1)
    total = np.cumsum(sums)
    cut = int(np.clip(np.searchsorted(total, total[-1] / 2) + 1, 1, len(sums) - 1))
    if is_wide:
        return [(top, bottom, left, left + cut), (top, bottom, left + cut, right)]
    return [(top, top + cut, left, right), (top + cut, bottom, left, right)]
