"""The sun, from the shadows that what stands on the ground throws on it.

The points above the ground are moved onto it along every direction in which the sun may be. Where the sun really is,
the ground is darker there and bluer, since the sky alone lights a shadow. That it is so near what stands, whatever
the sun does, is taken off first: the mean over all ways in which the shadows of an elevation could fall. The sun counts
if two halves of the points say the same, and if shadows are as dark as those of a sun that shines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.geometry.planes import SupportPlane
from estimator.visibility.depth_buffer import unhidden
from insertion.colour.encoding import luminance, srgb_to_linear
from insertion.footage.footage import Stills
from insertion.scene.cloud import Cloud, even_rows
from insertion.scene.rays import camera_rays
from metric_base.arrays import BoolArray, FloatArray

__all__ = ["sun_direction"]

#: Stills that are looked at, pixels between samples, and how far the ground is looked at, in heights of the camera.
MAX_STILLS, STEP, REACH = 24, 4, 8.0
#: A pixel shows the ground if its nearest points do, none further than so many pixels at a width of 640.
NEAREST, NEAR_PX = 3, 60.0
#: The ground is cut into cells of this size; points count as ground below the first height and throw shadows from there
#: to the last, all in heights of the camera.
CELL, HEIGHTS = 0.12, (0.1, 8.0)
#: One sigma of what is smoothed, in cells: the paint of the ground, and the shadow of a point.
PAINT, SHADOW = 10.0, 1.0
#: Elevations and azimuths in degrees that are tried, and those about the best.
ELEVATIONS, AZIMUTHS = np.array([20.0, 28.0, 37.0, 47.0, 57.0, 67.0]), np.arange(0.0, 360.0, 10.0)
#: Parts of the points along the scene, every second of which is one half of them.
PARTS = 4
#: The halves agree within this azimuth in degrees, and in a shadow the logarithm of the luminance is so much less: the
#: sun sends the ground at least as much as the sky does.
AGREE_DEG, LEAST_DARK = 30.0, 0.7
#: The sun is in the middle of the ways that score this share of the best one, within this angle of it in radians.
ALIKE, NEAR = 0.8, np.radians(25)
#: Darkness and blueness of a cell that count; more is another material.
MOST_DARK, MOST_BLUE = 1.5, 0.5
#: A pixel's linear value that is no noise.
DARKEST = 4e-3
#: Fewest and most cells of the ground, and fewest points, that are asked.
LEAST_CELLS, MOST_CELLS, LEAST_POINTS = 500, 200_000, 100


@dataclass(frozen=True, slots=True, eq=False)
class _Ground:
    """The ground as cells: low (2,) where they start along the plane's axes, cell their side in scene units.

    known : (a, b) those that pictures show; dark, blue : (n,) by how much each of these is darker, and bluer over red,
    than what is around, as logarithms.
    """

    low: FloatArray
    cell: float
    known: BoolArray
    dark: FloatArray
    blue: FloatArray

    def shadow(self, points: FloatArray, toward: FloatArray) -> FloatArray:
        """(n,) how far each known cell is in the shadow of points (k, 3) above the plane; toward : (3,) the sun."""
        from scipy.ndimage import gaussian_filter

        at = np.floor((points[:, :2] - points[:, 2:] * toward[:2] / toward[2] - self.low) / self.cell).astype(np.int64)
        at = at[((at >= 0) & (at < self.known.shape)).all(axis=1)]
        hit = np.zeros(self.known.shape, dtype=np.float32)
        hit[tuple(at.T)] = 1.0
        return np.asarray(np.minimum(3 * gaussian_filter(hit, SHADOW)[self.known], 1.0), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class _Fits:
    """Of each way: scores (w,) sum of two correlations; darkening (w,) less log luminance where shadows should be."""

    scores: FloatArray
    darkening: FloatArray


def sun_direction(cloud: Cloud, stills: Stills, plane: SupportPlane) -> FloatArray | None:
    """(3,) unit vector towards the sun, None where no shadow on the plane says where it is."""
    local = cloud.points @ plane.basis.T - [0, 0, plane.height]
    rows = even_rows(stills.rows, MAX_STILLS)
    rise = float(np.median([stills.scene.views[row].centre @ plane.basis[2] for row in rows])) - plane.height
    low, high = rise * HEIGHTS[0], rise * HEIGHTS[1]
    ground = _ground(_ground_samples(cloud, stills, plane, local[:, 2] < low, rise), rise)
    casters = local[(local[:, 2] > low) & (local[:, 2] < high)]
    if ground is None or len(casters) < LEAST_POINTS:
        return None
    along = casters[:, :2] - casters[:, :2].mean(axis=0)
    order = np.argsort(np.argsort(along @ np.linalg.svd(along, full_matrices=False)[2][0]))
    odd = order * PARTS // len(order) % 2 == 1
    ways = _ways(ELEVATIONS, AZIMUTHS)
    first, second, both = (_fits(ground, casters[part], ways) for part in (odd, ~odd, slice(None)))
    one, two = (ways[fit.scores.argmax(), :2] for fit in (first, second))
    cosine = float(one @ two) / float(np.linalg.norm(one) * np.linalg.norm(two))
    best = int(both.scores.argmax())
    if cosine < np.cos(np.radians(AGREE_DEG)) or both.darkening[best] < LEAST_DARK:
        return None
    weights = np.maximum(both.scores - ALIKE * both.scores[best], 0.0) * (ways @ ways[best] > np.cos(NEAR))
    mean = weights @ ways @ plane.basis
    return np.asarray(mean / np.linalg.norm(mean))


def _ways(elevations: FloatArray, azimuths: FloatArray) -> FloatArray:
    """(e * a, 3) unit vectors along the plane's axes, by elevations (e,) and, of each, azimuths (a,) in degrees."""
    rise, turn = (grid.ravel() for grid in np.radians(np.meshgrid(elevations, azimuths, indexing="ij")))
    return np.column_stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)])


