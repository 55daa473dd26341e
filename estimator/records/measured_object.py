"""A measured object: what the geometry hands to the posterior, and what an `objects/1` file holds."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from metric_base.arrays import BoolArray, FloatArray, IntArray

__all__ = ["ETA_THRESHOLD", "Box", "MeasuredObject"]

#: The paper's threshold of a plausible dimension: a confidence eta of so much or more (section 4.2, example figure).
ETA_THRESHOLD = 0.7


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """An oriented box in the scene: centre (3,), axes (3, 3) with unit rows length, width, height; extents (3,)."""

    centre: FloatArray
    axes: FloatArray
    extents: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredObject:
    """One object in scene units.

    extents : (3,) length >= width (horizontal), height (vertical); NaN where missing. With `vertical_known` False they
    are the extents of a free box, longest first. sigma : (3,) one standard deviation of the measurement, natural
    log. covariance : (3, 3) of the log extents where their errors go together (all depend on one depth), its diagonal
    sigma squared; None where they are independent. confidence : (3,) the paper's eta (section 4.2); NaN where it does
    not apply. truncated : (3,) bool; the true extent is at least the measured one. cloud, point_rows : which cloud of
    the scene it was measured in, and its rows there; members : rows of the instances that show it. beyond : (3, 2) how
    far its masks go beyond its points at the low and the high end of each axis, as a share of the extent; NaN where no
    two views tell. unsupported_height : the height of the points alone, where `extents[2]` reaches down to a support
    plane.
    """

    id: str
    category: str
    extents: FloatArray
    sigma: FloatArray
    confidence: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    truncated: BoolArray = field(default_factory=lambda: np.zeros(3, dtype=bool))
    score: float = 1.0
    points: int = 0
    views: int = 0
    vertical_known: bool = True
    unsupported_height: float | None = None
    box: Box | None = None
    point_rows: IntArray | None = None
    cloud: str = ""
    members: tuple[int, ...] = ()
    beyond: FloatArray | None = None
    skipped: str | None = None
    notes: tuple[str, ...] = ()
    covariance: FloatArray | None = None
