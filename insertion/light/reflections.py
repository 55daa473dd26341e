"""Blurred levels of an environment for reflections: level k holds what a surface of roughness (k / 4)^2 mirrors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from insertion.light.environment import HEIGHT, WIDTH, Environment, map_directions, solid_angles
from metric_base.arrays import FloatArray

__all__ = ["LEVELS", "reflection_levels"]

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
