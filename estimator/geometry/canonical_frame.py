"""The cameras' own frame: a scene is measured where neither its world axes nor the order of its lists matter.

Grids of cells, thinned clouds and ties depend on axes and on order. So the world is turned until up is z and the mean
gaze is ahead, its origin is put between the cameras, and views, points and masks are sorted by place; what is listed
twice counts once. A rotated, shuffled or doubled copy of a scene gives the same numbers but for rounding; what was
measured is turned back at the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.association.mask_checks import without_duplicates
from estimator.geometry.planes import level_basis
from estimator.geometry.vertical import camera_up
from estimator.records.objects import Box, SupportPlane, Up
from estimator.records.scene import DenseCloud, Instance, Scene, View
from metric_base.arrays import FloatArray, IntArray

# Most pairs of a view and a dense point that are looked at. A cloud that has more is thinned evenly, so that memory and
# time are bounded: 500 views look at 60,000 of two million points, and an object of a thousandth of the cloud keeps 60.
MAX_PAIRS = 30_000_000

# A mean gaze shorter than this, of unit gazes, has no direction worth the name: the cameras look all around.
MIN_GAZE = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class CanonicalFrame:
    """x_own = basis @ (x_world - origin); origin (3,), basis (3, 3) orthonormal rows."""

    origin: FloatArray
    basis: FloatArray

    def points(self, points: FloatArray) -> FloatArray:
        """(n, 3) world points in the own frame."""
        return np.asarray((points - self.origin) @ self.basis.T)

    def view(self, view: View, place: IntArray) -> View:
        """A view of the world as one of the own frame; `place` (n,) of each point, each of which it sees once."""
        rows, first = np.unique(place[view.point_index], return_index=True)
        return replace(
            view,
            rotation=view.rotation @ self.basis.T,
            translation=view.translation + view.rotation @ self.origin,
            keypoints=view.keypoints[first],
            point_index=rows,
        )

    def box_to_world(self, box: Box) -> Box:
        """A box of the own frame in the world."""
        return Box(box.centre @ self.basis + self.origin, box.axes @ self.basis, box.extents)

    def up_to_world(self, up: Up) -> Up:
        """The vertical in the world."""
        axis = None if up.reliable_axis is None else up.reliable_axis @ self.basis
        return replace(up, vector=up.vector @ self.basis, reliable_axis=axis)

    def plane_to_world(self, plane: SupportPlane) -> SupportPlane:
        """A support plane of the own frame in the world."""
        basis = plane.basis @ self.basis
        shift = basis @ self.origin
        return replace(plane, basis=basis, height=plane.height + float(shift[2]), origin=plane.origin + shift[:2])


@dataclass(frozen=True, slots=True, eq=False)
class NormalisedScene:
    """A scene in its own frame, with everything in an order that follows from its content.

    instances : the masks, at most one on an object in a view.
    """

    frame: CanonicalFrame
    scene: Scene
    instances: tuple[Instance, ...]
    point_rows: IntArray  #: (n,) index of each sparse point in the given scene.
    dense_rows: IntArray  #: (k,) index of each dense point in the given cloud.
    mask_rows: IntArray  #: (m,) index of each instance among the given ones.


def canonical_frame(views: Sequence[View]) -> CanonicalFrame:
    """The frame of the cameras: z up, x along the mean gaze, origin at the mean centre. ValueError without views."""
    basis = level_basis(camera_up(views).vector)
    centres = np.array([view.centre for view in views])
    origin = centres.mean(axis=0)
    gaze = np.mean([view.rotation[2] for view in views], axis=0) @ basis[:2].T
    if np.linalg.norm(gaze) < MIN_GAZE:
        # cameras all around: towards the side where the far ones are
        flat = (centres - origin) @ basis[:2].T
        gaze = (flat * (flat**2).sum(axis=1, keepdims=True)).mean(axis=0)
    length = float(np.linalg.norm(gaze))
    ahead = gaze @ basis[:2] / length if length > 0 else basis[0]
    return CanonicalFrame(origin, np.stack([ahead, np.cross(basis[2], ahead), basis[2]]))


def normalise_scene(scene: Scene, instances: Sequence[Instance], *, keep_views: bool = False) -> NormalisedScene:
    """The scene and its masks in their own frame and order; the views as they are with `keep_views`.

    A dense cloud of more than `MAX_PAIRS` pairs of a view and a point is thinned. ValueError for a scene without views.
    """
    frame = canonical_frame(scene.views)
    kept, view_rank = (np.arange(len(scene.views)),) * 2 if keep_views else _distinct_views(scene.views, frame)
    points = frame.points(scene.points)
    order, place = _distinct_points(points)
    views = tuple(frame.view(scene.views[k], place) for k in kept)
    dense, dense_order = None, np.empty(0, dtype=np.int64)
    if scene.dense is not None:
        cloud = frame.points(scene.dense.points)
        dense_order = _distinct_points(cloud)[0]
        dense_order = dense_order[:: max(1, -(-len(views) * len(dense_order) // MAX_PAIRS))]
        dense = _permute(scene.dense, cloud, dense_order, view_rank)
    rows = _instance_order(instances, view_rank)
    masks = [replace(instances[row], view=int(view_rank[instances[row].view])) for row in rows.tolist()]
    distinct = np.arange(len(masks)) if keep_views else without_duplicates(masks)
    return NormalisedScene(
        frame,
        replace(scene, views=views, points=points[order], dense=dense),
        tuple(masks[k] for k in distinct.tolist()),
        order,
        dense_order,
        rows[distinct],
    )


def _distinct_views(views: Sequence[View], frame: CanonicalFrame) -> tuple[IntArray, IntArray]:
    """(k,) rows of the views sorted by place, a view that is listed twice once; (v,) place of each view in them."""
    centres = frame.points(np.array([view.centre for view in views]))
    poses: dict[bytes, int] = {}
    kept: list[int] = []
    place = np.empty(len(views), dtype=np.int64)
    for row in np.lexsort(centres.T[::-1]).tolist():
        view = views[row]
        pose = view.rotation.tobytes() + view.translation.tobytes() + view.camera.params.tobytes()
        place[row] = poses.setdefault(pose, len(kept))
        if place[row] == len(kept):
            kept.append(row)
    return np.array(kept, dtype=np.int64), place


def _distinct_points(points: FloatArray) -> tuple[IntArray, IntArray]:
    """(k,) rows of the points (n, 3) by x, a point that is listed twice once; (n,) place of each point in them."""
    order = np.argsort(points[:, 0], kind="stable")
    ordered = points[order]
    fresh = np.ones(len(points), dtype=bool)
    fresh[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    place = np.empty(len(points), dtype=np.int64)
    place[order] = np.cumsum(fresh) - 1
    return order[fresh], place


def _instance_order(instances: Sequence[Instance], view_rank: IntArray) -> IntArray:
    """(m,) rows of the masks by view, place in the picture, size and name."""
    keys = [(int(view_rank[i.view]), *i.origin, *i.mask.shape, i.category, -i.score) for i in instances]
    return np.array(sorted(range(len(instances)), key=keys.__getitem__), dtype=np.int64)


def _permute(cloud: DenseCloud, points: FloatArray, order: IntArray, view_rank: IntArray) -> DenseCloud:
    """The cloud with its points (n, 3) in another frame and order (n,), seen by views of another order."""
    if cloud.visible_offsets is None or cloud.visible_views is None:
        return DenseCloud(points[order])
    lengths = np.diff(cloud.visible_offsets)[order]
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    entries = np.arange(offsets[-1]) + np.repeat(cloud.visible_offsets[order] - offsets[:-1], lengths)
    seen_by = view_rank[cloud.visible_views[entries]]
    if len(np.unique(view_rank)) == len(view_rank):
        return DenseCloud(points[order], offsets, seen_by)
    # views that were listed twice see a point once
    count = int(view_rank.max()) + 1
    pairs = np.unique(np.repeat(np.arange(len(order)), lengths) * count + seen_by)
    return DenseCloud(points[order], np.searchsorted(pairs, np.arange(len(order) + 1) * count), pairs % count)
