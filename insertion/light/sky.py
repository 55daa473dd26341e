"""The light outdoors: which pixels show the sky, what it is where no picture shows it, and what the sun sends.

The sky is infinitely far: a pixel of it says the same direction at every place. What no picture shows of the upper half
is sky as well, as bright as the sky that is seen at its height. Pictures hold neither the sun nor a bright sky. How
much light there is says the ground, which reflects a quarter of it, and its colour is grey: cameras balance white.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insertion.colour import luminance
from insertion.light.environment_map import HEIGHT, map_directions, solid_angles
from metric_base.arrays import BoolArray, FloatArray

__all__ = ["FREE_PX", "LEAST_SHARE", "Outdoors", "sky_light", "sky_pixels"]

#: Pixels of the sky have no point of the cloud within so many pixels at a width of 640, rise above the horizon, and are
#: either clipped (of 1) or no redder than this times their blue, and not dark.
FREE_PX, NOT_RED, NOT_DARK = 12.0, 1.05, 0.15
CLIPPED = 0.9
#: A scene is outdoors if this share of all pixels shows the sky: in the two rooms and two streets that it was set by,
#: none and a sixth.
LEAST_SHARE = 0.05
#: What is not seen within so many cells of what stands there belongs to it; the rest is sky.
BESIDE_CELLS = 4
#: Rows of the environment over which the sky is alike, one sigma.
ALIKE_ROWS = 6.0
#: Ground outdoors (grass, asphalt, concrete, earth) reflects 0.1 to 0.35.
GROUND_ALBEDO = 0.25
#: The sky is at least and at most so many times as bright as the picture holds.
TIMES = (0.3, 8.0)


@dataclass(frozen=True, slots=True, eq=False)
class Outdoors:
    """The light of a place under the sky; sun : (3,) unit vector towards the sun, None where no shadow says where."""

    sun: FloatArray | None


def sky_pixels(colours: NDArray[np.float32], rise: FloatArray, free: FloatArray) -> BoolArray:
    """(...) whether each pixel shows the sky.

    colours : (..., 3) linear; rise : (...) upward component of its unit ray; free : (...) pixels to the nearest point
    of the cloud, at a width of 640.
    """
    bright = (colours[..., 0] <= NOT_RED * colours[..., 2]) & (luminance(colours) > NOT_DARK)
    return np.asarray((rise > 0) & (free > FREE_PX) & (bright | (colours.max(axis=-1) > CLIPPED)))


def sky_light(
    shown: FloatArray, seen: FloatArray, sky: FloatArray, ground: float, sun: FloatArray | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The light with the whole sky in it: (h, w, 3) radiance, (h, w) how far it is known, (3,) what the sun sends.

    shown : (h, w, 3) radiance by direction; seen : (h, w) how far it is known; sky : (h, w) share of it that is sky;
    ground : luminance of the ground in the pictures; sun : (3,) the way to it. What the sun sends is the irradiance
    across its light, 0 where it is not known, or hidden by what stands there. Without it the sky makes up for it.
    """
    from scipy.ndimage import distance_transform_edt

    directions = map_directions()
    up = directions[..., 2]
    stands = np.tile(
        (seen > 0) & (sky < 0.5) & (up > 0), (1, 3)
    )  # three times around, for the neighbours beyond the edge
    beside = distance_transform_edt(~stands)[:, up.shape[1] : 2 * up.shape[1]] <= BESIDE_CELLS
    filled = (up > 0) & (seen == 0) & ~beside
    of_sky = np.where(seen > 0, sky, 1.0 * filled)[..., None]
    whole = np.where(filled[..., None], _by_height(shown, seen * (sky >= 0.5))[:, None], shown)
    below = (up < 0) & (seen == 0)
    if (seen[up < 0] > 0).any():
        whole = np.where(below[..., None], _by_height(shown, seen * (up < 0))[:, None], whole)
    weight = (np.maximum(up, 0.0) * solid_angles()[:, None])[..., None]
    from_sky, other = ((weight * whole * part).sum(axis=(0, 1)) for part in (of_sky, 1 - of_sky))
    wanted = max(np.pi * ground / GROUND_ALBEDO, float(luminance(from_sky + other)))  # grey: the camera balances white
    known = np.where(filled | below, 1.0, seen)
    if sun is not None and of_sky.ravel()[(directions @ sun).argmax()] >= 0.5:
        return whole, known, np.maximum(wanted - from_sky - other, 0.0) / sun[2]
    times = np.clip((wanted - other) / np.maximum(from_sky, 1e-9), *TIMES)
    return whole * (1 + (times - 1) * of_sky), known, np.zeros(3)


def _by_height(shown: FloatArray, weight: FloatArray) -> FloatArray:
    """(h, 3) mean of a map (h, w, 3) by its rows, smooth over them; weight : (h, w)."""
    from scipy.ndimage import gaussian_filter1d

    sums = gaussian_filter1d(np.einsum("hw,hwc->hc", weight, shown), ALIKE_ROWS, axis=0, mode="constant")
    counts = gaussian_filter1d(weight.sum(axis=1), ALIKE_ROWS, mode="constant")
    row = np.arange(HEIGHT)
    some = row[counts > 1e-3 * max(float(counts.max()), 1e-12)]
    nearest = some[np.abs(row[:, None] - some).argmin(axis=1)]  # the zenith is as bright as the highest that is seen
    return np.asarray(sums[nearest] / counts[nearest, None])
