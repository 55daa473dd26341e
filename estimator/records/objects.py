"""Measured objects of a scene, with their boxes, tracks, vertical and support planes; format `objects/1`."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from estimator.records.scene import SceneProblem
from metric_base.arrays import BoolArray, FloatArray, IntArray

#: Minimum confidence eta of a plausible dimension in the paper (section 4.2, example figure).
ETA_THRESHOLD = 0.7
#: Note of an object whose extents are those of its outlines, because it has too few points.
BY_OUTLINES = "measured by its outlines"
#: (8, 3) signs of the corners along length, width and height.
_SIGNS = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=np.float64)
#: (12, 2) pairs of corners that differ in one sign: four edges along each axis, sorted by axis.
EDGES: IntArray = np.array(
    [(a, b) for axis in range(3) for a in range(8) for b in [a + (1, 2, 4)[axis]] if not a & (1, 2, 4)[axis]]
)


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """An oriented box in the scene."""

    centre: FloatArray  #: (3,)
    axes: FloatArray  #: (3, 3) unit rows: length, width, height.
    extents: FloatArray  #: (3,)


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredObject:
    """One object in scene units."""

    id: str
    category: str
    #: (3,) length >= width (horizontal), height (vertical), NaN if missing. Without a vertical, the sorted extents of a
    #: box of any orientation, largest first.
    extents: FloatArray
    sigma: FloatArray  #: (3,) standard deviation of the log extents.
    confidence: FloatArray = field(default_factory=lambda: np.full(3, np.nan))  #: (3,) eta of the paper, or NaN.
    #: (3,) the true extent is at least the measured one.
    truncated: BoolArray = field(default_factory=lambda: np.zeros(3, dtype=bool))
    score: float = 1.0
    points: int = 0
    views: int = 0  #: Number of views with a mask.
    vertical_known: bool = True
    unsupported_height: float | None = None  #: Height of the points, if `extents[2]` reaches down to a support plane.
    box: Box | None = None
    point_rows: IntArray | None = None  #: (k,) indices of its points in `cloud`.
    cloud: str = ""  #: "sparse" or "dense", the cloud in which it was measured.
    members: tuple[int, ...] = ()  #: Indices of its instances.
    skipped: str | None = None  #: Reason why it was not measured.
    notes: tuple[str, ...] = ()
    #: (3, 3) of the log extents if their errors are correlated (all depend on one depth); None if independent.
    covariance: FloatArray | None = None


def corners(box: Box) -> FloatArray:
    """Return the corners (8, 3) of a box in the scene: centre +- extent / 2 along each axis."""
    return np.asarray(box.centre + (_SIGNS * box.extents / 2) @ box.axes)


def edge_axis(edge: int) -> int:
    """Return the axis (0 length, 1 width, 2 height) of an edge, an index of `EDGES`."""
    return edge // 4


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """The instances of one object."""

    members: tuple[int, ...]  #: Indices of its instances, at most one per view.
    category: str  #: The category with the largest sum of scores.


@dataclass(frozen=True, slots=True, eq=False)
class SupportPlane:
    """A level surface: points x with `basis[2] @ x` near `height`."""

    basis: FloatArray  #: (3, 3) unit rows: two horizontal axes and up.
    height: float
    sigma: float  #: Standard deviation of its points, in scene units.
    points: int
    origin: FloatArray  #: (2,) horizontal coordinates at which cell (0, 0) begins.
    cell: float  #: Side of a cell, in scene units.
    cells: BoolArray  #: (a, b) cells with points of the surface.


@dataclass(frozen=True, slots=True, eq=False)
class Up:
    """The vertical of a scene."""

    vector: FloatArray  #: (3,) unit vector that points up.
    method: str
    sigma_deg: float  #: Standard deviation of its tilt.
    #: (3,) horizontal direction that is accurate (the mean camera x axis) if the tilt about it is not; else None.
    reliable_axis: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Measurements:
    """Measured objects of a scene."""

    objects: tuple[MeasuredObject, ...]  #: `objects[i]` belongs to `tracks[i]`.
    up: Up
    planes: tuple[SupportPlane, ...]
    tracks: tuple[Track, ...]
    timings: dict[str, float] = field(default_factory=dict)  #: Seconds of each stage.
    floor: SupportPlane | None = None  #: The one of `planes` that is the floor.
    problems: tuple[SceneProblem, ...] = ()  #: Contradictions in the masks and in the vertical, and missing planes.
