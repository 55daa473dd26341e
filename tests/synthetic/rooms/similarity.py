"""Similarity transforms between the synthetic world (metres, z up) and the frame of a reconstruction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from metric_base.arrays import FloatArray

__all__ = ["Similarity", "random_similarity", "similarity_between"]

#: Range of random scales in scene units per metre; the unit of a reconstruction is arbitrary.
SCALES = (0.05, 20.0)


@dataclass(frozen=True, slots=True, eq=False)
class Similarity:
    """x_to = scale * rotation @ x_from + translation."""

    scale: float
    rotation: FloatArray
    translation: FloatArray

    def __call__(self, points: FloatArray) -> FloatArray:
        """Transform points (n, 3)."""
        return np.asarray(self.scale * points @ self.rotation.T + self.translation)

    @property
    def inverse(self) -> Similarity:
        """Inverse transform."""
        rotation = self.rotation.T
        return Similarity(1 / self.scale, rotation, -(rotation @ self.translation) / self.scale)


def random_similarity(generator: np.random.Generator) -> Similarity:
    """Return a similarity with a random orientation, a log-uniform scale within `SCALES`, and a translation."""
    quaternion = generator.standard_normal(4)
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    rotation = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    scale = float(np.exp(generator.uniform(*np.log(SCALES))))
    return Similarity(scale, rotation, generator.normal(0, 3 * scale, 3))


def similarity_between(source: FloatArray, target: FloatArray) -> Similarity:
    """Return the least-squares similarity from source to target (n, 3) (Umeyama 1991, equations 40 to 43)."""
    mean_s, mean_t = source.mean(axis=0), target.mean(axis=0)
    centred_s, centred_t = source - mean_s, target - mean_t
    u, d, vt = np.linalg.svd(centred_t.T @ centred_s / len(source))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = (u * sign) @ vt
    scale = float((d * sign).sum() / (centred_s**2).sum(axis=1).mean())
    return Similarity(scale, rotation, mean_t - scale * rotation @ mean_s)
