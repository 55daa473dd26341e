"""What the cloud says is between two places: a grid of cells that points fill."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insertion.records.encoding import luminance
from insertion.scene.cloud import Cloud
from metric_base.arrays import BoolArray, FloatArray, IntArray

__all__ = ["Occupancy", "occupancy_of"]

#: Side of a cell in diagonals of the cloud.
CELL = 0.009
#: A cell with fewer points than this share of what the filled cells usually hold is a stray's.
LEAST_SHARE = 0.15
#: A segment starts so far above its surface, in cells, and is free near its other end, where the lamp itself is.
ABOVE, AT_END = 1.5, 2.0
#: The cloud beyond these percentiles is strays.
EXTENT = (0.5, 99.5)
#: Rays that say how open a place is.
RAYS = 96
#: Segments that are followed at a time.
CHUNK = 200_000


@dataclass(frozen=True, slots=True, eq=False)
class Occupancy:
    """Which cells are full, as the way to the nearest one, and how bright they are.

    distance : (a, b, c) of each cell to the nearest cell with points, in cells; light : (a, b, c) mean luminance of the
    points in it; cell (0, 0, 0) starts at `origin` (3,) and has the side `cell`, scene units.
    """

    distance: NDArray[np.float32]
    light: NDArray[np.float32]
    origin: FloatArray
    cell: float

    def open_segments(self, places: FloatArray, normals: FloatArray, ends: FloatArray) -> BoolArray:
        """(e, p) whether nothing is between each of `ends` (e, 3) and places (p, 3) on surfaces of normals (p, 3)."""
        starts = ((places - self.origin) / self.cell + ABOVE * normals).astype(np.float32)
        goals = ((ends - self.origin) / self.cell).astype(np.float32)
        rows = max(1, CHUNK // len(starts))
        parts = [
            self._met(np.tile(starts, (len(some), 1)), np.repeat(some, len(starts), axis=0)) < 0
            for some in (goals[k : k + rows] for k in range(0, len(goals), rows))
        ]
        return np.concatenate(parts).reshape(len(ends), -1) if parts else np.ones((0, len(starts)), dtype=bool)

    def gathered_light(self, places: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(p,) irradiance of what places (p, 3) with normals (p, 3) look at, and (p,) the share that meets nothing.

        Rays go out by the cosine about the normal, so that irradiance is pi times their mean radiance.
        """
        starts = ((places - self.origin) / self.cell + ABOVE * normals).astype(np.float32)
        ways = np.random.default_rng(0).normal(size=(RAYS, 1, 3))
        ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
        ways = normals + ways  # (r, p, 3) a unit sphere on the tip of the normal: by the cosine
        ways /= np.maximum(np.linalg.norm(ways, axis=-1, keepdims=True), 1e-6)
        goals = starts + (ways * float(np.linalg.norm(self.distance.shape))).astype(np.float32)
        met = self._met(np.tile(starts, (RAYS, 1)), goals.reshape(-1, 3)).reshape(RAYS, -1)
        radiance = np.where(met >= 0, self.light.ravel()[met], 0.0)
        return np.asarray(np.pi * radiance.mean(axis=0)), np.asarray((met < 0).mean(axis=0))

    def _met(self, starts: NDArray[np.float32], goals: NDArray[np.float32]) -> IntArray:
        """(s,) flat number of the full cell that each segment (s, 3) in cells meets, -1 for none.

        Each segment strides by the distance to anything.
        """
        way = goals - starts
        length = np.linalg.norm(way, axis=1)
        way /= np.maximum(length, 1e-6)[:, None]
        shape = np.array(self.distance.shape)
        met = np.full(len(way), -1, dtype=np.int64)
        along = np.zeros(len(way), dtype=np.float32)
        left = np.flatnonzero(length > AT_END)
        while len(left):
            at = np.floor(starts[left] + along[left, None] * way[left]).astype(np.int32)
            inside = np.asarray(((at >= 0) & (at < shape)).all(axis=1))
            at = np.where(inside[:, None], at, 0)
            room = np.where(inside, self.distance[at[:, 0], at[:, 1], at[:, 2]], 1.0)
            hit = room == 0
            met[left[hit]] = np.ravel_multi_index(tuple(at[hit].T), self.distance.shape)
            along[left] += np.maximum(room - 1.0, 0.7)
            left = left[(room > 0) & (along[left] < length[left] - AT_END)]
        return met


def occupancy_of(cloud: Cloud) -> Occupancy:
    """The cells that the points of a cloud fill."""
    from scipy.ndimage import distance_transform_edt

    low, high = np.percentile(cloud.points, EXTENT, axis=0)
    cell = max(CELL * float(np.linalg.norm(high - low)), 1e-12)
    shape = tuple(int(n) + 1 for n in np.floor((high - low) / cell))
    index = np.floor((cloud.points - low) / cell).astype(np.int64)
    inside = ((index >= 0) & (index < shape)).all(axis=1)
    flat = np.ravel_multi_index(tuple(index[inside].T), shape)
    bright = luminance(cloud.colours[inside])
    known = np.isfinite(bright)
    n = int(np.prod(shape))
    count, lit = np.bincount(flat, minlength=n), np.bincount(flat[known], minlength=n)
    total = np.bincount(flat[known], bright[known], n)
    light = np.where(lit > 0, total / np.maximum(lit, 1), float(np.median(bright[known])) if known.any() else 0.0)
    least = LEAST_SHARE * float(np.median(count[count > 0])) if count.any() else 1.0
    full = (count >= max(least, 1.0)).reshape(shape)
    distance = distance_transform_edt(~full) if full.any() else np.full(shape, float(max(shape)))
    return Occupancy(distance.astype(np.float32), light.reshape(shape).astype(np.float32), low, cell)
