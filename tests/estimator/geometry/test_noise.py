"""Depth noise of a cloud, read in the pictures: right from thin to thick, nothing where nothing can be told."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.sparse import csr_array

from estimator.association.point_labels import dense_labels
from estimator.geometry.point_noise import depth_noise, view_direction_moment
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
