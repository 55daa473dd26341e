"""Points in the air are told from thin objects by who sees through them."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.projection.visibility import Visibility, project_unoccluded
from estimator.records.scene import Camera, View
from insertion.scene.point_cloud import ColouredPoints
from insertion.scene.stray_points import stray_points
from metric_base.arrays import FloatArray

CAMERA = Camera("PINHOLE", 640, 480, np.array([500.0, 500.0, 320.0, 240.0]))


def _view(x: float) -> View:
    """A camera at (x, 0, 0) that looks along +z."""
    return View(f"{x}.png", CAMERA, np.eye(3), np.array([-x, 0.0, 0.0]), np.empty((0, 2)), np.empty(0, np.int64))


def _grid(width: float, depth: float, step: float) -> FloatArray:
    x, y = np.meshgrid(np.arange(-width, width, step), np.arange(-width, width, step))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, depth)])


@pytest.mark.parametrize("width", [0.06, 0.3])
def test_a_cluster_in_the_air_goes_and_a_post_stays(width: float) -> None:
    generator = np.random.default_rng(0)
    wall = _grid(2.0, 4.0, 0.02)
    post = _grid(width, 2.0, 0.01) + np.array([0.6, 0.0, 0.0])  # a real object, seen by all
    cluster = generator.normal(0, 0.02, (30, 3)) + np.array([-0.5, 0.1, 2.2])  # one view's mistake
    points = np.concatenate([wall, post, cluster])
    views = [_view(x) for x in (-0.4, -0.2, 0.0, 0.2, 0.4)]
    seen_by = []
    for number, view in enumerate(views):
        # where a ray to each point passes the post's plane
        at = view.centre + (points - view.centre) * (2.0 / points[:, 2:])
        hidden = (points[:, 2] > 3.0) & (np.abs(at[:, 0] - 0.6) < width) & (np.abs(at[:, 1]) < width)
        known = ~hidden
        known[len(wall) + len(post) :] = number == 0
        seen_by.append(np.flatnonzero(known))
    stray = stray_points(points, views, seen_by)
    assert stray[-len(cluster) :].mean() > 0.95
    assert stray[len(wall) : -len(cluster)].mean() < 0.1  # cells at its edges show both
    assert not stray[: len(wall)].any()
    # the remaining lists of the views refer to the same points
    known = Visibility(tuple(seen_by), np.array([view.centre for view in views]), np.tile([0.0, 0, 1], (5, 1)), True)
    cloud = ColouredPoints(points, np.zeros((len(points), 3), np.float32), True, visibility=known)
    left = cloud.subset(~stray)
    assert left.visibility is not None
    assert len(left.points) == np.count_nonzero(~stray)
    for before, after in zip(seen_by, left.visibility.rows, strict=True):
        assert np.array_equal(points[before[~stray[before]]], left.points[after])


@pytest.mark.parametrize(("ratio", "is_seen"), [(1.028, True), (1.032, False)])
def test_a_point_is_seen_within_three_percent_of_the_nearest_of_its_cell(ratio: float, is_seen: bool) -> None:
    """DEPTH_TOLERANCE, without a slant; of two points on one line of sight."""
    camera = Camera("PINHOLE", 640, 480, np.array([600.0, 600.0, 320.0, 240.0]))
    view = View("a", camera, np.eye(3), np.zeros(3), np.empty((0, 2)), np.empty(0, dtype=np.int64))
    points = np.array([[0.0, 0, 2], [0, 0, 2 * ratio]])
    assert project_unoccluded(view, points).rows.tolist() == ([0, 1] if is_seen else [0])
