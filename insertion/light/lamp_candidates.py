"""Where a lamp may be, and how a lamp there would light the cells of the planes, shadows included.

Places that the pictures show to be empty air: no lamp hangs there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from estimator.projection.cameras import pixels_in_view
from insertion.footage.footage import Stills
from insertion.scene.occupancy import Occupancy
from insertion.scene.plane_cells import CELL, Patches
from insertion.scene.point_cloud import Cloud, even_rows, front_points
from metric_base.arrays import BoolArray, FloatArray

#: Candidates along the horizontal axes and up; lamps are in the upper part of the room.
GRID, LEVELS, LOWEST = 11, 6, 0.45
#: Most lamps hang in this upper part of the room, or are windows in a wall: the log odds of one that stands about.
OVERHEAD, STANDING = 0.8, -4.0
#: Walls that no picture shows are further out than what they show, by this share of it.
BEYOND = 0.12
#: The ceiling is higher than what the pictures show of the walls, by this share of it.
ABOVE = 0.2
#: Cells of the ceiling along each side.
CEILING_CELLS = 8
#: A room whose ceiling is not seen is taken to be this high, in longer sides.
HEIGHT_SHARE = 0.55
#: A plane is upright if its normal's cosine with up is below this.
UPRIGHT = 0.3
#: Irradiance of a lamp of strength 1 at an ordinary place, in 1 / diagonal^2: a third of a diagonal away.
USUAL = 10.0
#: Lamps that are tried about a place, and one sigma of how their direction tilts.
NEARBY, TILT = 16, 0.35
#: No lamp is nearer to a surface than this, in diagonals.
NEAREST = 0.04
#: How far from the middle of a cell its spots are, in sides of the cell; how many are asked for lamps all over a room,
#: of which only the order matters, for lamps about a place, and for the share of a cell that is lit.
SPOT = 0.3
SPOTS_ALL_OVER, SPOTS_NEAR, SPOTS = 1, 2, 4
#: Stills that are asked.
MAX_STILLS = 12
#: Neighbouring points of the cloud that say how far a picture sees, no further than so many pixels at a width of 640.
POINTS, REACH_PX = 5, 30.0
#: A place is in front of what the picture shows if it is nearer than this share of its depth.
IN_FRONT = 0.9
#: A lamp is brighter than a picture can hold: a grey level within so many pixels at a width of 640.
DAZZLING, AROUND_PX = 245, 12


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Lamps that may be.

    places, facing : (c, 3) in the scene, facing 0 for a lamp that shines alike to all sides; irradiance : (c, n) on the
    cells at a strength of 1; sent_up : (c,) mean irradiance of the ceiling, the same; log_prior : (c,); spacing :
    between those of the whole room, scene units, which is about as large as lamps are; basis : (3, 3) rows two
    horizontal axes and up; barred : (b, 3) places between them at which no lamp is; ceiling : its cells, whose
    brightness is not known.
    """

    places: FloatArray
    facing: FloatArray
    irradiance: FloatArray
    sent_up: FloatArray
    log_prior: FloatArray
    spacing: float
    basis: FloatArray
    barred: FloatArray
    ceiling: Patches


def candidates_in(
    patches: Patches, up: FloatArray, impossible: Callable[[FloatArray], BoolArray] | None, occupancy: Occupancy | None
) -> Candidates:
    """Lamps all over the room; up : (3,) unit vector; impossible : which of (n, 3) places no lamp is at, (n,)."""
    basis = _basis(patches, up)
    local = patches.places @ basis.T
    low, high = local.min(axis=0), local.max(axis=0)
    high[2] = max(high[2] + ABOVE * (high - low)[2], low[2] + HEIGHT_SHARE * float((high - low)[:2].max()))
    beyond = BEYOND * (high - low)
    steps = [np.linspace(low[k] - beyond[k], high[k] + beyond[k], GRID) for k in range(2)]
    levels = np.linspace(low[2] + LOWEST * (high[2] - low[2]), high[2], LEVELS)
    grid = np.stack(np.meshgrid(*steps, levels, indexing="ij"), axis=-1).reshape(-1, 3)
    kept = np.ones(len(grid), dtype=bool) if impossible is None else ~impossible(grid @ basis)
    barred = grid[~kept] @ basis
    grid, facing = _with_facing(grid[kept], steps, levels)
    places, facing = grid @ basis, facing @ basis
    standing = ~facing.any(axis=1) & (grid[:, 2] < low[2] + OVERHEAD * (high[2] - low[2]))
    odds = np.where(standing, STANDING, 0.0)
    light = lamp_irradiance(patches, places, facing, occupancy, SPOTS_ALL_OVER)
    ceiling = _ceiling(patches, places, basis)
    spacing = float(steps[0][1] - steps[0][0])
    return Candidates(places, facing, light, _sent_up(ceiling, places, facing), odds, spacing, basis, barred, ceiling)


