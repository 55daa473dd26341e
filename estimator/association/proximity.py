"""How far apart the points of two groups of masks lie, the distance D of the paper's Algorithm 1 (section 4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from metric_base.arrays import FloatArray

__all__ = ["GroupPlaces", "relative_distance"]

# The paper's threshold is a length in an unknown unit. Two views of one object leave gaps of a few point spacings
# between their clouds; two touching objects of one kind lie a whole width apart. The threshold is this share of the
# larger cloud's diagonal, and not under the spacing of the points themselves.
DISTANCE_SHARE = 0.15
# Clouds of one point have no size; whatever is nearer than this is in one place.
SAME_PLACE = 1e-9
# Distances between clouds are averages; a few hundred points give them to a few per cent.
MAX_DISTANCE_POINTS = 400


@dataclass(slots=True, eq=False)
class GroupPlace:
    """Where a group lies: its thinned points (n, 3), and their box (2, 3)."""

    points: FloatArray
    box: FloatArray
    _spacing: float | None = None

    @property
    def diagonal(self) -> float:
        """Of the box."""
        return float(np.linalg.norm(self.box[1] - self.box[0]))

    @property
    def spacing(self) -> float:
        """Median distance of a point from its nearest neighbour, 0 for a lone one."""
        if self._spacing is None:
            squares = _squares(self.points, self.points)
            np.fill_diagonal(squares, np.inf)
            self._spacing = float(np.median(np.sqrt(squares.min(axis=1)))) if len(self.points) > 1 else 0.0
        return self._spacing


@dataclass(frozen=True, slots=True, eq=False)
class GroupPlaces:
    """The places of groups of masks, each made once from the masks' clouds."""

    clouds: Sequence[FloatArray]
    _known: dict[tuple[int, ...], GroupPlace] = field(default_factory=dict)

    def of(self, group: tuple[int, ...]) -> GroupPlace:
        """The place of the masks in `group`."""
        if group not in self._known:
            points = np.concatenate([self.clouds[member] for member in group])
            points = points[:: max(-(-len(points) // MAX_DISTANCE_POINTS), 1)]
            box = np.array([points.min(axis=0), points.max(axis=0)]) if len(points) else np.zeros((2, 3))
            self._known[group] = GroupPlace(points, box)
        return self._known[group]


def relative_distance(one: GroupPlace, two: GroupPlace) -> float:
    """D of two places as a multiple of the threshold; infinite where either is empty or their boxes are too far."""
    if not (len(one.points) and len(two.points)):
        return np.inf
    small, large = sorted((one, two), key=lambda place: len(place.points))
    reach = max(DISTANCE_SHARE * max(one.diagonal, two.diagonal), large.spacing, SAME_PLACE)
    apart = np.maximum(np.maximum(one.box[0] - two.box[1], two.box[0] - one.box[1]), 0)
    if float(np.linalg.norm(apart)) >= reach:
        return np.inf
    return float(np.sqrt(_squares(small.points, large.points).min(axis=1)).mean()) / reach


def _squares(one: FloatArray, two: FloatArray) -> FloatArray:
    """(a, b) squared distances of points (a, 3) and (b, 3): so few that importing a k-d tree would take longer."""
    return sum(((one[:, None, axis] - two[None, :, axis]) ** 2 for axis in range(3)), np.zeros((len(one), len(two))))
