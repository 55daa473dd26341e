"""Reconstructions in which nothing has a size have names; whole ones have none, in any unit and frame."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from estimator.reconstructions.model_checks import degeneracy
from estimator.records.scene import DenseCloud
from tests.synthetic.shapes import box, floor, orbit, synthetic_scene


@pytest.fixture(scope="module")
def whole():
    objects = [floor(4), box("cabinet", (0.6, 0.4, 0.8), (0, 0, 0))]
    return synthetic_scene(objects, orbit(5, 2.5, 1.4, size=(80, 60), focal=60.0), dense=100, sparse=300).scene


def moved(scene, scale, turn, shift):
    """The same scene under x' = scale turn x + shift, without its dense cloud."""
    views = []
    for view in scene.views:
        rotation = view.rotation @ turn.T
        views.append(replace(view, rotation=rotation, translation=-rotation @ (scale * turn @ view.centre + shift)))
    return replace(scene, views=tuple(views), points=scale * scene.points @ turn.T + shift, dense=None)


def flattened(scene, axes):
    """The scene with its points on a line (one axis left) or in a plane (two)."""
    keep = np.zeros(3)
    keep[list(axes)] = 1
    return replace(scene, points=scene.points * keep, dense=None)


def in_one_place(scene):
    centre = scene.views[0].centre
    views = tuple(replace(view, translation=-view.rotation @ centre) for view in scene.views)
    return replace(scene, views=views, dense=None)


def without_points(scene):
    nothing = {"keypoints": np.empty((0, 2)), "point_index": np.empty(0, dtype=np.int64)}
    return replace(scene, points=np.empty((0, 3)), views=tuple(replace(v, **nothing) for v in scene.views), dense=None)


DAMAGE = {
    "no_views": lambda scene: replace(scene, views=()),
    "one_view": lambda scene: replace(scene, views=scene.views[:1]),
    "no_points": without_points,
    "coincident_points": lambda scene: flattened(scene, ()),
    "collinear_points": lambda scene: flattened(scene, (1,)),
    "coplanar_points": lambda scene: flattened(scene, (0, 2)),
    "coincident_cameras": in_one_place,
}


@pytest.mark.parametrize("code", DAMAGE)
@given(exponent=st.floats(-6, 6), seed=st.integers(0, 1000))
@settings(max_examples=8, deadline=None)
def test_every_degeneracy_has_its_name_in_any_unit_and_frame(whole, code, exponent, seed):
    turn = Rotation.random(random_state=seed).as_matrix()
    scale = 10**exponent
    damaged = moved(DAMAGE[code](whole), scale, turn, scale * np.array([3.0, -2.0, 1.0]))
    answer = degeneracy(damaged)
    assert answer is not None
    assert answer.is_fatal
    assert answer.message.startswith(f"{code}: ")


@given(exponent=st.floats(-6, 6), seed=st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_a_whole_scene_has_none_in_any_unit_and_frame(whole, exponent, seed):
    turn = Rotation.random(random_state=seed).as_matrix()
    scale = 10**exponent
    assert degeneracy(moved(whole, scale, turn, scale * np.array([3.0, -2.0, 1.0]))) is None


def test_one_stray_does_not_give_a_flat_scene_depth(whole):
    flat = flattened(whole, (0, 2)).points
    stray = np.vstack([flat, [[0.0, 900.0, 0.0]]])
    assert degeneracy(replace(whole, points=stray, dense=None)).message.startswith("coplanar_points")


def test_a_dense_cloud_has_points_too(whole):
    scene = replace(without_points(whole), dense=DenseCloud(whole.points))
    assert degeneracy(scene) is None


@pytest.mark.parametrize(("factor", "is_flat"), [(0.9e-4, True), (1.1e-4, False)])
def test_points_are_flat_below_a_thickness_of_a_ten_thousandth(whole, factor, is_flat):
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (2000, 3))
    points -= points.mean(axis=0)
    axes = np.linalg.svd(points, full_matrices=False)
    points = axes.U @ np.diag([1.0, 0.9, factor]) * 30
    assert (degeneracy(replace(without_points(whole), points=points)) is not None) == is_flat


@pytest.mark.parametrize(("baseline", "is_one_place"), [(0.9e-3, True), (1.1e-3, False)])
def test_cameras_are_at_one_place_below_a_thousandth_of_the_distance(whole, baseline, is_one_place):
    views = whole.views[:2]
    rng = np.random.default_rng(1)
    shell = rng.normal(size=(4000, 3))
    shell /= np.linalg.norm(shell, axis=1, keepdims=True)
    shell[::2] *= 0.98  # not a plane
    moved_views = tuple(
        replace(
            view,
            rotation=np.eye(3),
            translation=np.array([sign * baseline, 0.0, 0.0]),
            keypoints=np.empty((0, 2)),
            point_index=np.empty(0, np.int64),
        )
        for view, sign in zip(views, (-1, 1), strict=True)
    )
    scene = replace(whole, views=moved_views, points=shell * 1.01, dense=None)
    assert (degeneracy(scene) is not None) == is_one_place


@pytest.mark.parametrize(("distance", "is_flat"), [(9.0, False), (11.0, True)])
def test_points_beyond_ten_median_distances_are_outliers_of_the_shape(whole, distance, is_flat):
    angles = np.linspace(0, 2 * np.pi, 600, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.zeros(600), np.sin(angles)])  # all at the median distance
    points = np.vstack([circle, [[0.0, distance, 0.0]]])
    assert (degeneracy(replace(without_points(whole), points=points)) is not None) == is_flat


@pytest.mark.parametrize(("n_points", "is_few"), [(3, True), (4, False)])
def test_a_reconstruction_has_four_points(whole, n_points, is_few):
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])[:n_points]
    views = tuple(
        replace(view, point_index=np.empty(0, dtype=np.int64), keypoints=np.empty((0, 2))) for view in whole.views
    )
    problem = degeneracy(replace(whole, views=views, points=corners, dense=None))
    assert (problem is not None and "3 points, 4 needed" in problem.message) == is_few
