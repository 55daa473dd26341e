"""Equivalent versions of a scene: other units, world frame or order, duplicated points or annotations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimator.records.scene import DenseCloud, Instance, Scene, View
from metric_base.arrays import FloatArray, IntArray

__all__ = ["annotated_twice", "moved_scene", "points_twice", "shuffled"]


def moved_scene(scene: Scene, factor: float, rotation: FloatArray, shift: FloatArray) -> Scene:
    """Return the scene in a world with other units, axes (3, 3) and origin (3,)."""

    def moved(view: View) -> View:
        rotated = view.rotation @ rotation.T
        return replace(view, rotation=rotated, translation=factor * view.translation - rotated @ (factor * shift))

    def moved_points(points: FloatArray) -> FloatArray:
        return np.asarray(factor * (points @ rotation.T + shift))

    dense = None if scene.dense is None else replace(scene.dense, points=moved_points(scene.dense.points))
    return replace(scene, views=tuple(map(moved, scene.views)), points=moved_points(scene.points), dense=dense)


def shuffled(scene: Scene, instances: tuple[Instance, ...], seed: int) -> tuple[Scene, tuple[Instance, ...]]:
    """Return the scene and its instances with permuted views, points, observations and annotations."""
    generator = np.random.default_rng(seed)
    views, points = (generator.permutation(len(rows)) for rows in (scene.views, scene.points))
    view_row, point_row = np.argsort(views), np.append(np.argsort(points), -1)

    def observed(view: View) -> View:
        order = generator.permutation(len(view.keypoints))
        return replace(view, keypoints=view.keypoints[order], point_index=point_row[view.point_index[order]])

    dense = None if scene.dense is None else _shuffled_cloud(scene.dense, view_row, generator)
    renamed = tuple(observed(scene.views[row]) for row in views)
    other = replace(scene, views=renamed, points=scene.points[points], dense=dense)
    order = generator.permutation(len(instances))
    return other, tuple(replace(instances[row], view=int(view_row[instances[row].view])) for row in order)


def _shuffled_cloud(dense: DenseCloud, view_row: IntArray, generator: np.random.Generator) -> DenseCloud:
    """Return the cloud with permuted points. view_row : (v,) new index of each view."""
    order = generator.permutation(len(dense.points))
    if dense.visible_offsets is None or dense.visible_views is None:
        return replace(dense, points=dense.points[order])
    starts, counts = dense.visible_offsets[:-1][order], np.diff(dense.visible_offsets)[order]
    offsets = np.concatenate([[0], np.cumsum(counts)])
    rows = np.repeat(starts - offsets[:-1], counts) + np.arange(offsets[-1])
    seen = view_row[dense.visible_views[rows]]
    return replace(dense, points=dense.points[order], visible_offsets=offsets, visible_views=seen)


def points_twice(scene: Scene) -> Scene:
    """Return the scene with all sparse points and their observations duplicated."""
    count = len(scene.points)

    def twice(view: View) -> View:
        index: IntArray = view.point_index
        second = np.where(index >= 0, index + count, -1)
        both = np.concatenate([view.keypoints, view.keypoints])
        return replace(view, keypoints=both, point_index=np.concatenate([index, second]))

    return replace(scene, views=tuple(map(twice, scene.views)), points=np.concatenate([scene.points, scene.points]))


def annotated_twice(instances: tuple[Instance, ...]) -> tuple[Instance, ...]:
    """Return the instances with all annotations duplicated."""
    return instances + tuple(replace(instance, id=f"{instance.id} again") for instance in instances)