def candidates_near(
    all_over: Candidates,
    place: FloatArray,
    facing: FloatArray,
    spread: float,
    patches: Patches,
    occupancy: Occupancy | None,
    generator: np.random.Generator,
) -> Candidates:
    """Lamps about a place (3,), the first at it; facing : (3,) as it is, nearly so, downwards, or to all sides.

    all_over : those of the whole room; spread : one sigma of their places, scene units.
    """
    offsets = generator.normal(0.0, spread, (NEARBY, 3))
    offsets[0] = 0.0
    nearly = facing + generator.normal(0.0, TILT, (NEARBY, 3)) * facing.any()
    nearly /= np.maximum(np.linalg.norm(nearly, axis=1, keepdims=True), 1e-9)
    ways = [np.tile(facing, (NEARBY, 1)), nearly, np.tile(-all_over.basis[2], (NEARBY, 1)), np.zeros((NEARBY, 3))]
    places = place + offsets
    local, room = places @ all_over.basis.T, all_over.places @ all_over.basis.T
    outside = ((local < room.min(axis=0)) | (local > room.max(axis=0))).any(axis=1)
    odds = np.tile(np.where(outside | _where_barred(all_over, places), -np.inf, 0.0), len(ways))
    odds[0] = 0.0
    places, directions = np.tile(places, (len(ways), 1)), np.concatenate(ways)
    light = lamp_irradiance(patches, places, directions, occupancy, SPOTS_NEAR)
    sent_up = _sent_up(all_over.ceiling, places, directions)
    return replace(all_over, places=places, facing=directions, irradiance=light, sent_up=sent_up, log_prior=odds)


def _ceiling(patches: Patches, places: FloatArray, basis: FloatArray) -> Patches:
    """Cells of the ceiling over the patches, as high as the highest of places (c, 3); their brightness is not known."""
    local = patches.places @ basis.T
    low, high = local.min(axis=0), local.max(axis=0)
    top = [float((places @ basis[2]).max())]
    sides = [np.linspace(low[k], high[k], CEILING_CELLS) for k in range(2)]
    cells = np.stack(np.meshgrid(*sides, top, indexing="ij"), axis=-1).reshape(-1, 3) @ basis
    downward = np.broadcast_to(-basis[2], cells.shape)
    return Patches(cells, downward, np.zeros(len(cells)), np.zeros(len(cells), dtype=np.int64), patches.diagonal)


def _sent_up(ceiling: Patches, places: FloatArray, facing: FloatArray) -> FloatArray:
    """(c,) mean irradiance of the ceiling by lamps at places with directions (c, 3) and a strength of 1."""
    return np.asarray(lamp_irradiance(ceiling, places, facing, None).mean(axis=1))


def _where_barred(candidates: Candidates, places: FloatArray) -> BoolArray:
    """(n,) whether a place (n, 3) is nearer to one at which no lamp is than to any at which one may be."""
    if not len(candidates.barred):
        return np.zeros(len(places), dtype=bool)
    free, barred = (
        np.linalg.norm(places[:, None] - some, axis=-1).min(axis=1) for some in (candidates.places, candidates.barred)
    )
    return np.asarray(barred < free)


def lamp_irradiance(
    patches: Patches, places: FloatArray, facing: FloatArray, occupancy: Occupancy | None, spots: int = SPOTS
) -> FloatArray:
    """(c, n) irradiance of lamps at places with directions (c, 3) and a strength of 1 on the cells.

    spots : of each cell that are asked whether they see a lamp.
    """
    away = places[:, None] - patches.places  # (c, n, 3)
    distance = np.maximum(np.linalg.norm(away, axis=-1), NEAREST * patches.diagonal)
    cosine = np.maximum(np.einsum("cnk,nk->cn", away, patches.normals) / distance, 0.0)
    shone = np.maximum(-np.einsum("cnk,ck->cn", away, facing) / distance, 0.0)
    shone[~facing.any(axis=1)] = 1.0
    irradiance = cosine * shone * (patches.diagonal / distance) ** 2 / USUAL
    if occupancy is None:
        return np.asarray(irradiance)
    alone, row = np.unique(places, axis=0, return_inverse=True)
    return np.asarray(irradiance * open_share(patches, occupancy, alone, spots)[row.ravel()])


