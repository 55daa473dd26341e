"""What an object stands on: where its foot is not reconstructed it reaches down to the plane below it (methods.md).

Legs are thin, castors dark and sills low, so clouds end above the foot and heights come out short. A plane right below a small
gap is the likely foot; a large gap is filled only for things that stand on floors, and never for things that hang.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.planes import SupportPlane
from estimator.scene import FloatArray

__all__ = ["Foot", "foot_on"]

# A foot within this share of the height of its plane, or within twice the plane's own spread, stands on it: the extent rule is not
# surer than that.
CONTACT_SHARE = 0.06
CONTACT_SIGMAS = 2.0
# Points of the plane itself fall in masks, so a foot may seem to lie this share of the height below it.
SUNK_SHARE = 0.2
# A gap up to this share of the points' height is filled where nothing is known of the category: legs of cabinets and bags of
# shopping; things on a wall hang a whole height or more above what is below them.
GAP_SHARE = 0.35
# ... and this where the mask is cut at the foot, so that more of the thing is known to be there.
CUT_GAP_SHARE = 1.0
# A desk of which only the top is seen is a tenth to a sixth of its height; a gap of more is another thing.
FLOOR_GAP_SHARE = 12.0
# Share of the footprint over which a plane must have been seen to be below the object; the floor is hidden by what stands on it.
COVERAGE = 0.4
# What filling a gap adds to the log height's standard deviation, per share of the height that was filled: feet end a little
# above or below the plane, and sometimes it is the wrong one.
FILLED_SIGMA = 0.05
# A floor-standing thing flatter than this without a floor is a table top without legs.
SLAB_SHARE = 0.35


@dataclass(frozen=True, slots=True)
class Foot:
    """Where an object's foot is: height along up, added log sigma, whether a gap was filled, whether more is surely below."""

    bottom: float
    sigma: float = 0.0
    filled: bool = False
    short: bool = False
    plane: int | None = None


def foot_on(
    planes: Sequence[SupportPlane], footprint: FloatArray, low: FloatArray, high: FloatArray, stands: bool | None, cut: bool
) -> Foot:
    """The foot of an object with corners (4, 2) of its footprint in the planes' horizontal axes.

    low, high : (3,) extents along length, width, up; stands : whether its category stands on the floor, None unknown; cut :
    whether its masks are cut at the foot.
    """
    bottom, height = float(low[2]), float(high[2] - low[2])
    slab = stands is True and height < SLAB_SHARE * float((high - low)[:2].min())
    number = _plane_below(planes, footprint, bottom, height)
    if number is None:
        return Foot(bottom, short=slab)
    plane = planes[number]
    gap = bottom - plane.height
    reach = _reach(height, stands, cut)
    if gap <= max(CONTACT_SHARE * height, CONTACT_SIGMAS * plane.sigma):
        if plane.height < high[2] - height / 2:
            return Foot(plane.height, sigma=plane.sigma / height, plane=number)
        return Foot(bottom)
    if gap > reach:
        return Foot(bottom, short=slab)
    whole = float(high[2]) - plane.height
    sigma = np.hypot(plane.sigma / whole, FILLED_SIGMA * gap / whole)
    return Foot(plane.height, float(sigma), filled=True, plane=number)


def _reach(height: float, stands: bool | None, cut: bool) -> float:
    """Largest gap that is filled."""
    if stands is None:
        return height * (CUT_GAP_SHARE if cut else GAP_SHARE)
    return height * FLOOR_GAP_SHARE if stands else 0.0


def _plane_below(planes: Sequence[SupportPlane], footprint: FloatArray, bottom: float, height: float) -> int | None:
    """The highest plane below a foot: seen under the footprint, or the lowest of all, which goes on under everything."""
    samples = _samples(footprint)
    for number in reversed(range(len(planes))):
        plane = planes[number]
        if plane.height > bottom + SUNK_SHARE * height:
            continue
        if number == 0 or plane.coverage(samples) >= COVERAGE:
            return number
    return None


def _samples(corners: FloatArray) -> FloatArray:
    """(25, 2) points spread over the rectangle with corners (4, 2) in order around it."""
    one, two = np.meshgrid(np.linspace(0.1, 0.9, 5), np.linspace(0.1, 0.9, 5))
    along, across = corners[1] - corners[0], corners[3] - corners[0]
    return np.asarray(corners[0] + one.reshape(-1, 1) * along + two.reshape(-1, 1) * across)
