"""An environment: the radiance that arrives at one place, as an equirectangular map about the vertical."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray

WIDTH, HEIGHT = 128, 64


@dataclass(frozen=True, slots=True, eq=False)
class LampSpots:
    """Where the lamps are: soft balls at a finite distance, so that their light changes over an object.

    places : (k, 3) in the scene; power : (k, 3) linear, the irradiance across the light times the squared distance;
    size : (k,) diameter, scene units; middle : (3,) the place that the environment is about.
    """

    places: FloatArray
    power: FloatArray
    size: FloatArray
    middle: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Environment:
    """Radiance around a place.

    radiance : (HEIGHT, WIDTH, 3) linear, rows from up to down, columns by the azimuth from -180 degrees about `basis`;
    basis : (3, 3) rows two horizontal unit axes and up, in the scene; seen : (HEIGHT, WIDTH) share that the pictures
    show, the rest is filled in; rest : the radiance without the lamps, None where no lamp is known; lamps : these.
    """

    radiance: NDArray[np.float32]
    basis: FloatArray
    seen: NDArray[np.float32]
    rest: NDArray[np.float32] | None = None
    lamps: LampSpots | None = None

    def irradiance(self, normal: FloatArray) -> FloatArray:
        """(3,) irradiance on a surface with this unit normal (3,): the integral of radiance times the cosine."""
        cosine = np.maximum(map_directions() @ (self.basis @ normal), 0.0)  # (h, w)
        weight = cosine * solid_angles()[:, None]
        return np.asarray(np.einsum("hw,hwc->c", weight, self.radiance))


def map_directions(height: int = HEIGHT, width: int = WIDTH) -> FloatArray:
    """(h, w, 3) unit direction of every cell along the environment's own axes."""
    polar = (np.arange(height) + 0.5) * np.pi / height
    turn = (np.arange(width) + 0.5) * 2 * np.pi / width - np.pi
    sine = np.sin(polar)[:, None]
    flat = [sine * np.cos(turn), sine * np.sin(turn), np.broadcast_to(np.cos(polar)[:, None], (height, width))]
    return np.stack(flat, axis=-1)


def solid_angles(height: int = HEIGHT, width: int = WIDTH) -> FloatArray:
    """(h,) solid angle in steradians of a cell in each row."""
    edges = np.cos(np.arange(height + 1) * np.pi / height)
    return np.asarray((edges[:-1] - edges[1:]) * 2 * np.pi / width)


#: Levels above the sharp one; the shader interpolates between them by the square root of the roughness.
LEVELS = 4
_SOURCE = (32, 64)


def reflection_levels(environment: Environment) -> list[NDArray[np.float32]]:
    """LEVELS + 1 maps (h, w, 3), each half as high and wide as the last.

    Level k is the convolution with the GGX lobe of alpha = roughness^2 about the mirrored direction, with the view
    along the normal (the usual split of the reflection integral).
    """
    source = _shrink(environment.radiance, *_SOURCE)
    directions = map_directions(*_SOURCE).reshape(-1, 3)
    weight = np.repeat(solid_angles(*_SOURCE), _SOURCE[1])  # (s,)
    levels = [environment.radiance]
    for level in range(1, LEVELS + 1):
        shape = (HEIGHT >> level, WIDTH >> level)
        lobe = _lobe(map_directions(*shape).reshape(-1, 3) @ directions.T, (level / LEVELS) ** 2) * weight
        lobe /= lobe.sum(axis=1, keepdims=True)
        levels.append((lobe @ source.reshape(-1, 3)).reshape(*shape, 3).astype(np.float32))
    return levels


def _lobe(cosine: FloatArray, roughness: float) -> FloatArray:
    """GGX about the half vector of directions with these cosines, of any shape, times the light's own cosine."""
    alpha2 = max(roughness, 0.05) ** 4
    half2 = (1 + np.clip(cosine, -1, 1)) / 2  # squared cosine of half the angle
    return np.asarray(alpha2 / (half2 * (alpha2 - 1) + 1) ** 2 * np.maximum(cosine, 0.0))


def _shrink(picture: NDArray[np.float32], height: int, width: int) -> FloatArray:
    """(h, w, 3) means of the blocks of a picture."""
    rows, columns = picture.shape[0] // height, picture.shape[1] // width
    return np.asarray(picture.reshape(height, rows, width, columns, 3).mean(axis=(1, 3)), dtype=np.float64)
