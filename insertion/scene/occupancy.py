"""Occupancy grid of a point cloud: visibility between positions, and light gathered from the occupied cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insertion.scene.point_cloud import ColouredPoints
from metric_base.arrays import BoolArray, FloatArray, IntArray

#: Side of a cell as a fraction of the diagonal of the cloud, and its minimum, which limits the memory.
CELL, MIN_CELL = 0.009, 0.0025
#: Minimum number of points of an occupied cell, as a fraction of the median; cells with fewer contain stray points.
MIN_POINT_FRACTION = 0.15
#: Distance of the start of a segment from its surface, in cells.
START_OFFSET = 1.5
#: Length at the end of a segment that is not tested, in cells: the lamp itself is there.
END_MARGIN = 2.0
#: Minimum step along a segment, in cells.
MIN_STEP = np.float32(0.7)
#: Percentiles of the coordinates that bound the grid; points beyond them are stray points.
EXTENT_PERCENTILES = (0.5, 99.5)
#: Number of rays per position for the gathered light.
RAYS = 96
#: Number of segments that are followed at a time, which limits the memory.
CHUNK = 200_000


@dataclass(frozen=True, slots=True, eq=False)
class Occupancy:
    """Occupancy grid. Cell (0, 0, 0) starts at `origin`."""

    distance: NDArray[np.float32]  #: (a, b, c) distance to the nearest occupied cell, in cells
    light: NDArray[np.float32]  #: (a, b, c, 3) mean linear colour of the points in a cell
    origin: FloatArray  #: (3,) in the scene
    cell: float  #: side of a cell, scene units

    def is_unobstructed(self, positions: FloatArray, normals: FloatArray, ends: FloatArray) -> BoolArray:
        """Return whether the segments between positions on surfaces and end points are free.

        Parameters
        ----------
        positions, normals : (p, 3) ndarray of float
            Positions on surfaces and the unit normals of the surfaces.
        ends : (e, 3) ndarray of float
            End points, for example lamps.

        Returns
        -------
        (e, p) ndarray of bool
        """
        starts = ((positions - self.origin) / self.cell + START_OFFSET * normals).astype(np.float32)
        goals = ((ends - self.origin) / self.cell).astype(np.float32)
        rows = max(1, CHUNK // len(starts))
        parts = [
            self._first_hit(np.tile(starts, (len(chunk), 1)), np.repeat(chunk, len(starts), axis=0)) < 0
            for chunk in (goals[k : k + rows] for k in range(0, len(goals), rows))
        ]
        return np.concatenate(parts).reshape(len(ends), -1) if parts else np.ones((0, len(starts)), dtype=bool)

    def gather_irradiance(self, positions: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the irradiance (p, 3) from occupied cells, and the fraction (p,) of rays that leave the grid.

        Rays are distributed by the cosine about the normal, so that irradiance is pi times their mean radiance.

        Parameters
        ----------
        positions, normals : (p, 3) ndarray of float
            Positions on surfaces and the unit normals of the surfaces.
        """
        starts = ((positions - self.origin) / self.cell + START_OFFSET * normals).astype(np.float32)
        directions = np.random.default_rng(0).normal(size=(RAYS, 1, 3))
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        directions = normals + directions  # (r, p, 3) a unit sphere about the tip of the normal: cosine distribution
        directions /= np.maximum(np.linalg.norm(directions, axis=-1, keepdims=True), 1e-6)
        goals = starts + (directions * float(np.linalg.norm(self.distance.shape))).astype(np.float32)
        hit = self._first_hit(np.tile(starts, (RAYS, 1)), goals.reshape(-1, 3)).reshape(RAYS, -1)
        radiance = np.where(hit[..., None] >= 0, self.light.reshape(-1, 3)[hit], 0.0)
        return np.asarray(np.pi * radiance.mean(axis=0)), np.asarray((hit < 0).mean(axis=0))

    def _first_hit(self, starts: NDArray[np.float32], goals: NDArray[np.float32]) -> IntArray:
        """Return the flat index (s,) of the first occupied cell on each segment, -1 if there is none.

        Sphere tracing: each step is as long as the distance to the nearest occupied cell. A segment ends at the border
        of the grid.

        Parameters
        ----------
        starts, goals : (s, 3) ndarray of float32
            Ends of the segments, in cells.
        """
        direction = goals - starts
        length = np.linalg.norm(direction, axis=1)
        direction /= np.maximum(length, 1e-6)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            border = np.where(direction > 0, np.array(self.distance.shape, np.float32) - starts, -starts) / direction
        end = np.minimum(length - END_MARGIN, np.where(direction == 0, np.inf, border).min(axis=1))
        first = np.full(len(direction), -1, dtype=np.int64)
        row = np.flatnonzero(end > 0)
        # one array per axis: NumPy is several times faster on these than on triples
        start, step, end = starts[row].T.copy(), direction[row].T.copy(), end[row]
        along = np.zeros(len(row), dtype=np.float32)
        distance = self.distance.ravel()
        while len(row):
            cell = np.zeros(len(along), dtype=np.int64)
            for axis, size in enumerate(self.distance.shape):
                index = (start[axis] + along * step[axis]).astype(np.int32)
                cell = cell * size + np.minimum(np.maximum(index, 0), size - 1)
            room = distance[cell]
            hit = (room == 0) & (end > 0)
            first[row[hit]] = cell[hit]
            along += np.maximum(room - 1.0, MIN_STEP)
            remaining = ~hit & (along < end)
            if np.count_nonzero(remaining) < 0.9 * len(remaining):
                row, along, end = row[remaining], along[remaining], end[remaining]
                start, step = start[:, remaining], step[:, remaining]
            else:
                end = np.where(remaining, end, -1.0)  # new arrays are made only if that saves work
                if not remaining.any():
                    break
        return first


def occupancy_of(cloud: ColouredPoints, max_cell: float = np.inf, min_points: int = 1) -> Occupancy:
    """Return the occupancy grid of a cloud.

    Parameters
    ----------
    max_cell : float
        Maximum side of a cell in scene units; `MIN_CELL` has precedence.
    min_points : int
        Minimum number of points of an occupied cell.
    """
    from scipy.ndimage import distance_transform_edt

    low, high = np.percentile(cloud.points, EXTENT_PERCENTILES, axis=0)
    diagonal = float(np.linalg.norm(high - low))
    cell = max(min(CELL * diagonal, max_cell), MIN_CELL * diagonal, 1e-12)
    shape = tuple(int(n) + 1 for n in np.floor((high - low) / cell))
    index = np.floor((cloud.points - low) / cell).astype(np.int64)
    inside = ((index >= 0) & (index < shape)).all(axis=1)
    flat = np.ravel_multi_index(tuple(index[inside].T), shape)
    colours = cloud.colours[inside]
    known = np.isfinite(colours[:, 0])
    n = int(np.prod(shape))
    count, known_count = np.bincount(flat, minlength=n), np.bincount(flat[known], minlength=n)
    total = np.stack([np.bincount(flat[known], colours[known, c], n) for c in range(3)], axis=-1)
    median = np.median(colours[known], axis=0) if known.any() else np.zeros(3)
    light = np.where(known_count[:, None] > 0, total / np.maximum(known_count, 1)[:, None], median)
    min_count = MIN_POINT_FRACTION * float(np.median(count[count > 0])) if count.any() else 1.0
    full = (count >= max(min_count, min_points)).reshape(shape)
    distance = distance_transform_edt(~full) if full.any() else np.full(shape, float(max(shape)))
    return Occupancy(distance.astype(np.float32), light.reshape(*shape, 3).astype(np.float32), low, cell)
