"""Normalise a scene so that results do not depend on its axes, the order of its lists, or duplicates.

Grids, downsampled clouds and ties depend on axes and order. The world is therefore rotated until up is z and the mean
viewing direction is x, and its origin is the mean camera centre. Views, points and masks are sorted by position, and
duplicates are removed. A rotated, shuffled or doubled copy of a scene gives the same results up to rounding. Measured
objects are transformed back (`measurement.to_world`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.association.mask_checks import without_duplicates
from estimator.geometry.planes import level_basis
from estimator.geometry.vertical import camera_up
from estimator.records.objects import Box, SupportPlane, Up
from estimator.records.scene import DenseCloud, Instance, Scene, View, camera_centres
from metric_base.arrays import FloatArray, IntArray

# Maximum number of pairs of a view and a dense point. A cloud with more is subsampled evenly, which limits memory and
# time: with 500 views, 60,000 of two million points are used, and 60 of an object with a thousandth of them.
MAX_PAIRS = 30_000_000
# Minimum length of the mean of unit viewing directions. It is shorter if the cameras look in all directions.
MIN_MEAN_DIRECTION = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class CanonicalFrame:
    """The frame x = basis @ (x_world - origin)."""

    origin: FloatArray  #: (3,)
    basis: FloatArray  #: (3, 3) orthonormal rows.

    def points(self, points: FloatArray) -> FloatArray:
        """Transform world points (n, 3) to this frame."""
        return np.asarray((points - self.origin) @ self.basis.T)

    def view(self, view: View, index: IntArray) -> View:
        """Transform a view to this frame; `index` (n,) is the new index of each point, observed once at most."""
        rows, first = np.unique(index[view.point_index], return_index=True)
        return replace(
            view,
            rotation=view.rotation @ self.basis.T,
            translation=view.translation + view.rotation @ self.origin,
            keypoints=view.keypoints[first],
            point_index=rows,
        )

    def box_to_world(self, box: Box) -> Box:
        """Transform a box of this frame to the world."""
        return Box(box.centre @ self.basis + self.origin, box.axes @ self.basis, box.extents)

    def up_to_world(self, up: Up) -> Up:
        """Transform a vertical of this frame to the world."""
        axis = None if up.reliable_axis is None else up.reliable_axis @ self.basis
        return replace(up, vector=up.vector @ self.basis, reliable_axis=axis)

    def plane_to_world(self, plane: SupportPlane) -> SupportPlane:
        """Transform a support plane of this frame to the world."""
        basis = plane.basis @ self.basis
        shift = basis @ self.origin
        return replace(plane, basis=basis, height=plane.height + float(shift[2]), origin=plane.origin + shift[:2])


@dataclass(frozen=True, slots=True, eq=False)
class NormalisedScene:
    """A scene in its canonical frame and order."""

    frame: CanonicalFrame
    scene: Scene
    instances: tuple[Instance, ...]  #: Without duplicate masks of an object in a view.
    point_rows: IntArray  #: (n,) index of each sparse point in the given scene.
    dense_rows: IntArray  #: (k,) index of each dense point in the given cloud.
    mask_rows: IntArray  #: (m,) index of each instance among the given ones.


def canonical_frame(views: Sequence[View]) -> CanonicalFrame:
    """Return the frame of the cameras: z up, x along the mean viewing direction, origin at the mean centre.

    Raises
    ------
    ValueError
        There are no views.
    """
    basis = level_basis(camera_up(views).vector)
    centres = camera_centres(views)
    origin = centres.mean(axis=0)
    direction = np.mean([view.rotation[2] for view in views], axis=0) @ basis[:2].T
    if np.linalg.norm(direction) < MIN_MEAN_DIRECTION:
        # The cameras look in all directions: use the side with the most distant ones.
        horizontal = (centres - origin) @ basis[:2].T
        direction = (horizontal * (horizontal**2).sum(axis=1, keepdims=True)).mean(axis=0)
    length = float(np.linalg.norm(direction))
    ahead = direction @ basis[:2] / length if length > 0 else basis[0]
    return CanonicalFrame(origin, np.stack([ahead, np.cross(basis[2], ahead), basis[2]]))


def normalise_scene(scene: Scene, instances: Sequence[Instance], *, keep_views: bool = False) -> NormalisedScene:
    """Transform a scene and its masks to the canonical frame and order, without duplicates.

    Parameters
    ----------
    scene : Scene
        A dense cloud with more than `MAX_PAIRS` pairs of a view and a point is subsampled.
    instances : sequence of Instance
    keep_views : bool, default False
        Keep the order of the views, and duplicate masks.

    Raises
    ------
    ValueError
        The scene has no views.
    """
    frame = canonical_frame(scene.views)
    view_order, view_rank = np.arange(len(scene.views)), np.arange(len(scene.views))
    if not keep_views:
        # Views without duplicates, sorted by position.
        centres = frame.points(camera_centres(scene.views))
        poses: dict[bytes, int] = {}
        distinct_views: list[int] = []
        for row in np.lexsort(centres.T[::-1]).tolist():
            view = scene.views[row]
            pose = view.rotation.tobytes() + view.translation.tobytes() + view.camera.params.tobytes()
            view_rank[row] = poses.setdefault(pose, len(distinct_views))
            if view_rank[row] == len(distinct_views):
                distinct_views.append(row)
        view_order = np.array(distinct_views, dtype=np.int64)
    points = frame.points(scene.points)
    order, index = _distinct_points(points)
    views = tuple(frame.view(scene.views[row], index) for row in view_order)
    dense, dense_order = None, np.empty(0, dtype=np.int64)
    if scene.dense is not None:
        cloud = frame.points(scene.dense.points)
        dense_order = _distinct_points(cloud)[0]
        dense_order = dense_order[:: max(1, -(-len(views) * len(dense_order) // MAX_PAIRS))]
        dense = _permute(scene.dense, cloud, dense_order, view_rank)
    # Masks are sorted by view, position in the image, size and category.
    keys = [(int(view_rank[i.view]), *i.origin, *i.mask.shape, i.category, -i.score) for i in instances]
    rows = np.array(sorted(range(len(instances)), key=keys.__getitem__), dtype=np.int64)
    masks = [replace(instances[row], view=int(view_rank[instances[row].view])) for row in rows.tolist()]
    distinct = np.arange(len(masks)) if keep_views else without_duplicates(masks)
    return NormalisedScene(
        frame,
        replace(scene, views=views, points=points[order], dense=dense),
        tuple(masks[row] for row in distinct.tolist()),
        order,
        dense_order,
        rows[distinct],
    )


def _distinct_points(points: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the indices (k,) of the points (n, 3) without duplicates, sorted by x, and the rank (n,) of each point."""
    order = np.argsort(points[:, 0], kind="stable")
    ordered = points[order]
    is_new = np.ones(len(points), dtype=bool)
    is_new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    rank = np.empty(len(points), dtype=np.int64)
    rank[order] = np.cumsum(is_new) - 1
    return order[is_new], rank


def _permute(cloud: DenseCloud, points: FloatArray, order: IntArray, view_rank: IntArray) -> DenseCloud:
    """Return a cloud with points (n, 3) of another frame, in the order (k,), and with other indices of views (v,)."""
    if cloud.visible_offsets is None or cloud.visible_views is None:
        return DenseCloud(points[order])
    lengths = np.diff(cloud.visible_offsets)[order]
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    entries = np.arange(offsets[-1]) + np.repeat(cloud.visible_offsets[order] - offsets[:-1], lengths)
    visible_views = view_rank[cloud.visible_views[entries]]
    if len(np.unique(view_rank)) == len(view_rank):
        return DenseCloud(points[order], offsets, visible_views)
    # Duplicate views see a point once.
    count = int(view_rank.max()) + 1
    pairs = np.unique(np.repeat(np.arange(len(order)), lengths) * count + visible_views)
    return DenseCloud(points[order], np.searchsorted(pairs, np.arange(len(order) + 1) * count), pairs % count)