def open_share(patches: Patches, occupancy: Occupancy, places: FloatArray, spots: int = SPOTS) -> FloatArray:
    """(c, n) share of each cell that a lamp at each of (c, 3) places reaches: of its middle, or of 2 or 4 `spots`."""
    normals = patches.normals
    seed = np.where(np.abs(normals[:, :1]) < 0.8, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    across = np.cross(normals, seed)
    across *= SPOT * CELL * patches.diagonal / np.linalg.norm(across, axis=1, keepdims=True)
    along = np.cross(normals, across)
    ways = [(0, 0)] if spots == 1 else [(-0.7, -0.7), (0.7, 0.7)] if spots == 2 else [(-1, 0), (1, 0), (0, -1), (0, 1)]
    at = np.stack([patches.places + k * across + m * along for k, m in ways], axis=1)
    shown = occupancy.open_segments(at.reshape(-1, 3), np.repeat(normals, len(ways), axis=0), places)
    return np.asarray(shown.reshape(len(places), -1, len(ways)).mean(axis=-1))


def _with_facing(grid: FloatArray, steps: list[FloatArray], levels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places with how a lamp there may shine: to all sides, from high up downwards, from a wall inwards.

    grid : (m, 3) along two horizontal axes and up; steps : (g,) on each horizontal axis; levels : (l,) heights; places
    and directions are (c, 3).
    """
    ways = [(grid, np.zeros(3)), (grid[grid[:, 2] >= levels[LEVELS // 2]], np.array([0.0, 0.0, -1.0]))]
    for axis in range(2):
        for end, inward in ((0, 1.0), (-1, -1.0)):
            direction = np.zeros(3)
            direction[axis] = inward
            ways.append((grid[grid[:, axis] == steps[axis][end]], direction))
    return np.concatenate([some for some, _ in ways]), np.concatenate([np.tile(way, (len(s), 1)) for s, way in ways])


def _basis(patches: Patches, up: FloatArray) -> FloatArray:
    """(3, 3) rows two horizontal axes, along the walls where there are any, and up."""
    upright = patches.normals[np.abs(patches.normals @ up) < UPRIGHT]
    across = upright[0] if len(upright) else np.array([1.0, 0, 0] if abs(up[0]) < 0.8 else [0, 1.0, 0])
    across = across - (across @ up) * up
    across /= np.linalg.norm(across)
    return np.array([across, np.cross(up, across), up])


def shown_empty(places: FloatArray, cloud: Cloud, stills: Stills) -> BoolArray:
    """(n,) places (n, 3) that some picture looks through without being dazzled."""
    from scipy.spatial import cKDTree

    empty = np.zeros(len(places), dtype=bool)
    for row in even_rows(stills.rows, MAX_STILLS):
        view = stills.scene.views[row]
        front = front_points(view, cloud, row)
        pixels, depths = pixels_in_view(view, places)
        inside = np.flatnonzero(np.isfinite(pixels[:, 0]) & ~empty)
        if not len(inside) or len(front.rows) < POINTS:
            continue
        times = view.camera.width / 640
        distance, nearest = cKDTree(front.pixels).query(pixels[inside], k=POINTS)
        behind = np.median(front.depths[nearest], axis=1)
        through = (depths[inside] < IN_FRONT * behind) & (distance[:, -1] < REACH_PX * times)
        empty[inside] |= through & ~_dazzling(stills.picture(row), pixels[inside], AROUND_PX * times)
    return empty


def _dazzling(picture: np.ndarray, pixels: FloatArray, reach: float) -> BoolArray:
    """(n,) whether the picture is clipped near each pixel."""
    import cv2

    size = 2 * round(reach) + 1
    brightest = cv2.dilate(picture.max(axis=-1), np.ones((size, size), np.uint8))
    at = pixels.astype(np.int64)
    return np.asarray(brightest[at[:, 1], at[:, 0]] >= DAZZLING)
