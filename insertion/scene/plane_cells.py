"""Cells of the large plane surfaces of a scene with brightness and hue: walls, floor, ceiling, table tops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insertion.colour import luminance
from insertion.scene.point_cloud import ColouredPoints
from metric_base.arrays import BoolArray, FloatArray, IntArray

#: Maximum number of points with a normal.
MAX_POINTS = 12_000
#: Number of neighbours for the normal of a point.
NEIGHBOURS = 14
#: Maximum ratio of the smallest to the second eigenvalue of the neighbours' scatter on a flat surface.
MAX_FLATNESS_RATIO = 0.04
#: Half the thickness of a plane, as a fraction of the diagonal of the scene.
THICKNESS = 0.008
#: Side of a cell, as a fraction of the diagonal of the scene.
CELL = 0.035
#: Minimum cosine between the normals of points on one plane.
MIN_NORMAL_COSINE = 0.85
#: Maximum number of planes.
MAX_PLANES = 14
#: Minimum number of points on a plane, as a fraction of all points.
MIN_PLANE_FRACTION = 0.015
#: Number of points that propose a plane in each round.
PROPOSALS = 150
#: Maximum difference of log(red / green) and of log(blue / green) within one paint.
MAX_LOG_HUE_DIFFERENCE = 0.18
#: Maximum number of paints per plane.
MAX_PAINTS_PER_PLANE = 3
#: Minimum number of cells of one paint: fewer do not determine how the light changes over it.
MIN_PAINT_CELLS = 5
#: Minimum number of points in a cell.
MIN_CELL_POINTS = 3
#: Minimum linear luminance; lower values are noise.
MIN_LUMINANCE = 0.004
#: Maximum linear value of a channel; higher values are clipped.
MAX_LINEAR = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class PlaneCells:
    """Cells of planes, in the order of the planes."""

    positions: FloatArray  #: (n, 3) in the scene
    normals: FloatArray  #: (n, 3) unit normals towards the cameras
    log_luminance: FloatArray  #: (n,) median over the points of the cell
    plane: IntArray  #: (n,) index of the plane
    diagonal: float  #: diagonal of the scene, scene units
    hue: FloatArray | None = None  #: (n, 3) log of linear colour over luminance, median over the points of the cell


def find_plane_cells(cloud: ColouredPoints, centres: FloatArray) -> PlaneCells:
    """Return the cells of the largest planes of a cloud.

    Parameters
    ----------
    cloud : ColouredPoints
        Points with colours.
    centres : (v, 3) ndarray of float
        Centres of the cameras.

    Returns
    -------
    PlaneCells
        No cells if the cloud has too few points that are neither dark nor clipped.
    """
    # 1. Points that are neither dark nor clipped, with log luminance and hue.
    bright = luminance(cloud.colours)
    with np.errstate(invalid="ignore"):
        rows = np.flatnonzero((bright > MIN_LUMINANCE) & (cloud.colours.max(axis=1) < MAX_LINEAR))
    rows = rows[:: max(1, len(rows) // MAX_POINTS)]
    points, light = cloud.points[rows], np.log(bright[rows].astype(np.float64))
    colour = np.log(np.maximum(cloud.colours[rows], 1e-3).astype(np.float64))
    hue = colour[:, [0, 2]] - colour[:, 1:2]  # (n, 2) red and blue over green
    empty = np.empty((0, 3))
    if len(points) < 10 * NEIGHBOURS:
        return PlaneCells(empty, empty, np.empty(0), np.empty(0, dtype=np.int64), 1.0)
    diagonal = float(np.linalg.norm(np.ptp(np.percentile(points, [2, 98], axis=0), axis=0)))

    # 2. Planes, divided by paint: a rug on a floor, a picture on a wall.
    normals, is_flat = _normals(points, centres.mean(axis=0))
    points, normals, light, hue = points[is_flat], normals[is_flat], light[is_flat], hue[is_flat]
    values = np.column_stack([light, colour[is_flat] - light[:, None]])
    cells = [
        _cells(points[rows], normal, values[rows], CELL * diagonal)
        for normal, on_plane in fit_planes(points, normals, THICKNESS * diagonal)
        for rows in _divide_by_hue(hue, on_plane)
    ]
    cells = [cell for cell in cells if len(cell[1]) >= MIN_PAINT_CELLS]
    if not cells:
        return PlaneCells(empty, empty, np.empty(0), np.empty(0, dtype=np.int64), diagonal)
    plane = np.concatenate([np.full(len(cell[1]), index) for index, cell in enumerate(cells)])
    positions, values, facing = (np.concatenate([cell[k] for cell in cells]) for k in range(3))
    return PlaneCells(positions, facing, values[:, 0], plane, diagonal, values[:, 1:])


def _normals(points: FloatArray, eye: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return unit normals (n, 3) of points (n, 3) towards `eye` (3,), and whether the surface is flat (n,)."""
    from scipy.spatial import cKDTree

    near = points[cKDTree(points).query(points, k=NEIGHBOURS)[1]]  # (n, k, 3)
    near = near - near.mean(axis=1, keepdims=True)
    spread, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", near, near))
    normals = axes[:, :, 0]
    is_averted = ((eye - points) * normals).sum(axis=1) < 0
    return np.where(is_averted[:, None], -normals, normals), spread[:, 0] < MAX_FLATNESS_RATIO * spread[:, 1]


