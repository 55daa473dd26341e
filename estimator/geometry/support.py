"""What an object stands on: where its foot is not reconstructed it reaches down to the surface below it.

Legs are thin, castors dark and sills low, so clouds end above the foot and heights come out short. The surface is
looked for in the cloud around the object's footprint; under it lies what the object hides. How far a gap is filled is
decided by the masks where they show the foot, and by the category where it settles the matter: objects that hang are
never dropped to the floor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.geometry.planes import floor_of, height_bin, one_per_cell
from estimator.records.objects import SupportPlane
from metric_base.arrays import FloatArray
from metric_base.statistics import robust_sigma

# The cloud is looked at around the footprint, out to this share of its mean side: closer in it is hidden by the object.
RING_SHARE = 0.6
# A surface around an object has this many points in this many of eight directions; a wall stands in three at the most,
# and is not level.
RING_POINTS = 10
RING_SECTORS = 3
# Of several levels the highest counts that has this share of the richest one's points.
RING_LEVEL_SHARE = 0.3
# ... and this many times those of the usual height more than none, so that no height of a wall passes for a level.
WALL_TIMES = 2.0
# A foot within this share of the height of its level, or within a height bin (the cloud's own roughness), stands on it:
# the extent rule is not surer than that.
CONTACT_SHARE = 0.06
# A gap up to this share of the points' height is filled where neither the masks nor the category tell: legs of cabinets
# and bags of shopping; objects on a wall hang a whole height or more above what is below them.
GAP_SHARE = 0.35
# A gap this small is filled in any case: what hides the foot of an object hides it in the masks too.
OBSERVED_GAP_SHARE = 0.12
# A mask that goes more than half of the way down to the surface shows a foot there; one that does not is evidence
# against.
REACH_SHARE = 0.5
# A desk of which only the top is seen is a tenth to a sixth of its height; a gap of more is another object.
FLOOR_GAP_SHARE = 12.0
# The height of a level is known to a part of its roughness.
LEVEL_SIGMA_SHARE = 0.3
# What filling a gap adds to the log height's standard deviation, per share of the height that was filled: feet end a
# little above or below the surface, and sometimes it is the wrong one.
FILLED_SIGMA = 0.05
# A floor-standing object flatter than this without a floor is a table top without legs.
SLAB_SHARE = 0.35
# What carries a table top lies below it by at least this share of the slab's thickness; nearer levels are its own.
SLAB_CLEARANCE = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """The cloud as supports are sought in it: thinned points (n, 3) in the level basis, bin of heights, the floor."""

    local: FloatArray
    bin: float
    floor: float | None = None
    floor_sigma: float = 0.0


@dataclass(frozen=True, slots=True)
class Level:
    """A level surface below an object: height along up and roughness, scene units."""

    height: float
    sigma: float


@dataclass(frozen=True, slots=True)
class Foot:
    """Where an object's foot is.

    bottom : height along up; sigma : of the log height, from this end; standing : on a level; filled : a gap to that
    level was filled; short : more of the object is surely below.
    """

    bottom: float
    sigma: float = 0.0
    standing: bool = False
    filled: bool = False
    short: bool = False


def ground_of(points: FloatArray, basis: FloatArray, planes: Sequence[SupportPlane]) -> Ground | None:
    """The ground of a cloud (n, 3), or None where it has no points."""
    local = one_per_cell(points) @ basis.T
    if not len(local):
        return None
    floor = floor_of(planes, points)
    if floor is None:
        return Ground(local, height_bin(local[:, 2]))
    return Ground(local, height_bin(local[:, 2]), floor.height, floor.sigma)


def level_below(
    ground: Ground, corners: FloatArray, low: FloatArray, high: FloatArray, stands: bool | None
) -> Level | None:
    """The highest surface around the foot of an object: at or below it, and seen on several sides; else the floor.

    corners : (4, 2) of the footprint in the level basis, in order around it; low, high : (3,) extents along length,
    width, up; stands : whether its category stands on the floor, None unknown.
    """
    bottom, height = float(low[2]), float(high[2] - low[2])
    highest = bottom + _contact(height, ground.bin)
    if _is_slab(low, high, stands):
        highest = bottom - SLAB_CLEARANCE * height
    middle = corners.mean(axis=0)
    sides = np.stack([corners[1] - corners[0], corners[3] - corners[0]])
    lengths = np.maximum(np.linalg.norm(sides, axis=1), np.finfo(float).tiny)
    ring = RING_SHARE * float(lengths.mean())
    near = np.flatnonzero(
        (np.abs(ground.local[:, :2] - middle) < np.linalg.norm(lengths) / 2 + ring).all(axis=1)
        & (ground.local[:, 2] < highest)
    )
    # (k, 2) distances beyond the sides of the rectangle
    along = (ground.local[near, :2] - middle) @ (sides / lengths[:, None]).T
    beyond = (np.abs(along) - lengths / 2).max(axis=1)
    around = (beyond > 0) & (beyond < ring)
    heights = ground.local[near[around], 2]
    sectors = np.floor(np.arctan2(along[around, 1], along[around, 0]) / (np.pi / 4)).astype(np.int64) + 4
    level = _ring_level(heights, sectors, highest, ground.bin)
    touching = level is not None and bottom - level.height <= _contact(height, ground.bin)
    # an object that stands on floors has no business on whatever else lies below it
    if level is not None and (touching or stands is not True or ground.floor is None):
        return level
    if ground.floor is not None and ground.floor < highest:
        return Level(ground.floor, ground.floor_sigma)
    return level


def foot_on(
    level: Level | None, low: FloatArray, high: FloatArray, roughness: float, stands: bool | None, reach: float
) -> Foot:
    """The foot of an object above a level.

    low, high : (3,) extents along length, width, up; roughness : of the cloud, scene units; stands : whether its
    category stands on the floor, None unknown; reach : how far its masks, or stray points of its
    own, go down to the level: 0 where they end with the extent, 1 where they end at it, NaN where none says.
    """
    bottom, height = float(low[2]), float(high[2] - low[2])
    slab = _is_slab(low, high, stands)
    if level is None:
        return Foot(bottom, short=slab)
    gap = bottom - level.height
    whole = float(high[2]) - level.height
    sigma = LEVEL_SIGMA_SHARE * level.sigma / max(whole, np.finfo(float).tiny)
    if gap <= _contact(height, roughness):
        return Foot(level.height, sigma, standing=True) if whole > height / 2 else Foot(bottom)
    if not _fills(gap, height, stands, reach):
        return Foot(bottom, short=slab)
    return Foot(level.height, float(np.hypot(sigma, FILLED_SIGMA * gap / whole)), standing=True, filled=True)


def _contact(height: float, roughness: float) -> float:
    """How far a foot may be off the level it stands on."""
    return max(CONTACT_SHARE * height, roughness)


def _is_slab(low: FloatArray, high: FloatArray, stands: bool | None) -> bool:
    """Whether a floor-standing object, from `low` (3,) to `high` (3,), is so flat that its legs are missing."""
    return stands is True and float(high[2] - low[2]) < SLAB_SHARE * float((high - low)[:2].min())


def _fills(gap: float, height: float, stands: bool | None, reach: float) -> bool:
    """Whether an object with such a gap under its points stands on what is below it."""
    if stands is not None:
        return stands and gap <= FLOOR_GAP_SHARE * height
    known = OBSERVED_GAP_SHARE if np.isfinite(reach) else GAP_SHARE
    return gap <= known * height or bool(reach > REACH_SHARE)


def _ring_level(heights: FloatArray, sectors: FloatArray, highest: float, bin_width: float) -> Level | None:
    """The highest level among points around an object, heights (n,), seen in several of the eight sectors (n,)."""
    if len(heights) < RING_POINTS:
        return None
    index = np.floor((highest - heights) / bin_width).astype(np.int64)
    bins = int(index.max()) + 2
    counts = np.bincount(index, minlength=bins)
    # two neighbouring bins, so that a level on their border is whole
    pairs = counts[:-1] + counts[1:]
    seen = np.zeros((bins, 8), dtype=bool)
    seen[index, sectors % 8] = True
    wide = (seen[:-1] | seen[1:]).sum(axis=1) >= RING_SECTORS
    # a wall has points at every height; a level stands out
    level = (pairs - WALL_TIMES * np.median(pairs)) * wide
    if level.max() < RING_POINTS:
        return None
    first = int(np.flatnonzero(level >= max(RING_POINTS, RING_LEVEL_SHARE * level.max()))[0])
    # the first bins of a thick level are its upper edge: go on to its peak
    while first + 1 < len(level) and level[first + 1] > level[first]:
        first += 1
    inside = heights[(index == first) | (index == first + 1)]
    return Level(float(np.median(inside)), robust_sigma(inside))
