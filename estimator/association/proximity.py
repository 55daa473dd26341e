"""How far apart the points of two groups of masks lie, the distance D of the paper's Algorithm 1 (section 4.1)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from metric_base.arrays import FloatArray, IntArray

__all__ = ["MIN_PLACE_POINTS", "GroupPlaces", "NearbyGroups", "relative_distance"]

# The paper's threshold is a length in an unknown unit. Two views of one object leave gaps of a few point spacings
# between their clouds; two touching objects of one kind lie a whole width apart. The threshold is this share of the
# larger cloud's diagonal, and not under the spacing of the points themselves.
DISTANCE_SHARE = 0.15
# Clouds of one point have no size; whatever is nearer than this is in one place.
SAME_PLACE = 1e-9
# Distances between clouds are averages; a few hundred points give them to a few per cent.
MAX_DISTANCE_POINTS = 400
# Clouds of fewer points have a spacing as large as themselves, and lie anywhere.
MIN_PLACE_POINTS = 10
# Fewer points than this are in a place by chance.
MIN_LYING_POINTS = 3


@dataclass(slots=True, eq=False)
class GroupPlace:
    """Where a group lies: its thinned points (n, 3), their box (2, 3), and the count of all its points."""

    points: FloatArray
    box: FloatArray
    count: int
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
    """The places of groups of masks, each measured once; cloud : the points (n, 3) of a mask by its row."""

    cloud: Callable[[int], FloatArray]
    _known: dict[tuple[int, ...], GroupPlace] = field(default_factory=dict)

    def of(self, group: tuple[int, ...]) -> GroupPlace:
        """The place of the masks in `group`."""
        if group not in self._known:
            points = np.concatenate([self.cloud(member) for member in group])
            count = len(points)
            points = points[:: max(-(-count // MAX_DISTANCE_POINTS), 1)]
            box = np.array([points.min(axis=0), points.max(axis=0)]) if count else np.zeros((2, 3))
            self._known[group] = GroupPlace(points, box, count)
        return self._known[group]

    def forget(self, *groups: tuple[int, ...]) -> None:
        """Free the memory of groups that are no more."""
        for group in groups:
            self._known.pop(group, None)


class NearbyGroups:
    """Which of k groups may lie in one place, by their boxes and numbers of points; an empty group lies nowhere."""

    def __init__(self, places: GroupPlaces, groups: Sequence[tuple[int, ...]]) -> None:
        self._places = places
        self._boxes = np.zeros((len(groups), 2, 3))
        self._diagonals = np.zeros(len(groups))
        self._counts = np.zeros(len(groups), dtype=np.int64)
        for number, group in enumerate(groups):
            self.replace(number, group)

    def replace(self, number: int, group: tuple[int, ...]) -> None:
        """Another group in the place of group `number`."""
        self._counts[number] = 0
        if group:
            place = self._places.of(group)
            self._boxes[number], self._diagonals[number] = place.box, place.diagonal
            self._counts[number] = place.count

    def of(self, one: int) -> IntArray:
        """(k,) other groups whose boxes are within reach, of which one has the points to say where it is.

        The spacing of points is at most their box's diagonal, so that no pair is missed.
        """
        if self._counts[one] < MIN_LYING_POINTS:
            return np.empty(0, dtype=np.int64)
        known = np.maximum(self._counts, self._counts[one]) >= MIN_PLACE_POINTS
        may = known & (np.minimum(self._counts, self._counts[one]) >= MIN_LYING_POINTS)
        may[one] = False
        others = np.flatnonzero(may)
        low, high = self._boxes[others, 0], self._boxes[others, 1]
        apart = np.maximum(np.maximum(low - self._boxes[one, 1], self._boxes[one, 0] - high), 0)
        reach = np.maximum(np.maximum(self._diagonals[others], self._diagonals[one]), SAME_PLACE)
        return np.asarray(others[np.linalg.norm(apart, axis=1) <= reach])


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
