"""Lists by point turn round to lists by view, in the numbers of the cloud that they are lists of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from estimator.projection.visibility import Visibility, points_by_view, scene_visibility
from estimator.records.scene import Camera, DenseCloud, Scene, View

CAMERA = Camera("PINHOLE", 64, 48, np.array([50.0, 50.0, 32.0, 24.0]))


def _view(rows: list[int], x: float = 0.0) -> View:
    pose = np.array([-x, 0.0, 0.0])
    return View(f"{x}.png", CAMERA, np.eye(3), pose, np.zeros((len(rows), 2)), np.array(rows, np.int64))


def _cloud(seen_by: list[set[int]]) -> DenseCloud:
    offsets = np.cumsum([0, *map(len, seen_by)])
    views = np.array([view for views in seen_by for view in sorted(views)], np.int64)
    return DenseCloud(np.zeros((len(seen_by), 3)), offsets, views)


@given(st.lists(st.sets(st.integers(0, 3)), max_size=12), st.integers(1, 3))
def test_a_view_lists_the_points_that_list_the_view(seen_by: list[set[int]], step: int) -> None:
    rows = points_by_view(_cloud(seen_by), 4, step)
    assert rows is not None
    expected = [[k for k, views in enumerate(seen_by[::step]) if view in views] for view in range(4)]
    assert [own.tolist() for own in rows] == expected


def test_dense_rows_stand_after_the_sparse_ones() -> None:
    scene = Scene(Path("s"), "memory", (_view([0, 2]), _view([1])), np.zeros((3, 3)), _cloud([{0}, {1}, {0, 1}, {0}]))
    known = scene_visibility(scene, step=2)
    assert known is not None
    assert known.complete
    assert [own.tolist() for own in known.rows] == [[0, 2, 3, 4], [1, 4]]
    assert scene_visibility(replace(scene, dense=DenseCloud(np.zeros((4, 3))))) is None
    sparse = scene_visibility(replace(scene, dense=None))
    assert sparse is not None
    assert not sparse.complete
    assert scene_visibility(replace(scene, dense=None, views=(_view([0]), _view([])))) is None


def test_points_that_go_are_counted_out_of_the_lists() -> None:
    known = Visibility((np.array([0, 1, 3]), np.array([1, 2, 4])), np.zeros((2, 3)), np.zeros((2, 3)), complete=True)
    left = known.of_points(np.array([True, False, True, True, True]))
    assert [own.tolist() for own in left.rows] == [[0, 2], [1, 3]]
