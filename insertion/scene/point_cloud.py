"""Points of a scene with the mean linear colour of the images that show them, and the points visible in a view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.projection.visibility import Visibility, project_unoccluded, scene_visibility
from estimator.records.scene import Scene, View
from insertion.colour import srgb_to_linear
from insertion.footage.footage import SceneImages
from insertion.scene.pixel_box import PixelBox
from insertion.scene.stray_points import stray_points
from metric_base.arrays import BoolArray, FloatArray, IntArray

#: Maximum number of dense points. More points cost time and do not change the light.
MAX_POINTS = 150_000
#: Maximum number of images that colour the points.
MAX_IMAGES = 40
#: Maximum number of views that vote on stray points.
MAX_STRAY_VOTING_VIEWS = 16


@dataclass(frozen=True, slots=True, eq=False)
class ColouredPoints:
    """The points of a scene."""

    points: FloatArray  #: (n, 3) in the scene
    colours: NDArray[np.float32]  #: (n, 3) linear; NaN if no image shows the point
    dense: bool  #: the points include a dense cloud
    visibility: Visibility | None = None  #: points that each view of the scene observes, if recorded

    def subset(self, keep: BoolArray) -> ColouredPoints:
        """Return the points that are selected by `keep` (n,)."""
        known = None if self.visibility is None else self.visibility.of_points(keep)
        return ColouredPoints(self.points[keep], self.colours[keep], self.dense, known)


@dataclass(frozen=True, slots=True, eq=False)
class VisiblePoints:
    """Points of a cloud that are visible in one view.

    Sparse points are too few to occlude one another: those that are not `observed` may be behind a surface.
    """

    rows: IntArray  #: (m,) indices in the cloud
    pixels: FloatArray  #: (m, 2)
    depths: FloatArray  #: (m,) scene units
    dense: bool  #: as that of the cloud
    #: (m,) points observed by the view of the scene that is most similar to this one; None if all points are reliable
    observed: BoolArray | None = None

    def subset(self, keep: BoolArray) -> VisiblePoints:
        """Return the points that are selected by `keep` (m,)."""
        observed = None if self.observed is None else self.observed[keep]
        return VisiblePoints(self.rows[keep], self.pixels[keep], self.depths[keep], self.dense, observed)

    def in_box(self, box: PixelBox) -> BoolArray:
        """Return which points (m,) are in a box of pixels."""
        inside = (self.pixels >= [box.x0, box.y0]) & (self.pixels < [box.x1, box.y1])
        return np.asarray(np.all(inside, axis=1))

    def observed_points(self) -> VisiblePoints:
        """Return the points that the view is known to observe; all if that is not known."""
        return self if self.observed is None else self.subset(self.observed)


def visible_points(view: View, cloud: ColouredPoints, row: int | None = None) -> VisiblePoints:
    """Return the points of a cloud that are visible in a view.

    Parameters
    ----------
    view : View
        Camera and pose.
    cloud : ColouredPoints
        Points of the scene.
    row : int, optional
        Index of the view in the scene. The recorded visibility of this view is used if it is complete.
    """
    known = cloud.visibility
    if row is not None and known is not None and known.complete:
        listed = known.rows[row]
        sight = project_unoccluded(view, cloud.points[listed])
        return VisiblePoints(listed[sight.rows], sight.pixels, sight.depths, cloud.dense)
    sight = project_unoccluded(view, cloud.points)
    observed = None if known is None or known.complete else np.isin(sight.rows, known.nearest(view))
    return VisiblePoints(sight.rows, sight.pixels, sight.depths, cloud.dense, observed)


def coloured_cloud(scene: Scene, images: SceneImages) -> ColouredPoints:
    """Return the sparse and dense points of a scene with their colours, without stray points."""
    points, step = scene.points, 1
    if scene.dense is not None:
        step = max(1, -(-len(scene.dense.points) // MAX_POINTS))
        points = np.concatenate([points, scene.dense.points[::step]])
    total = np.zeros((len(points), 3))
    count = np.zeros(len(points))
    for row in evenly_spaced(images.rows, MAX_IMAGES):
        sight = project_unoccluded(scene.views[row], points)
        columns, rows = sight.pixels.astype(np.int64).T
        total[sight.rows] += srgb_to_linear(images.image(row)[rows, columns])
        count[sight.rows] += 1
    with np.errstate(invalid="ignore"):
        colours = np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], np.nan)
    known = scene_visibility(scene, step)
    cloud = ColouredPoints(points, colours.astype(np.float32), scene.dense is not None, known)
    if known is None or not known.complete:
        return cloud
    voting = evenly_spaced(tuple(range(len(scene.views))), MAX_STRAY_VOTING_VIEWS)
    return cloud.subset(~stray_points(points, [scene.views[k] for k in voting], [known.rows[k] for k in voting]))


def evenly_spaced(rows: tuple[int, ...], max_count: int) -> list[int]:
    """Return at most `max_count` of the rows, evenly spaced."""
    chosen = np.unique(np.linspace(0, len(rows) - 1, min(len(rows), max_count)).round().astype(np.int64))
    return [rows[k] for k in chosen]
