"""Simulate typical errors of reconstructed depth: at outlines, grazing angles and faces without texture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from metric_base.arrays import BoolArray, FloatArray, IntArray
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.render import Frame
from tests.synthetic.rooms.world import Pinhole, World

__all__ = ["BARE_KEPT_FRACTION", "SurfaceSamples", "bare_samples", "relative_errors", "surface_samples"]

#: Half width of the matching window of stereo in pixels; outlines within this distance cause errors.
WINDOW_PX = 4
#: Minimum relative difference of the depths of two surfaces at an outline.
MIN_DEPTH_STEP = 0.08
#: Fraction of the points at an outline that are between the two surfaces, for a smear of 1.
BETWEEN_FRACTION = 0.35
#: Maximum factor of the error at grazing angles.
MAX_SLANT = 5.0
#: Fraction of points with a large error, and the factor of this error: heavy tails of almost wrong matches.
TAIL_FRACTION = 0.1
TAIL_FACTOR = 4.0
#: Fraction of the points that a face without texture keeps, and the factor of their error.
BARE_KEPT_FRACTION = 0.25
BARE_FACTOR = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSamples:
    """Geometry of the surface at n sampled pixels.

    slant : (n,) 1 / cosine of the angle between line of sight and normal.
    other : (n,) depth of the other surface at a close outline; NaN without outline.
    """

    slant: FloatArray
    other: FloatArray


def surface_samples(frame: Frame, camera: Pinhole, rows: IntArray, columns: IntArray) -> SurfaceSamples:
    """Return the geometry of the surface at pixels (n,) of a frame."""
    depth = np.where(np.isfinite(frame.depth), frame.depth, 1e3)
    low, high = minimum_filter(depth, 2 * WINDOW_PX + 1), maximum_filter(depth, 2 * WINDOW_PX + 1)
    sampled = depth[rows, columns]
    near, far = low[rows, columns], high[rows, columns]
    other = np.where(far / sampled > sampled / near, far, near)
    other = np.where(np.maximum(far / sampled, sampled / near) > 1 + MIN_DEPTH_STEP, other, np.nan)
    # the inverse depth of a plane is linear in the pixel: w = a x + b y + c, with the normal (a, b, c)
    inverse = np.asarray(1 / depth)
    down, right = (np.asarray(part) for part in np.gradient(inverse))
    a, b = right[rows, columns] * camera.focal, down[rows, columns] * camera.focal
    x, y = (columns + 0.5 - camera.width / 2) / camera.focal, (rows + 0.5 - camera.height / 2) / camera.focal
    w = inverse[rows, columns]
    c = w - a * x - b * y
    cosine = w / np.sqrt((a**2 + b**2 + c**2) * (x**2 + y**2 + 1))
    return SurfaceSamples(np.minimum(1 / np.maximum(np.abs(cosine), 1e-6), MAX_SLANT), other)


def relative_errors(
    surface: SurfaceSamples, depth: FloatArray, bare: BoolArray, knobs: Knobs, generator: np.random.Generator
) -> FloatArray:
    """Return relative errors (n,) along the rays of points.

    depth : (n,) true depth.
    bare : (n,) whether the face has no texture.
    """
    count = len(depth)
    sigma = knobs.depth_noise * (1 + knobs.smear * (surface.slant - 1))
    sigma = sigma * np.where(generator.random(count) < TAIL_FRACTION * knobs.smear, TAIL_FACTOR, 1.0)
    error = generator.normal(0, 1, count) * sigma * np.where(bare, BARE_FACTOR, 1.0)
    between = np.isfinite(surface.other) & (generator.random(count) < BETWEEN_FRACTION * knobs.smear)
    part = generator.random(count)
    return np.where(between, part * (np.nan_to_num(surface.other, nan=1.0) / depth - 1), error)


def bare_samples(world: World, points: FloatArray, number: IntArray, fraction: float) -> BoolArray:
    """Return which points (n, 3) on objects `number` (n,) are on faces without texture.

    The face of a point is the closest side of the object's bounding box. A random `fraction` of the faces is bare; the
    selection depends on the world only.
    """
    generator = np.random.default_rng([world.seed, len(world.objects), 5])
    bare = np.zeros(len(points), dtype=bool)
    for k, item in enumerate(world.objects):
        is_bare_face = generator.random(6) < fraction
        rows = np.flatnonzero(number == k + 1)
        vertices = item.mesh.vertices
        distance = np.hstack([points[rows] - vertices.min(axis=0), vertices.max(axis=0) - points[rows]])
        bare[rows] = is_bare_face[np.abs(distance).argmin(axis=1)]
    return bare
