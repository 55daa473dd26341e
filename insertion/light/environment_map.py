"""Environment map: the radiance that arrives at one position, equirectangular about the vertical."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from insertion.scene.occupancy import Occupancy
from metric_base.arrays import FloatArray

#: Columns and rows of an environment map.
WIDTH, HEIGHT = 128, 64
#: Cells of the map of sharp reflections per cell of an environment map, along a side.
MIRROR = 4
#: Number of blurred levels of the prefiltered environment. The shader interpolates between levels by the square root of
#: the roughness.
LEVELS = 4
#: Rows and columns of the map that the blurred levels are computed from.
_SOURCE_SHAPE = (32, 64)
#: Minimum roughness of a blurred level; smaller lobes are narrower than a cell of the source.
MIN_ROUGHNESS = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class SphereLights:
    """Lamps as soft spheres at a finite distance, so that their light changes over an object."""

    positions: FloatArray  #: (k, 3) in the scene
    power: FloatArray  #: (k, 3) linear, irradiance across the light times the squared distance
    size: FloatArray  #: (k,) diameter, scene units
    centre: FloatArray  #: (3,) position of the environment map
    occupancy: Occupancy | None = None  #: objects of the scene that shade each point; None if `power` includes them


@dataclass(frozen=True, slots=True, eq=False)
class Environment:
    """Radiance around a position.

    Rows go from up to down, columns by azimuth from -180 degrees about the third row of `basis`.
    """

    radiance: NDArray[np.float32]  #: (HEIGHT, WIDTH, 3) linear
    basis: FloatArray  #: (3, 3) rows: two horizontal unit axes and up, in the scene
    coverage: NDArray[np.float32]  #: (HEIGHT, WIDTH) 0 to 1, how well the images show a direction; the rest is filled
    ambient: NDArray[np.float32] | None = None  #: the radiance without the lamps; None if no lamp is known
    lamps: SphereLights | None = None
    #: (MIRROR * HEIGHT, MIRROR * WIDTH, 3) ratio of the radiance in mirrors to `radiance`; None without finer content
    detail: NDArray[np.float32] | None = None

    def irradiance(self, normal: FloatArray) -> FloatArray:
        """Return the irradiance (3,) of a surface with unit normal (3,): the integral of radiance times the cosine."""
        cosine = np.maximum(map_directions() @ (self.basis @ normal), 0.0)  # (h, w)
        weight = cosine * solid_angles()[:, None]
        return np.asarray(np.einsum("hw,hwc->c", weight, self.radiance))


def map_directions(height: int = HEIGHT, width: int = WIDTH) -> FloatArray:
    """Return the unit direction (h, w, 3) of every cell along the axes of the environment."""
    polar = (np.arange(height) + 0.5) * np.pi / height
    azimuth = (np.arange(width) + 0.5) * 2 * np.pi / width - np.pi
    sine = np.sin(polar)[:, None]
    axes = [sine * np.cos(azimuth), sine * np.sin(azimuth), np.broadcast_to(np.cos(polar)[:, None], (height, width))]
    return np.stack(axes, axis=-1)


def solid_angles(height: int = HEIGHT, width: int = WIDTH) -> FloatArray:
    """Return the solid angle (h,) in steradians of a cell in each row."""
    edges = np.cos(np.arange(height + 1) * np.pi / height)
    return np.asarray((edges[:-1] - edges[1:]) * 2 * np.pi / width)


def prefiltered_environment(environment: Environment) -> list[NDArray[np.float32]]:
    """Return LEVELS + 1 maps (h, w, 3) for reflections, each half as high and wide as the one before.

    The first has MIRROR * HEIGHT rows. Level k is the convolution with the GGX lobe of roughness (k / LEVELS)^2 about
    the mirror direction, with the view along the normal (split-sum approximation; Karis 2013). That of level 1 is
    narrower than its cells.
    """
    import cv2

    rows, columns = HEIGHT // _SOURCE_SHAPE[0], WIDTH // _SOURCE_SHAPE[1]
    blocks = environment.radiance.reshape(_SOURCE_SHAPE[0], rows, _SOURCE_SHAPE[1], columns, 3)
    source = np.asarray(blocks.mean(axis=(1, 3)), dtype=np.float32)
    sharp = enlarged_map(environment.radiance, MIRROR)
    levels = [sharp if environment.detail is None else sharp * environment.detail]
    levels.append(np.asarray(cv2.resize(levels[0], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.float32))
    return levels + [enlarged_map(_lobes(level) @ source.reshape(-1, 3), 2) for level in range(2, LEVELS + 1)]


@lru_cache(maxsize=LEVELS)
def _lobes(level: int) -> NDArray[np.float32]:
    """Return the weights (h, w, s) of the cells of the source in the cells of a blurred level of half the size."""
    shape = (MIRROR * HEIGHT >> level + 1, MIRROR * WIDTH >> level + 1)
    directions, weight = map_directions(*_SOURCE_SHAPE).reshape(-1, 3), solid_angles(*_SOURCE_SHAPE)
    lobes = ggx_lobe(map_directions(*shape) @ directions.T, (level / LEVELS) ** 2)
    lobes *= np.repeat(weight, _SOURCE_SHAPE[1])
    return np.asarray(lobes / lobes.sum(axis=-1, keepdims=True), dtype=np.float32)


def enlarged_map(radiance: NDArray[np.floating], factor: int) -> NDArray[np.float32]:
    """Return a map (h, w, c) interpolated to `factor` times its rows and columns; the azimuth is periodic."""
    import cv2

    periodic = np.concatenate([radiance[:, -1:], radiance, radiance[:, :1]], axis=1).astype(np.float32)
    enlarged = cv2.resize(periodic, None, fx=factor, fy=factor, interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(enlarged[:, factor:-factor])


def ggx_lobe(cosine: FloatArray, roughness: float) -> FloatArray:
    """Return the GGX distribution about the half vector, times the cosine of the light.

    With alpha = max(roughness, MIN_ROUGHNESS)^2 and the half angle h::

        alpha^2 / (cos(h)^2 (alpha^2 - 1) + 1)^2 * max(cosine, 0)

    Parameters
    ----------
    cosine : ndarray of float
        Cosines of the angles to the mirror direction, of any shape.
    roughness : float
        Perceptual roughness, 0 to 1.
    """
    alpha2 = max(roughness, MIN_ROUGHNESS) ** 4
    half2 = (1 + np.clip(cosine, -1, 1)) / 2  # squared cosine of half the angle
    return np.asarray(alpha2 / (half2 * (alpha2 - 1) + 1) ** 2 * np.maximum(cosine, 0.0))
