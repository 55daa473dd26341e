"""Candidate lamps of a room, and the irradiance of the cells of its planes by a lamp, with shadows.

Lamps are not in positions that are visibly free: an image shows a surface behind them and no clipped pixels nearby.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from estimator.projection.cameras import pixels_in_view
from insertion.footage.footage import SceneImages
from insertion.scene.occupancy import Occupancy
from insertion.scene.plane_cells import CELL, PlaneCells
from insertion.scene.point_cloud import ColouredPoints, evenly_spaced, visible_points
from metric_base.arrays import BoolArray, FloatArray

#: Number of candidates along each horizontal axis of the room, and of heights.
GRID, LEVELS = 11, 6
#: Minimum height of a candidate, as a fraction of the height of the room: lamps are in the upper part.
MIN_HEIGHT = 0.45
#: Minimum height of a hanging lamp, as a fraction of the height of the room; lower ones are floor lamps.
MIN_HANGING_HEIGHT = 0.8
#: Log odds of a standing lamp against a hanging lamp or a window.
STANDING_LOG_ODDS = -4.0
#: Distance of the walls beyond their visible part, as a fraction of the extent of the room.
WALL_MARGIN_FRACTION = 0.12
#: Height of the ceiling above the visible walls, as a fraction of their height.
CEILING_MARGIN_FRACTION = 0.2
#: Number of cells of the ceiling along each side.
CEILING_CELLS = 8
#: Minimum height of a room, as a fraction of its longer side, if no image shows the ceiling.
MIN_HEIGHT_RATIO = 0.55
#: Maximum cosine with up of the normal of a wall.
MAX_WALL_UP_COSINE = 0.3
#: Irradiance of a lamp of strength 1 at a typical distance (a third of a diagonal), in 1 / diagonal^2.
TYPICAL_IRRADIANCE = 10.0
#: Number of positions about a lamp in the local search.
N_LOCAL_CANDIDATES = 16
#: Standard deviation of the components of a perturbed direction.
DIRECTION_SIGMA = 0.35
#: Minimum distance between a lamp and a surface, in diagonals.
MIN_DISTANCE = 0.04
#: Distance of the sample points of a cell from its centre, in sides of the cell.
SAMPLE_OFFSET = 0.3
#: Sample points per cell in the coarse search; one is enough to rank candidates.
COARSE_SAMPLES_PER_CELL = 1
#: Sample points per cell in the local search.
LOCAL_SAMPLES_PER_CELL = 2
#: Maximum number of images in the test for free positions.
MAX_IMAGES = 12
#: Number of nearest points that determine the depth of an image at a pixel.
DEPTH_POINTS = 5
#: Maximum distance of these points from the pixel, in pixels at an image width of 640.
MAX_POINT_PX = 30.0
#: Maximum depth of a free position, as a fraction of the depth of the image.
MAX_FREE_DEPTH = 0.9
#: Minimum grey level of a clipped pixel, which may show a lamp.
MIN_CLIPPED_LEVEL = 245
#: Radius in which clipped pixels are searched, in pixels at an image width of 640.
CLIPPED_RADIUS_PX = 12


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Candidate lamps."""

    positions: FloatArray  #: (c, 3) in the scene
    facing: FloatArray  #: (c, 3) unit direction of a lamp; 0 for an omnidirectional one
    irradiance: FloatArray  #: (c, n) irradiance of the cells by a lamp of strength 1
    ceiling_irradiance: FloatArray  #: (c,) mean irradiance of the ceiling by a lamp of strength 1
    log_prior: FloatArray  #: (c,)
    spacing: float  #: spacing of the candidates of the room, scene units; about the size of a lamp
    basis: FloatArray  #: (3, 3) rows: two horizontal axes and up
    excluded: FloatArray  #: (b, 3) positions of the grid that cannot hold a lamp
    ceiling: PlaneCells  #: cells of the ceiling; their brightness is not known


