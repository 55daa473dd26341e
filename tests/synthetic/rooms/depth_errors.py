"""Errors of reconstructed depth as real depth has them: outlines, grazing angles, bare faces, glossy floors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from metric_base.arrays import BoolArray, FloatArray, IntArray
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.render import Frame
from tests.synthetic.rooms.world import Pinhole, World

__all__ = ["BARE_KEPT", "Outlook", "bare_samples", "outlook", "relative_errors"]

#: A window of stereo matching reaches this far over an outline, in pixels.
REACH_PX = 4
#: Depths that differ by more than this share are two surfaces.
STEP = 0.08
#: Share of the points beside an outline that lie between the two surfaces, at a smear of 1.
BETWEEN = 0.35
#: At a grazing angle the error grows with the slant of the surface, to this much.
MOST_SLANT = 5.0
#: One point in ten has four times the error: matches that are nearly wrong.
TAIL_SHARE, TAIL_TIMES = 0.1, 4.0
#: A bare face keeps this share of its points, and these have this many times the error.
BARE_KEPT, BARE_TIMES = 0.25, 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Outlook:
    """How the surface is seen at sampled pixels.

    slant : (n,) 1 / cosine of the angle between sight and normal; other : (n,) depth of the other surface at an outline
    within reach, NaN where there is none.
    """

    slant: FloatArray
    other: FloatArray


def outlook(frame: Frame, camera: Pinhole, rows: IntArray, columns: IntArray) -> Outlook:
    """The outlook of pixels (n,) of a frame."""
    depth = np.where(np.isfinite(frame.depth), frame.depth, 1e3)
    low, high = minimum_filter(depth, 2 * REACH_PX + 1), maximum_filter(depth, 2 * REACH_PX + 1)
    own = depth[rows, columns]
    near, far = low[rows, columns], high[rows, columns]
    other = np.where(far / own > own / near, far, near)
    other = np.where(np.maximum(far / own, own / near) > 1 + STEP, other, np.nan)
    # inverse depth of a plane is linear in the pixel: w = a x + b y + c, normal (a, b, c)
    inverse = np.asarray(1 / depth)
    down, right = (np.asarray(part) for part in np.gradient(inverse))
    a, b = right[rows, columns] * camera.focal, down[rows, columns] * camera.focal
    x, y = (columns + 0.5 - camera.width / 2) / camera.focal, (rows + 0.5 - camera.height / 2) / camera.focal
    w = inverse[rows, columns]
    c = w - a * x - b * y
    cosine = w / np.sqrt((a**2 + b**2 + c**2) * (x**2 + y**2 + 1))
    return Outlook(np.minimum(1 / np.maximum(np.abs(cosine), 1e-6), MOST_SLANT), other)


def relative_errors(
    sight: Outlook, depth: FloatArray, bare: BoolArray, knobs: Knobs, generator: np.random.Generator
) -> FloatArray:
    """(n,) relative errors along the ray of points at `depth` (n,), `bare` (n,) on faces without texture."""
    count = len(depth)
    sigma = knobs.depth_noise * (1 + knobs.smear * (sight.slant - 1))
    sigma = sigma * np.where(generator.random(count) < TAIL_SHARE * knobs.smear, TAIL_TIMES, 1.0)
    error = generator.normal(0, 1, count) * sigma * np.where(bare, BARE_TIMES, 1.0)
    between = np.isfinite(sight.other) & (generator.random(count) < BETWEEN * knobs.smear)
    part = generator.random(count)
    return np.where(between, part * (np.nan_to_num(sight.other, nan=1.0) / depth - 1), error)


def bare_samples(world: World, points: FloatArray, number: IntArray, share: float) -> BoolArray:
    """(n,) which points (n, 3) on object `number` (n,) are on a face without texture.

    A face is the side of its object's box that a point is nearest to; `share` of the faces are bare, the same ones
    whenever a world is asked.
    """
    generator = np.random.default_rng([world.seed, len(world.objects), 5])
    bare = np.zeros(len(points), dtype=bool)
    for k, item in enumerate(world.objects):
        chosen = generator.random(6) < share
        mine = np.flatnonzero(number == k + 1)
        vertices = item.mesh.vertices
        apart = np.hstack([points[mine] - vertices.min(axis=0), vertices.max(axis=0) - points[mine]])
        bare[mine] = chosen[np.abs(apart).argmin(axis=1)]
    return bare
