"""A measured object: what the geometry hands to the posterior, and what an `objects/1` file holds.

Boxes of objects as lines: corners, edges by axis, and how they fall into a picture.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from estimator.records.scene import SceneProblem
from metric_base.arrays import BoolArray, FloatArray, IntArray

#: The paper's threshold of a plausible dimension: a confidence eta of so much or more (section 4.2, example figure).
ETA_THRESHOLD = 0.7
#: (8, 3) signs of the corners along length, width, height.
_SIGNS = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=np.float64)
#: (12, 2) pairs of corners that differ in one sign: four edges along each axis, in the order of the axes.
EDGES: IntArray = np.array(
    [(a, b) for axis in range(3) for a in range(8) for b in [a + (1, 2, 4)[axis]] if not a & (1, 2, 4)[axis]]
)


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


def corners(box: Box) -> FloatArray:
    """(8, 3) corners in the scene: centre + sum over the axes of +- extent / 2."""
    return np.asarray(box.centre + (_SIGNS * box.extents / 2) @ box.axes)


def edge_axis(edge: int) -> int:
    """Which axis (0 length, 1 width, 2 height) edge number `edge` runs along."""
    return edge // 4


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One object: indices of its instances, at most one per view, and the category with the largest sum of scores."""

    members: tuple[int, ...]
    category: str


@dataclass(frozen=True, slots=True, eq=False)
class SupportPlane:
    """A level surface: points with `basis[2] @ x` near `height`.

    basis : (3, 3) rows two horizontal axes and up; sigma : standard deviation of its points about it, scene units;
    cells : (a, b) bool map of where it was seen, cell (0, 0) starting at `origin` (2,) with side `cell`.
    """

    basis: FloatArray
    height: float
    sigma: float
    points: int
    origin: FloatArray
    cell: float
    cells: BoolArray

    def coverage(self, footprint: FloatArray) -> float:
        """Share of the horizontal points (n, 2) that lie on cells where the surface was seen."""
        index = np.floor((footprint - self.origin) / self.cell).astype(np.int64)
        inside = ((index >= 0) & (index < self.cells.shape)).all(axis=1)
        return float(self.cells[tuple(index[inside].T)].sum() / max(len(footprint), 1))


@dataclass(frozen=True, slots=True, eq=False)
class Up:
    """The vertical: `vector` (3,) unit, pointing up; `method` its name; `sigma_deg` one standard deviation of its tilt.

    `reliable_axis` (3,) is a horizontal direction that is accurate (the mean camera x axis) although the tilt about it
    is not; else None.
    """

    vector: FloatArray
    method: str
    sigma_deg: float
    reliable_axis: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Measurements:
    """Measured objects of a scene.

    Attributes
    ----------
    objects : tuple of MeasuredObject
        `objects[i]` belongs to `tracks[i]`.
    up : Up
    planes : tuple of SupportPlane
    tracks : tuple of Track
    timings : dict
        Seconds by stage.
    problems : tuple of SceneProblem
        Contradictions in the masks and in the vertical.
    """

    objects: tuple[MeasuredObject, ...]
    up: Up
    planes: tuple[SupportPlane, ...]
    tracks: tuple[Track, ...]
    timings: dict[str, float] = field(default_factory=dict)
    problems: tuple[SceneProblem, ...] = ()
