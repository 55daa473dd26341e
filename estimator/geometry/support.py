"""Extend objects whose foot is not reconstructed down to the surface below them.

Legs are thin, castors dark and sills low, so that a cloud ends above the foot and the height is too small. The surface
is found in the cloud around the footprint (`find_support_level`), because the object hides the part below it. If the
category determines whether the object stands on the floor or hangs, it decides whether the gap is filled
(`foot_on_level`); otherwise the masks decide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.geometry.planes import height_bin_width
from estimator.records.objects import SupportPlane
from metric_base.arrays import FloatArray
from metric_base.statistics import robust_sigma

# Width of the ring around the footprint that is searched, relative to the mean side. The object hides what is inside.
RING_WIDTH_FRACTION = 0.6
# Minimum number of points of a surface in the ring.
MIN_RING_POINTS = 10
# Minimum number of the eight sectors of the ring with points of the surface. A surface in one or two sectors, such as a
# shelf at one corner of the object, is excluded.
MIN_RING_SECTORS = 3
# Minimum number of points of a level, relative to the level with most points; the highest such level is used.
MIN_RING_LEVEL_FRACTION = 0.3
# Multiple of the median number of points of the height bins that is subtracted: a wall has points at all heights, and
# therefore no level.
WALL_FACTOR = 2.0
# Contact tolerance between a foot and its level, as a fraction of the height of the object and at least one height bin
# (the roughness of the cloud). It is the accuracy of the extent rule.
MAX_CONTACT_FRACTION = 0.06
# Maximum gap that is filled if neither masks nor category determine it (legs of cabinets, bags), relative to the height
# of the points. Wall-mounted objects hang at least their height above the surface.
MAX_UNOBSERVED_GAP = 0.35
# Maximum gap in place of `MAX_UNOBSERVED_GAP` if the masks show the lower end. It is not zero, because occluders also
# hide the foot in masks.
MAX_OBSERVED_GAP = 0.12
# Minimum fraction of the gap that a mask covers if it shows a foot there.
MIN_REACH_FRACTION = 0.5
# Maximum gap below an object that stands on the floor, relative to the height of its points. These may be a
# desk top alone, a tenth to a sixth of the height of the desk; a larger gap belongs to another object.
MAX_FLOOR_GAP = 12.0
# Standard deviation of the height of a level, relative to its roughness.
LEVEL_SIGMA_FRACTION = 0.3
# Standard deviation that filling a gap adds to the log height, relative to the filled fraction of the height: feet end
# slightly above or below the surface, and sometimes it is the wrong surface.
FILLED_SIGMA = 0.05
# Maximum ratio of height to smaller side of a floor-standing object whose points are a table top without legs.
MAX_SLAB_ASPECT = 0.35
# Minimum distance of the support below a table top, relative to its thickness; closer levels are its underside.
MIN_SLAB_CLEARANCE = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class SupportCloud:
    """The downsampled cloud of a scene, in which supports are searched."""

    points: FloatArray  #: (n, 3) coordinates in the level basis, n > 0.
    bin_width: float  #: Width of a height bin, in scene units.
    floor: SupportPlane | None

    @classmethod
    def from_points(cls, points: FloatArray, floor: SupportPlane | None) -> SupportCloud | None:
        """Return the cloud of points (n, 3) in the level basis, or None without points."""
        return cls(points, height_bin_width(points[:, 2]), floor) if len(points) else None


@dataclass(frozen=True, slots=True)
class SupportLevel:
    """A level surface below an object."""

    height: float  #: Along the vertical, in scene units.
    sigma: float  #: Its roughness, in scene units.


@dataclass(frozen=True, slots=True)
class Foot:
    """The lower end of an object."""

    bottom: float  #: Height along the vertical, in scene units.
    sigma: float = 0.0  #: Standard deviation that this end adds to the log height.
    is_supported: bool = False  #: The object is on a level surface.
    is_extended: bool = False  #: A gap to that surface was filled.
    is_truncated: bool = False  #: A part of the object is missing below.


def find_support_level(
    cloud: SupportCloud, corners: FloatArray, low: FloatArray, high: FloatArray, stands: bool | None
) -> SupportLevel | None:
    """Find the highest level surface around the foot of an object, at or below it, or the floor if there is none.

    Parameters
    ----------
    cloud : SupportCloud
    corners : (4, 2) ndarray of float
        Corners of the footprint in the level basis, in order around it.
    low, high : (3,) ndarray of float
        Ends of the object along length, width and vertical.
    stands : bool or None
        Whether the category stands on the floor; None if unknown.

    Returns
    -------
    SupportLevel or None
        The floor if the category stands on it and the level around the object does not touch it. None without a level
        and without a floor below the object.
    """
    bottom, height = float(low[2]), float(high[2] - low[2])
    highest = bottom + _contact_tolerance(height, cloud.bin_width)
    if _is_slab(low, high, stands):
        highest = bottom - MIN_SLAB_CLEARANCE * height
    centre = corners.mean(axis=0)
    sides = np.stack([corners[1] - corners[0], corners[3] - corners[0]])
    lengths = np.maximum(np.linalg.norm(sides, axis=1), np.finfo(float).tiny)
    ring = RING_WIDTH_FRACTION * float(lengths.mean())
    near = np.flatnonzero(
        (np.abs(cloud.points[:, :2] - centre) < np.linalg.norm(lengths) / 2 + ring).all(axis=1)
        & (cloud.points[:, 2] < highest)
    )
    # Distances (k, 2) beyond the sides of the rectangle.
    along = (cloud.points[near, :2] - centre) @ (sides / lengths[:, None]).T
    beyond = (np.abs(along) - lengths / 2).max(axis=1)
    is_around = (beyond > 0) & (beyond < ring)
    heights = cloud.points[near[is_around], 2]
    sectors = np.floor(np.arctan2(along[is_around, 1], along[is_around, 0]) / (np.pi / 4)).astype(np.int64) + 4
    level = _ring_level(heights, sectors, highest, cloud.bin_width)
    is_touching = level is not None and bottom - level.height <= _contact_tolerance(height, cloud.bin_width)
    # For an object that stands on the floor, other surfaces below it are irrelevant.
    if level is not None and (is_touching or stands is not True or cloud.floor is None):
        return level
    if cloud.floor is not None and cloud.floor.height < highest:
        return SupportLevel(cloud.floor.height, cloud.floor.sigma)
    return level


def foot_on_level(
    level: SupportLevel | None,
    low: FloatArray,
    high: FloatArray,
    roughness: float,
    stands: bool | None,
    reach: float,
) -> Foot:
    """Decide whether an object extends down to a level surface below it.

    Parameters
    ----------
    level : SupportLevel or None
    low, high : (3,) ndarray of float
        Ends of the object along length, width and vertical.
    roughness : float
        Roughness of the cloud, in scene units.
    stands : bool or None
        Whether the category stands on the floor; None if unknown.
    reach : float
        Fraction of the gap that the masks, or a few points of the object, cover: 0 if they end at the lower end of the
        extent, 1 if they end at the level, NaN if unknown.
    """
    bottom, height = float(low[2]), float(high[2] - low[2])
    is_slab = _is_slab(low, high, stands)
    if level is None:
        return Foot(bottom, is_truncated=is_slab)
    gap = bottom - level.height
    total = float(high[2]) - level.height
    sigma = LEVEL_SIGMA_FRACTION * level.sigma / max(total, np.finfo(float).tiny)
    if gap <= _contact_tolerance(height, roughness):
        return Foot(level.height, sigma, is_supported=True) if total > height / 2 else Foot(bottom)
    if stands is None:
        max_gap = MAX_OBSERVED_GAP if np.isfinite(reach) else MAX_UNOBSERVED_GAP
        is_filled = gap <= max_gap * height or bool(reach > MIN_REACH_FRACTION)
    else:
        is_filled = stands and gap <= MAX_FLOOR_GAP * height
    if not is_filled:
        return Foot(bottom, is_truncated=is_slab)
    return Foot(level.height, float(np.hypot(sigma, FILLED_SIGMA * gap / total)), is_supported=True, is_extended=True)


def _contact_tolerance(height: float, roughness: float) -> float:
    """Return the maximum distance of a foot from the level that it is on."""
    return max(MAX_CONTACT_FRACTION * height, roughness)


def _is_slab(low: FloatArray, high: FloatArray, stands: bool | None) -> bool:
    """Return True if a floor-standing object from `low` (3,) to `high` (3,) is too flat to include its legs."""
    return stands is True and float(high[2] - low[2]) < MAX_SLAB_ASPECT * float((high - low)[:2].min())


def _ring_level(heights: FloatArray, sectors: FloatArray, highest: float, bin_width: float) -> SupportLevel | None:
    """Find the highest level among heights (n,) of points around an object, whose sectors (n,) are given modulo 8."""
    if len(heights) < MIN_RING_POINTS:
        return None
    index = np.floor((highest - heights) / bin_width).astype(np.int64)
    bins = int(index.max()) + 2
    counts = np.bincount(index, minlength=bins)
    # Pairs of adjacent bins, so that a level at their border is complete.
    pairs = counts[:-1] + counts[1:]
    has_sector = np.zeros((bins, 8), dtype=bool)
    has_sector[index, sectors % 8] = True
    is_wide = (has_sector[:-1] | has_sector[1:]).sum(axis=1) >= MIN_RING_SECTORS
    # A wall has points at every height; a level stands out.
    level = (pairs - WALL_FACTOR * np.median(pairs)) * is_wide
    if level.max() < MIN_RING_POINTS:
        return None
    first = int(np.flatnonzero(level >= max(MIN_RING_POINTS, MIN_RING_LEVEL_FRACTION * level.max()))[0])
    # The first bins of a thick level are its upper edge; continue to its peak.
    while first + 1 < len(level) and level[first + 1] > level[first]:
        first += 1
    inside = heights[(index == first) | (index == first + 1)]
    return SupportLevel(float(np.median(inside)), robust_sigma(inside))
