"""What the cloud says is between two places: a grid of cells that points fill."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insertion.scene.point_cloud import Cloud
from metric_base.arrays import BoolArray, FloatArray, IntArray

#: Side of a cell in diagonals of the cloud.
CELL = 0.009
#: A cell with fewer points than this share of what the filled cells usually hold is a stray's.
LEAST_SHARE = 0.15
#: A segment starts so far above its surface, in cells, and is free near its other end, where the lamp itself is.
ABOVE, AT_END = 1.5, 2.0
#: The least way between two cells that a segment asks.
LEAST_STRIDE = np.float32(0.7)
#: The cloud beyond these percentiles is strays.
EXTENT = (0.5, 99.5)
#: Rays that say how open a place is.
RAYS = 96
#: Segments that are followed at a time.
CHUNK = 200_000


@dataclass(frozen=True, slots=True, eq=False)
class Occupancy:
    """Which cells are full, as the way to the nearest one, and how bright they are.

    distance : (a, b, c) of each cell to the nearest cell with points, in cells; light : (a, b, c, 3) mean linear colour
    of the points in it; cell (0, 0, 0) starts at `origin` (3,) and has the side `cell`, scene units.
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
        """(p, 3) irradiance of what places (p, 3) with normals (p, 3) look at, and (p,) the share that meets nothing.

        Rays go out by the cosine about the normal, so that irradiance is pi times their mean radiance.
        """
        starts = ((places - self.origin) / self.cell + ABOVE * normals).astype(np.float32)
        ways = np.random.default_rng(0).normal(size=(RAYS, 1, 3))
        ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
        ways = normals + ways  # (r, p, 3) a unit sphere on the tip of the normal: by the cosine
        ways /= np.maximum(np.linalg.norm(ways, axis=-1, keepdims=True), 1e-6)
        goals = starts + (ways * float(np.linalg.norm(self.distance.shape))).astype(np.float32)
        met = self._met(np.tile(starts, (RAYS, 1)), goals.reshape(-1, 3)).reshape(RAYS, -1)
        radiance = np.where(met[..., None] >= 0, self.light.reshape(-1, 3)[met], 0.0)
        return np.asarray(np.pi * radiance.mean(axis=0)), np.asarray((met < 0).mean(axis=0))

    def _met(self, starts: NDArray[np.float32], goals: NDArray[np.float32]) -> IntArray:
        """(s,) flat number of the full cell that each segment (s, 3) in cells meets, -1 for none.

        Each segment strides by the distance to anything, and ends where it leaves the grid.
        """
        way = goals - starts
        length = np.linalg.norm(way, axis=1)
        way /= np.maximum(length, 1e-6)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            leaves = np.where(way > 0, np.array(self.distance.shape, np.float32) - starts, -starts) / way
        end = np.minimum(length - AT_END, np.where(way == 0, np.inf, leaves).min(axis=1))
        met = np.full(len(way), -1, dtype=np.int64)
        row = np.flatnonzero(end > 0)
        # one array for each axis: numpy is several times faster on these than on triples
        start, step, end = starts[row].T.copy(), way[row].T.copy(), end[row]
        along = np.zeros(len(row), dtype=np.float32)
        distance = self.distance.ravel()
        while len(row):
            cell = self._cell_number(start, step, along)
            room = distance[cell]
            hit = (room == 0) & (end > 0)
            met[row[hit]] = cell[hit]
            along += np.maximum(room - 1.0, LEAST_STRIDE)
            left = ~hit & (along < end)
            if np.count_nonzero(left) < 0.9 * len(left):
                row, start, step, along, end = row[left], start[:, left], step[:, left], along[left], end[left]
            else:
                end = np.where(left, end, -1.0)  # arrays are made anew only when it saves work
                if not left.any():
                    break
        return met

    def _cell_number(
        self, start: NDArray[np.float32], step: NDArray[np.float32], along: NDArray[np.float32]
    ) -> IntArray:
        """(s,) flat numbers of the cells at `along` (s,) from `start` in the direction `step` (3, s)."""
        number = np.zeros(len(along), dtype=np.int64)
        for axis, size in enumerate(self.distance.shape):
            at = (start[axis] + along * step[axis]).astype(np.int32)
            number = number * size + np.minimum(np.maximum(at, 0), size - 1)
        return number


def occupancy_of(cloud: Cloud) -> Occupancy:
    """The cells that the points of a cloud fill."""
    from scipy.ndimage import distance_transform_edt

    low, high = np.percentile(cloud.points, EXTENT, axis=0)
    cell = max(CELL * float(np.linalg.norm(high - low)), 1e-12)
    shape = tuple(int(n) + 1 for n in np.floor((high - low) / cell))
    index = np.floor((cloud.points - low) / cell).astype(np.int64)
    inside = ((index >= 0) & (index < shape)).all(axis=1)
    flat = np.ravel_multi_index(tuple(index[inside].T), shape)
    colours = cloud.colours[inside]
    known = np.isfinite(colours[:, 0])
    n = int(np.prod(shape))
    count, lit = np.bincount(flat, minlength=n), np.bincount(flat[known], minlength=n)
    total = np.stack([np.bincount(flat[known], colours[known, c], n) for c in range(3)], axis=-1)
    usual = np.median(colours[known], axis=0) if known.any() else np.zeros(3)
    light = np.where(lit[:, None] > 0, total / np.maximum(lit, 1)[:, None], usual)
    least = LEAST_SHARE * float(np.median(count[count > 0])) if count.any() else 1.0
    full = (count >= max(least, 1.0)).reshape(shape)
    distance = distance_transform_edt(~full) if full.any() else np.full(shape, float(max(shape)))
    return Occupancy(distance.astype(np.float32), light.reshape(*shape, 3).astype(np.float32), low, cell)