def _fits(ground: _Ground, casters: FloatArray, ways: FloatArray) -> _Fits:
    """How well the shadows of casters (k, 3) along ways (w, 3) explain what is dark and blue on the ground."""
    shadows = np.array([ground.shadow(casters, way) for way in ways])  # (w, n)
    all_sides = shadows.reshape(len(ELEVATIONS), -1, shadows.shape[1]).mean(axis=1)
    usual = np.linalg.qr(np.vstack([all_sides, np.ones(shadows.shape[1])]).T)[0]  # (n, e + 1)
    shadows = shadows - (shadows @ usual) @ usual.T
    sizes = np.maximum(np.linalg.norm(shadows, axis=1), 1e-9)
    shade = np.clip(ground.dark, 0, MOST_DARK) * np.clip(ground.blue, 0, MOST_BLUE)
    marks = np.column_stack([shade, ground.blue, ground.dark])  # (n, 3)
    marks = marks - usual @ (usual.T @ marks)
    along = shadows @ marks / sizes[:, None]  # (w, 3)
    scores = (along / np.maximum(np.linalg.norm(marks, axis=0), 1e-9))[:, :2].sum(axis=1)
    return _Fits(scores, along[:, 2] / sizes)


def _ground(samples: FloatArray, rise: float) -> _Ground | None:
    """The ground of samples (n, 4), None where it is hardly seen; rise : of the camera."""
    from scipy.ndimage import gaussian_filter

    if len(samples) < LEAST_CELLS or rise <= 0:
        return None
    low, reach = samples[:, :2].min(axis=0), np.ptp(samples[:, :2], axis=0)
    cell = max(CELL * rise, float(np.sqrt(reach.prod() / MOST_CELLS)))
    at = np.floor((samples[:, :2] - low) / cell).astype(np.int64)
    shape = tuple(at.max(axis=0) + 1)
    flat = np.ravel_multi_index(tuple(at.T), shape)
    count = np.bincount(flat, minlength=int(np.prod(shape))).reshape(shape)
    known = count > 1
    if known.sum() < LEAST_CELLS:
        return None
    share = np.maximum(gaussian_filter(known.astype(float), PAINT), 1e-6)
    marks = []
    for values in samples[:, 2:].T:
        level = np.bincount(flat, values, known.size).reshape(shape) * known / np.maximum(count, 1)
        marks.append((level - gaussian_filter(level, PAINT) / share)[known])
    return _Ground(low, cell, known, *marks)


def _ground_samples(cloud: Cloud, stills: Stills, plane: SupportPlane, low: BoolArray, rise: float) -> FloatArray:
    """(n, 4) places on the ground along the plane's axes, how dark and how blue they are, as logarithms.

    low : (m,) whether each point of the cloud is on the ground; rise : of the camera over it.
    """
    from scipy.spatial import cKDTree

    parts = [np.empty((0, 4))]
    cells = (slice(STEP // 2, None, STEP),) * 2
    for row in even_rows(stills.rows, MAX_STILLS):
        view = stills.scene.views[row]
        rays = camera_rays(view.camera)[cells]
        ways = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1).reshape(-1, 3) @ view.rotation
        sight = unhidden(view, cloud.points)
        if len(sight.rows) < NEAREST:
            continue
        y, x = np.indices(rays.shape[:2]).reshape(2, -1) * STEP + STEP // 2
        distance, nearest = cKDTree(sight.pixels).query(np.column_stack([x, y]), k=NEAREST)
        with np.errstate(divide="ignore"):
            depth = (plane.height - view.centre @ plane.basis[2]) / (ways @ plane.basis[2])
        shown = low[sight.rows[nearest]].all(axis=1) & (distance[:, 0] < NEAR_PX * view.camera.width / 640)
        shown &= (depth > 0) & (depth < REACH * rise)
        light = np.maximum(srgb_to_linear(stills.picture(row)[cells]).reshape(-1, 3)[shown], DARKEST)
        flat = (view.centre + ways[shown] * depth[shown, None]) @ plane.basis[:2].T
        parts.append(np.column_stack([flat, -np.log(luminance(light)), np.log(light[:, 2] / light[:, 0])]))
    return np.concatenate(parts)