def fit_planes(points: FloatArray, normals: FloatArray, thickness: float) -> list[tuple[FloatArray, IntArray]]:
    """Return the unit normal (3,) and the point indices of each plane, the largest first.

    In each round, random points propose the plane through their position and normal; the plane with most points wins.

    Parameters
    ----------
    points, normals : (n, 3) ndarray of float
        Points and their unit normals.
    thickness : float
        Half the thickness of a plane, in scene units.
    """
    generator = np.random.default_rng(0)
    remaining = np.arange(len(points))
    planes: list[tuple[FloatArray, IntArray]] = []
    while len(planes) < MAX_PLANES and len(remaining) > MIN_PLANE_FRACTION * len(points):
        proposed = remaining[generator.permutation(len(remaining))[:PROPOSALS]]
        offset = np.abs(points[remaining] @ normals[proposed].T - (points[proposed] * normals[proposed]).sum(axis=1))
        cosine = normals[remaining] @ normals[proposed].T
        on_plane = (offset < thickness) & (cosine > MIN_NORMAL_COSINE)  # (remaining, proposed)
        best = int(on_plane.sum(axis=0).argmax())
        rows = remaining[on_plane[:, best]]
        if len(rows) < MIN_PLANE_FRACTION * len(points):
            break
        normal = normals[rows].mean(axis=0)
        planes.append((normal / np.linalg.norm(normal), rows))
        remaining = remaining[~on_plane[:, best]]
    return planes


def _divide_by_hue(hue: FloatArray, rows: IntArray) -> list[IntArray]:
    """Divide the point indices of a plane by paint, the paint with most points first.

    Parameters
    ----------
    hue : (n, 2) ndarray of float
        Log of red over green and of blue over green, for all points.
    rows : (k,) ndarray of int
        Points of the plane.
    """
    parts: list[IntArray] = []
    while len(rows) >= MIN_PAINT_CELLS * MIN_CELL_POINTS and len(parts) < MAX_PAINTS_PER_PLANE:
        seeds = hue[rows[:: max(1, len(rows) // 40)]]
        is_close = np.abs(hue[rows][:, None] - seeds).max(axis=-1) < MAX_LOG_HUE_DIFFERENCE  # (n, s)
        best = is_close[:, is_close.sum(axis=0).argmax()]
        parts.append(rows[best])
        rows = rows[~best]
    return parts


def _cells(
    points: FloatArray, normal: FloatArray, values: FloatArray, side: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return centres (m, 3), medians (m, k) of the values (n, k) and normals (m, 3) of the cells of one plane."""
    across = np.cross(normal, [1.0, 0, 0] if abs(normal[0]) < 0.8 else [0, 1.0, 0])
    across /= np.linalg.norm(across)
    flat = points @ np.column_stack([across, np.cross(normal, across)])
    _, cell = np.unique(np.floor(flat / side).astype(np.int64), axis=0, return_inverse=True)
    order = np.argsort(cell.ravel(), kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(cell.ravel()))[:-1])
    parts = [part for part in parts if len(part) >= MIN_CELL_POINTS]
    centres = np.array([points[part].mean(axis=0) for part in parts]).reshape(-1, 3)
    medians = np.array([np.median(values[part], axis=0) for part in parts]).reshape(-1, values.shape[1])
    return centres, medians, np.broadcast_to(normal, centres.shape)
