"""The cloud with colours: the mean linear colour of each point over the stills that see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.projection.visibility import Visibility, project_unoccluded, scene_visibility
from estimator.records.scene import Scene, View
from insertion.colour import srgb_to_linear
from insertion.footage.footage import Stills
from insertion.scene.stray_points import stray_points
from metric_base.arrays import BoolArray, FloatArray, IntArray

#: More dense points than this add time and no light.
MAX_POINTS = 150_000
#: Stills that colour the cloud.
MAX_STILLS = 40
#: Views that are asked whether they see through a point.
STRAY_VIEWS = 16


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """The points of a scene.

    points : (n, 3) in the scene; colours : (n, 3) linear, NaN where no still shows the point; dense : whether a dense
    cloud is among them; visibility : which of them each view of the scene is known to see, or None.
    """

    points: FloatArray
    colours: NDArray[np.float32]
    dense: bool
    visibility: Visibility | None = None

    def subset(self, kept: BoolArray) -> Cloud:
        """The points that are kept, (n,)."""
        known = None if self.visibility is None else self.visibility.of_points(kept)
        return Cloud(self.points[kept], self.colours[kept], self.dense, known)


@dataclass(frozen=True, slots=True, eq=False)
class FrontPoints:
    """The points that one view sees.

    rows : (m,) of the cloud; pixels : (m, 2); depths : (m,) scene units; dense : as the cloud's; observed : (m,)
    whether each was seen by the scene's view that is most like this one, None where all count alike. Sparse points
    are too few to hide one another: the others may shine through what stands before them.
    """

    rows: IntArray
    pixels: FloatArray
    depths: FloatArray
    dense: bool
    observed: BoolArray | None = None

    def inside(self, x0: int, y0: int, x1: int, y1: int) -> FrontPoints:
        """Those within a box of pixels, the ends not included."""
        return self.kept(self._within(x0, y0, x1, y1))

    def kept(self, which: BoolArray) -> FrontPoints:
        """Those of which `which` (m,) says so."""
        observed = None if self.observed is None else self.observed[which]
        return FrontPoints(self.rows[which], self.pixels[which], self.depths[which], self.dense, observed)

    def seen_points(self) -> FrontPoints:
        """Those that the view is known to see, all where nothing is known: sparse points show what is behind others."""
        return self if self.observed is None else self.kept(self.observed)

    def marks_inside(self, marks: BoolArray, x0: int, y0: int, x1: int, y1: int) -> BoolArray:
        """The marks (m,) of the points that `inside` keeps."""
        return marks[self._within(x0, y0, x1, y1)]

    def _within(self, x0: int, y0: int, x1: int, y1: int) -> BoolArray:
        """(n,) whether each point's pixel is in the box."""
        return np.asarray(np.all((self.pixels >= [x0, y0]) & (self.pixels < [x1, y1]), axis=1))


def front_points(view: View, cloud: Cloud, row: int | None = None) -> FrontPoints:
    """The points of the cloud that a view sees and no other point hides.

    row : of the view in the scene, if it is one of the scene's: then its own visibility decides, where it is known.
    """
    known = cloud.visibility
    if row is not None and known is not None and known.complete:
        listed = known.rows[row]
        sight = project_unoccluded(view, cloud.points[listed])
        return FrontPoints(listed[sight.rows], sight.pixels, sight.depths, cloud.dense)
    sight = project_unoccluded(view, cloud.points)
    observed = None if known is None or known.complete else np.isin(sight.rows, known.nearest(view))
    return FrontPoints(sight.rows, sight.pixels, sight.depths, cloud.dense, observed)


def coloured_cloud(scene: Scene, stills: Stills) -> Cloud:
    """Sparse and dense points of the scene with their colours."""
    points, step = scene.points, 1
    if scene.dense is not None:
        step = max(1, -(-len(scene.dense.points) // MAX_POINTS))
        points = np.concatenate([points, scene.dense.points[::step]])
    total = np.zeros((len(points), 3))
    count = np.zeros(len(points))
    for row in even_rows(stills.rows, MAX_STILLS):
        sight = project_unoccluded(scene.views[row], points)
        at, seen = sight.pixels.astype(np.int64), sight.rows
        total[seen] += srgb_to_linear(stills.picture(row)[at[:, 1], at[:, 0]])
        count[seen] += 1
    with np.errstate(invalid="ignore"):
        colours = np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], np.nan)
    dense = scene.dense is not None
    return _without_strays(Cloud(points, colours.astype(np.float32), dense, scene_visibility(scene, step)), scene)


def _without_strays(cloud: Cloud, scene: Scene) -> Cloud:
    """The cloud without the points that views see through, where it is known all that each view sees."""
    known = cloud.visibility
    if known is None or not known.complete:
        return cloud
    asked = even_rows(tuple(range(len(scene.views))), STRAY_VIEWS)
    return cloud.subset(~stray_points(cloud.points, [scene.views[k] for k in asked], [known.rows[k] for k in asked]))


def even_rows(rows: tuple[int, ...], most: int) -> list[int]:
    """At most `most` of the rows, evenly spread."""
    chosen = np.unique(np.linspace(0, len(rows) - 1, min(len(rows), most)).round().astype(np.int64))
    return [rows[k] for k in chosen]