def room_candidates(
    cells: PlaneCells,
    up: FloatArray,
    is_free: Callable[[FloatArray], BoolArray] | None,
    occupancy: Occupancy | None,
) -> Candidates:
    """Return candidate lamps in the whole room.

    Parameters
    ----------
    cells : PlaneCells
        Cells of the planes of the room.
    up : (3,) ndarray of float
        Unit vector.
    is_free : callable, optional
        Returns which of (n, 3) positions are visibly free and cannot hold a lamp, (n,).
    occupancy : Occupancy, optional
        Grid that casts shadows.
    """
    # 1. Axes of the room and its extent.
    basis = room_axes(cells, up)
    local = cells.positions @ basis.T
    low, high = local.min(axis=0), local.max(axis=0)
    high[2] = max(
        high[2] + CEILING_MARGIN_FRACTION * (high - low)[2],
        low[2] + MIN_HEIGHT_RATIO * float((high - low)[:2].max()),
    )

    # 2. A grid of positions, without the visibly free ones.
    margin = WALL_MARGIN_FRACTION * (high - low)
    steps = [np.linspace(low[k] - margin[k], high[k] + margin[k], GRID) for k in range(2)]
    levels = np.linspace(low[2] + MIN_HEIGHT * (high[2] - low[2]), high[2], LEVELS)
    grid = np.stack(np.meshgrid(*steps, levels, indexing="ij"), axis=-1).reshape(-1, 3)
    keep = np.ones(len(grid), dtype=bool) if is_free is None else ~is_free(grid @ basis)
    excluded = grid[~keep] @ basis
    grid = grid[keep]

    # 3. Directions: omnidirectional anywhere, downwards from the upper half, inwards from a wall.
    groups = [(grid, np.zeros(3)), (grid[grid[:, 2] >= levels[LEVELS // 2]], np.array([0.0, 0.0, -1.0]))]
    for axis in range(2):
        for end, inward in ((0, 1.0), (-1, -1.0)):
            direction = np.zeros(3)
            direction[axis] = inward
            groups.append((grid[grid[:, axis] == steps[axis][end]], direction))
    grid = np.concatenate([group for group, _ in groups])
    facing = np.concatenate([np.tile(direction, (len(group), 1)) for group, direction in groups])
    positions, facing = grid @ basis, facing @ basis
    is_standing = ~facing.any(axis=1) & (grid[:, 2] < low[2] + MIN_HANGING_HEIGHT * (high[2] - low[2]))
    log_prior = np.where(is_standing, STANDING_LOG_ODDS, 0.0)
    irradiance = lamp_irradiance(cells, positions, facing, occupancy, COARSE_SAMPLES_PER_CELL)

    # 4. Cells of the ceiling, as high as the highest candidate.
    top = [float((positions @ basis[2]).max())] if len(positions) else [float(high[2])]
    sides = [np.linspace(low[k], high[k], CEILING_CELLS) for k in range(2)]
    centres = np.stack(np.meshgrid(*sides, top, indexing="ij"), axis=-1).reshape(-1, 3) @ basis
    downward = np.broadcast_to(-basis[2], centres.shape)
    unknown, plane = np.zeros(len(centres)), np.zeros(len(centres), dtype=np.int64)
    ceiling = PlaneCells(centres, downward, unknown, plane, cells.diagonal)
    ceiling_irradiance = _ceiling_irradiance(ceiling, positions, facing)
    spacing = float(steps[0][1] - steps[0][0])
    return Candidates(positions, facing, irradiance, ceiling_irradiance, log_prior, spacing, basis, excluded, ceiling)


def room_axes(cells: PlaneCells, up: FloatArray) -> FloatArray:
    """Return two horizontal unit axes, along the walls if there are any, and up as rows (3, 3)."""
    upright = cells.normals[np.abs(cells.normals @ up) < MAX_WALL_UP_COSINE]
    across = upright[0] if len(upright) else np.array([1.0, 0, 0] if abs(up[0]) < 0.8 else [0, 1.0, 0])
    across = across - (across @ up) * up
    across /= np.linalg.norm(across)
    return np.array([across, np.cross(up, across), up])


def local_candidates(
    room: Candidates,
    position: FloatArray,
    facing: FloatArray,
    spread: float,
    cells: PlaneCells,
    occupancy: Occupancy | None,
    generator: np.random.Generator,
) -> Candidates:
    """Return candidate lamps near a position, the first at the position.

    Each candidate keeps the direction `facing`, has it perturbed, points down, or is omnidirectional. Positions outside
    the grid of the room, or closer to an excluded position than to a candidate, are impossible.

    Parameters
    ----------
    room : Candidates
        Candidates of the whole room.
    position, facing : (3,) ndarray of float
        A lamp.
    spread : float
        Standard deviation of the positions, in scene units.
    """
    offsets = generator.normal(0.0, spread, (N_LOCAL_CANDIDATES, 3))
    offsets[0] = 0.0
    perturbed = facing + generator.normal(0.0, DIRECTION_SIGMA, (N_LOCAL_CANDIDATES, 3)) * facing.any()
    perturbed /= np.maximum(np.linalg.norm(perturbed, axis=1, keepdims=True), 1e-9)
    directions = [
        np.tile(facing, (N_LOCAL_CANDIDATES, 1)),
        perturbed,
        np.tile(-room.basis[2], (N_LOCAL_CANDIDATES, 1)),
        np.zeros((N_LOCAL_CANDIDATES, 3)),
    ]
    positions = position + offsets
    local, grid = positions @ room.basis.T, room.positions @ room.basis.T
    is_impossible = ((local < grid.min(axis=0)) | (local > grid.max(axis=0))).any(axis=1)
    if len(room.excluded):
        to_candidate, to_excluded = (
            np.linalg.norm(positions[:, None] - others, axis=-1).min(axis=1)
            for others in (room.positions, room.excluded)
        )
        is_impossible |= to_excluded < to_candidate
    log_prior = np.tile(np.where(is_impossible, -np.inf, 0.0), len(directions))
    log_prior[0] = 0.0
    positions, all_facing = np.tile(positions, (len(directions), 1)), np.concatenate(directions)
    return replace(
        room,
        positions=positions,
        facing=all_facing,
        irradiance=lamp_irradiance(cells, positions, all_facing, occupancy, LOCAL_SAMPLES_PER_CELL),
        ceiling_irradiance=_ceiling_irradiance(room.ceiling, positions, all_facing),
        log_prior=log_prior,
    )


def _ceiling_irradiance(ceiling: PlaneCells, positions: FloatArray, facing: FloatArray) -> FloatArray:
    """Return the mean irradiance (c,) of the ceiling by lamps of strength 1 at positions with directions (c, 3)."""
    return np.asarray(lamp_irradiance(ceiling, positions, facing, None).mean(axis=1))


def lamp_irradiance(
    cells: PlaneCells,
    positions: FloatArray,
    facing: FloatArray,
    occupancy: Occupancy | None,
    samples: int = COARSE_SAMPLES_PER_CELL,
) -> FloatArray:
    """Compute the irradiance of cells by lamps of strength 1.

    Parameters
    ----------
    cells : PlaneCells
        n cells.
    positions, facing : (c, 3) ndarray of float
        Positions and directions of the lamps; a direction of 0 is omnidirectional.
    occupancy : Occupancy, optional
        Grid that casts shadows.
    samples : int
        Number of sample points per cell for the visibility test: 1 or 2.

    Returns
    -------
    (c, n) ndarray of float
    """
    away = positions[:, None] - cells.positions  # (c, n, 3)
    distance = np.maximum(np.linalg.norm(away, axis=-1), MIN_DISTANCE * cells.diagonal)
    cosine = np.maximum(np.einsum("cnk,nk->cn", away, cells.normals) / distance, 0.0)
    lobe = np.maximum(-np.einsum("cnk,ck->cn", away, facing) / distance, 0.0)
    lobe[~facing.any(axis=1)] = 1.0
    irradiance = cosine * lobe * (cells.diagonal / distance) ** 2 / TYPICAL_IRRADIANCE
    if occupancy is None:
        return np.asarray(irradiance)
    distinct, row = np.unique(positions, axis=0, return_inverse=True)
    return np.asarray(irradiance * visible_fraction(cells, occupancy, distinct, samples)[row.ravel()])


def visible_fraction(cells: PlaneCells, occupancy: Occupancy, positions: FloatArray, samples: int) -> FloatArray:
    """Return the fraction (c, n) of the sample points of each cell that see each position (c, 3).

    Parameters
    ----------
    samples : int
        Number of sample points per cell: 1, the centre, or 2 points about it.
    """
    normals = cells.normals
    seed = np.where(np.abs(normals[:, :1]) < 0.8, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    across = np.cross(normals, seed)
    across *= SAMPLE_OFFSET * CELL * cells.diagonal / np.linalg.norm(across, axis=1, keepdims=True)
    along = np.cross(normals, across)
    offsets = [0.0] if samples == 1 else [-0.7, 0.7]
    points = np.stack([cells.positions + k * (across + along) for k in offsets], axis=1)
    is_visible = occupancy.is_unobstructed(points.reshape(-1, 3), np.repeat(normals, samples, axis=0), positions)
    return np.asarray(is_visible.reshape(len(positions), -1, samples).mean(axis=-1))


def is_visibly_free(positions: FloatArray, cloud: ColouredPoints, images: SceneImages) -> BoolArray:
    """Return which positions (n, 3) an image looks through without clipped pixels nearby.

    Parameters
    ----------
    positions : (n, 3) ndarray of float
        Positions in the scene.
    cloud : ColouredPoints
        Points of the scene.
    images : SceneImages
        Images of the reconstruction.
    """
    import cv2
    from scipy.spatial import cKDTree

    free = np.zeros(len(positions), dtype=bool)
    for row in evenly_spaced(images.rows, MAX_IMAGES):
        view = images.scene.views[row]
        points = visible_points(view, cloud, row)
        pixels, depths = pixels_in_view(view, positions)
        inside = np.flatnonzero(np.isfinite(pixels[:, 0]) & ~free)
        if not len(inside) or len(points.rows) < DEPTH_POINTS:
            continue
        width_factor = view.camera.width / 640
        distance, nearest = cKDTree(points.pixels).query(pixels[inside], k=DEPTH_POINTS)
        surface = np.median(points.depths[nearest], axis=1)
        in_front = (depths[inside] < MAX_FREE_DEPTH * surface) & (distance[:, -1] < MAX_POINT_PX * width_factor)
        size = 2 * round(CLIPPED_RADIUS_PX * width_factor) + 1
        brightest = cv2.dilate(images.image(row).max(axis=-1), np.ones((size, size), np.uint8))
        columns, rows = pixels[inside].astype(np.int64).T
        free[inside] |= in_front & (brightest[rows, columns] < MIN_CLIPPED_LEVEL)
    return free
