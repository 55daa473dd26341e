"""Depth noise of a cloud, estimated in the images: correct from thin to thick, none if it is undetermined."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.sparse import csr_array

from estimator.association.point_labels import dense_labels
from estimator.geometry.point_noise import depth_noise, keypoint_error, point_covariances, view_direction_moment
from estimator.projection.cameras import pixels_in_view
from estimator.records.scene import Scene
from tests.synthetic.shapes import box, floor, orbit, synthetic_scene


@cache
def noisy(share: float) -> Scene:
    objects = [floor(4.0), box("box", (1.0, 0.8, 0.9), (0, 0, 0)), box("box", (0.4, 0.3, 0.2), (1.2, 0.3, 0))]
    return synthetic_scene(objects, orbit(8, 3.5, 1.5), dense=6_000, noise=share).scene


@pytest.mark.parametrize("share", [0.005, 0.02, 0.03])
def test_noise_is_found_however_thick(share: float) -> None:
    scene = noisy(share)
    assert depth_noise(scene.views, dense_labels(scene, ())) == pytest.approx(share, rel=0.35)


def test_noise_does_not_depend_on_the_unit() -> None:
    scene = noisy(0.02)
    labels = dense_labels(scene, ())
    views = tuple(replace(view, translation=view.translation * 7) for view in scene.views)
    larger = replace(labels, points=labels.points * 7)
    assert depth_noise(views, larger) == pytest.approx(depth_noise(scene.views, labels))


def test_a_cloud_that_nobody_sees_tells_nothing() -> None:
    scene = noisy(0.02)
    labels = dense_labels(scene, ())
    unseen = replace(labels, visibility=csr_array((len(scene.views), len(labels.points)), dtype=np.float32))
    assert depth_noise(scene.views, unseen) == 0.0


def test_lines_of_sight_of_a_ring_of_views() -> None:
    views = orbit(12, 3.0, 1.0, target=(0, 0, 0))
    eyes = np.array([-view.rotation.T @ view.translation for view in views])
    distance, moment = view_direction_moment(eyes, np.zeros(3))
    assert distance == pytest.approx(np.hypot(3.0, 1.0))
    assert np.trace(moment) == pytest.approx(1.0)
    assert moment[0, 0] == pytest.approx(moment[1, 1])
    assert moment[2, 2] == pytest.approx(0.1)


@pytest.mark.parametrize(("offset_px", "error_px"), [(0.1, 0.5), (1.18, 1.0), (2.36, 2.0), (30.0, 3.0)])
def test_the_error_of_a_keypoint_is_half_a_pixel_to_three(offset_px: float, error_px: float) -> None:
    """The median distance of a Rayleigh distribution is 1.18 standard deviations."""
    scene = noisy(0.005)
    points = np.array([[0.0, 0.0, 0.5], [0.3, 0.1, 0.4]])
    views = [
        replace(view, keypoints=pixels_in_view(view, points)[0] + [offset_px, 0.0], point_index=np.arange(2))
        for view in scene.views
    ]
    assert keypoint_error(views, points) == pytest.approx(error_px, rel=1e-6)
    assert keypoint_error((), points) == 3.0


def test_rays_determine_a_point_across_them_and_its_distance_limits_it_along_them() -> None:
    """One view: s d / f across the ray, the distance d along it, and a minimum of 0.002 d; s is half a pixel."""
    view = noisy(0.005).views[0]
    points = np.array([[0.0, 0.0, 0.5], [9.0, 9.0, 9.0]])
    view = replace(view, keypoints=pixels_in_view(view, points[:1])[0], point_index=np.array([0]))
    seen, unseen = point_covariances([view], points)
    distance = float(np.linalg.norm(points[0] - view.centre))
    across = 1 / ((view.camera.focal_px / (0.5 * distance)) ** 2 + 1 / distance**2)
    expected = np.array([across, across, distance**2]) + (0.002 * distance) ** 2
    assert np.linalg.eigvalsh(seen) == pytest.approx(expected, rel=1e-6)
    assert unseen == pytest.approx(np.eye(3) * (1 + 0.002**2))


@pytest.mark.parametrize(("n_points", "is_known"), [(24 * 25, False), (24 * 40, True)])
def test_thirty_cells_of_24_points_determine_the_noise(n_points: int, is_known: bool) -> None:
    scene = noisy(0.02)
    view = replace(scene.views[0], rotation=np.eye(3), translation=np.zeros(3))
    points = np.random.default_rng(0).uniform([-1, -1, 2.9], [1, 1, 3.1], (n_points, 3))
    visibility = csr_array(np.ones((1, n_points), dtype=np.float32))
    few = replace(dense_labels(scene, ()), points=points, visibility=visibility)
    assert (depth_noise([view], few) > 0) == is_known
