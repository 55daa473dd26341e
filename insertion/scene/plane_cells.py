"""Cells of the large plane surfaces of a scene with their brightness: walls, floor, ceiling, table tops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insertion.colour import luminance
from insertion.scene.point_cloud import Cloud
from metric_base.arrays import BoolArray, FloatArray, IntArray

#: Points that normals rest on, and their neighbours.
MAX_POINTS, NEIGHBOURS = 12_000, 14
#: Of the neighbours' spread, no more than this is across the surface.
FLATNESS = 0.04
#: A plane's half thickness and the side of its cells, in diagonals of the scene.
THICK, CELL = 0.008, 0.035
#: Normals of points on one plane agree by this cosine.
ALIKE = 0.85
MAX_PLANES, LEAST_SHARE, TRIES = 14, 0.015, 150
#: Logarithms of red over green and of blue over green differ by less within one paint; paints of a plane.
SAME_HUE, MOST_HUES = 0.18, 3
#: Fewest cells of a paint that say how the light changes over it.
LEAST_CELLS = 5
#: Points in a cell, and the luminance that is neither noise nor clipped.
CELL_POINTS, LUMINANCES = 3, (0.004, 0.9)


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """Cells of planes.

    places, normals : (n, 3), normals towards the cameras; log_luminance : (n,) median over the cell's points;
    plane : (n,) number of the cell's plane, in order; diagonal : of the scene, its unit of length; hue : (n, 3) log of
    the linear colour over the luminance, median over the cell's points, 0 where it is not known.
    """

    places: FloatArray
    normals: FloatArray
    log_luminance: FloatArray
    plane: IntArray
    diagonal: float
    hue: FloatArray | None = None

    def cells(self, kept: BoolArray) -> Patches:
        """Some of the cells (n,), their planes numbered anew; planes of less than three of them are left out."""
        kept = kept & (np.bincount(self.plane[kept], minlength=int(self.plane.max()) + 1)[self.plane] >= 3)
        plane = np.unique(self.plane[kept], return_inverse=True)[1]
        hue = None if self.hue is None else self.hue[kept]
        return Patches(self.places[kept], self.normals[kept], self.log_luminance[kept], plane, self.diagonal, hue)


def plane_patches(cloud: Cloud, centres: FloatArray) -> Patches:
    """The cells of the largest planes of a cloud; centres : (v, 3) of the cameras. There may be none."""
    bright = luminance(cloud.colours)
    with np.errstate(invalid="ignore"):
        rows = np.flatnonzero((bright > LUMINANCES[0]) & (cloud.colours.max(axis=1) < LUMINANCES[1]))
    rows = rows[:: max(1, len(rows) // MAX_POINTS)]
    points, light = cloud.points[rows], np.log(bright[rows].astype(np.float64))
    colour = np.log(np.maximum(cloud.colours[rows], 1e-3).astype(np.float64))
    hue = colour[:, [0, 2]] - colour[:, 1:2]  # (n, 2) red and blue over green
    if len(points) < 10 * NEIGHBOURS:
        empty = np.empty((0, 3))
        return Patches(empty, empty, np.empty(0), np.empty(0, dtype=np.int64), 1.0)
    diagonal = float(np.linalg.norm(np.ptp(np.percentile(points, [2, 98], axis=0), axis=0)))
    normals, flat = _normals(points, centres.mean(axis=0))
    points, normals, light, hue = points[flat], normals[flat], light[flat], hue[flat]
    values = np.column_stack([light, colour[flat] - light[:, None]])
    cells = [
        _cells(points[rows], normal, values[rows], CELL * diagonal)
        for normal, on in _planes(points, normals, THICK * diagonal)
        for rows in _of_one_hue(hue, on)
    ]
    cells = [cell for cell in cells if len(cell[1]) >= LEAST_CELLS]
    if not cells:
        empty = np.empty((0, 3))
        return Patches(empty, empty, np.empty(0), np.empty(0, dtype=np.int64), diagonal)
    plane = np.concatenate([np.full(len(cell[1]), number) for number, cell in enumerate(cells)])
    places, values, facing = (np.concatenate([cell[k] for cell in cells]) for k in range(3))
    return Patches(places, facing, values[:, 0], plane, diagonal, values[:, 1:])


def _normals(points: FloatArray, eye: FloatArray) -> tuple[FloatArray, BoolArray]:
    """(n, 3) normals towards the eye, and (n,) whether the surface about the point is flat."""
    from scipy.spatial import cKDTree

    near = points[cKDTree(points).query(points, k=NEIGHBOURS)[1]]  # (n, k, 3)
    near = near - near.mean(axis=1, keepdims=True)
    spread, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", near, near))
    normals = axes[:, :, 0]
    away = ((eye - points) * normals).sum(axis=1) < 0
    return np.where(away[:, None], -normals, normals), spread[:, 0] < FLATNESS * spread[:, 1]


def _planes(points: FloatArray, normals: FloatArray, thick: float) -> list[tuple[FloatArray, IntArray]]:
    """Normal (3,) and rows of the points of each plane, the largest first; a point with its normal proposes one."""
    generator = np.random.default_rng(0)
    left = np.arange(len(points))
    planes: list[tuple[FloatArray, IntArray]] = []
    while len(planes) < MAX_PLANES and len(left) > LEAST_SHARE * len(points):
        tried = left[generator.permutation(len(left))[:TRIES]]
        offset = np.abs(points[left] @ normals[tried].T - (points[tried] * normals[tried]).sum(axis=1))
        on = (offset < thick) & (normals[left] @ normals[tried].T > ALIKE)  # (left, tried)
        best = int(on.sum(axis=0).argmax())
        rows = left[on[:, best]]
        if len(rows) < LEAST_SHARE * len(points):
            break
        normal = normals[rows].mean(axis=0)
        planes.append((normal / np.linalg.norm(normal), rows))
        left = left[~on[:, best]]
    return planes


def _of_one_hue(hue: FloatArray, rows: IntArray) -> list[IntArray]:
    """The rows of a plane by what it is painted with: a rug on a floor, a picture on a wall; the largest first.

    hue : (n, 2) log red and blue over green; rows : (k,) of the plane, and (j,) of each paint.
    """
    parts: list[IntArray] = []
    while len(rows) >= LEAST_CELLS * CELL_POINTS and len(parts) < MOST_HUES:
        seeds = hue[rows[:: max(1, len(rows) // 40)]]
        near = np.abs(hue[rows][:, None] - seeds).max(axis=-1) < SAME_HUE  # (n, s)
        best = near[:, near.sum(axis=0).argmax()]
        parts.append(rows[best])
        rows = rows[~best]
    return parts


def _cells(
    points: FloatArray, normal: FloatArray, light: FloatArray, side: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(m, 3) middles, (m, k) medians of the points' values (n, k) and (m, 3) normals of the cells of one plane."""
    across = np.cross(normal, [1.0, 0, 0] if abs(normal[0]) < 0.8 else [0, 1.0, 0])
    across /= np.linalg.norm(across)
    flat = points @ np.column_stack([across, np.cross(normal, across)])
    _, cell = np.unique(np.floor(flat / side).astype(np.int64), axis=0, return_inverse=True)
    order = np.argsort(cell.ravel(), kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(cell.ravel()))[:-1])
    parts = [part for part in parts if len(part) >= CELL_POINTS]
    places = np.array([points[part].mean(axis=0) for part in parts]).reshape(-1, 3)
    values = np.array([np.median(light[part], axis=0) for part in parts]).reshape(-1, light.shape[1])
    return places, values, np.broadcast_to(normal, places.shape)
