from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.association.mask_checks import mask_iou
from estimator.association.point_labels import sparse_labels
from estimator.instances.instance_reader import read_instances
from estimator.reconstructions.scene_reader import read_scene
from metric_base.arrays import FloatArray
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.knobs import HARD, Knobs, with_knobs
from tests.synthetic.rooms.quick import SyntheticScene, quick_scene
from tests.synthetic.rooms.scene_files import write_scene
from tests.synthetic.rooms.similarity import random_similarity, similarity_between
from tests.synthetic.rooms.street import street
from tests.synthetic.rooms.world import World


@given(st.integers(0, 2**32))
def test_alignment_of_transformed_points_recovers_the_similarity(seed: int) -> None:
    generator = np.random.default_rng(seed)
    points, change = generator.normal(size=(8, 3)), random_similarity(generator)
    estimate = similarity_between(points, change(points))
    assert estimate.scale == pytest.approx(change.scale, rel=1e-6)
    assert np.allclose(estimate.rotation, change.rotation, atol=1e-6)
    assert np.allclose(change.inverse(change(points)), points, atol=1e-6)


def test_points_project_close_to_their_observations(synthetic: SyntheticScene) -> None:
    for view in synthetic.scene.views:
        local = synthetic.scene.points[view.point_index] @ view.rotation.T + view.translation
        assert np.all(local[:, 2] > 0)
        pixels = view.camera.params[:2] * local[:, :2] / local[:, 2:] + view.camera.params[2:]
        # a depth noise of 0.4 % along its ray moves a point by about a pixel in another view; 1 % are stray points
        assert np.median(np.linalg.norm(pixels - view.keypoints, axis=1)) < 2


def test_true_scale_is_the_ratio_of_camera_distances(synthetic: SyntheticScene, room: World) -> None:
    true = np.array([pose.centre for pose in room.poses])
    centres = np.array([view.centre for view in synthetic.scene.views])
    ratio = np.linalg.norm(true[0] - true[-1]) / np.linalg.norm(centres[0] - centres[-1])
    assert synthetic.truth.metres_per_unit == pytest.approx(ratio, rel=1e-6)


def test_sparse_points_in_a_mask_are_inside_the_box_of_its_object(synthetic: SyntheticScene, room: World) -> None:
    labels = sparse_labels(synthetic.scene, synthetic.instances)
    true = np.array([pose.centre for pose in room.poses])
    to_world = similarity_between(np.array([view.centre for view in synthetic.scene.views]), true)
    items = {entry.track: entry for entry in room.objects}
    inside = []
    for row, instance in enumerate(synthetic.instances):
        rows = labels.membership[[row]].indices
        mesh = items[str(instance.track)].mesh.vertices
        low, high = mesh.min(axis=0) - 0.05, mesh.max(axis=0) + 0.05
        points = to_world(synthetic.scene.points[rows])
        inside += list(np.all((points > low) & (points < high), axis=1))
    assert np.mean(inside) > 0.95


def test_every_dense_point_is_visible_in_at_least_one_view(synthetic: SyntheticScene) -> None:
    cloud = synthetic.scene.dense
    assert cloud is not None
    assert cloud.visible_offsets is not None
    assert cloud.visible_views is not None
    assert len(cloud.visible_offsets) == len(cloud.points) + 1
    assert cloud.visible_offsets[-1] == len(cloud.visible_views)
    assert np.diff(cloud.visible_offsets).min() >= 1


@pytest.mark.slow
def test_objects_without_feet_have_fewer_points(room: World) -> None:
    footless = replace(room, objects=tuple(replace(entry, no_foot=True) for entry in room.objects))
    complete, reduced = (quick_scene(world, Knobs(stray=0.0, depth_noise=0.0), seed=1) for world in (room, footless))
    assert complete.scene.dense is not None
    assert reduced.scene.dense is not None
    assert len(reduced.scene.dense.points) < len(complete.scene.dense.points)


def test_moving_objects_have_fewer_points_per_pixel_than_static_ones() -> None:
    world = street(1002)
    synthetic = quick_scene(world, seed=2, dense_a_frame=0)
    moving = {entry.track for entry in world.objects if np.any(entry.velocity)}
    labels = sparse_labels(synthetic.scene, synthetic.instances)
    points, pixels = {True: 0, False: 0}, {True: 0, False: 0}
    for row, instance in enumerate(synthetic.instances):
        points[instance.track in moving] += len(labels.membership[[row]].indices)
        pixels[instance.track in moving] += int(instance.mask.sum())
    assert pixels[True] > 1000
    assert points[True] / pixels[True] < 0.5 * points[False] / pixels[False]


def test_written_scene_is_read_back_unchanged(synthetic: SyntheticScene, room: World, tmp_path: Path) -> None:
    write_scene(synthetic, room, tmp_path)
    again = read_scene(tmp_path)
    assert [view.name for view in again.views] == [view.name for view in synthetic.scene.views]
    assert np.allclose(again.points, synthetic.scene.points, rtol=1e-6, atol=1e-6)
    for view, original in zip(again.views, synthetic.scene.views, strict=True):
        assert np.allclose(view.rotation, original.rotation, atol=1e-9)
        assert np.array_equal(view.point_index, original.point_index)
    assert again.dense is not None
    assert synthetic.scene.dense is not None
    assert np.array_equal(again.dense.visible_views, synthetic.scene.dense.visible_views)
    instances = read_instances(None, again)
    assert [item.track for item in instances] == [item.track for item in synthetic.instances]
    assert all(np.array_equal(a.mask, b.mask) for a, b in zip(instances, synthetic.instances, strict=True))


def test_hard_room_has_points_below_the_floor_fewer_points_and_inexact_masks() -> None:
    knobs = with_knobs(HARD, objects=5, views=8)
    world = furnished_room("study", 1101, knobs)
    plain = quick_scene(world, with_knobs(knobs, smear=0, gloss=0, bare_faces=0, mask_error_px=0), dense_a_frame=800)
    hard = quick_scene(world, knobs, dense_a_frame=800)
    assert (heights(hard, world) < -0.05).mean() > (heights(plain, world) < -0.05).mean() + 0.005
    assert hard.scene.dense is not None
    assert plain.scene.dense is not None
    assert len(hard.scene.dense.points) < len(plain.scene.dense.points)
    exact = {mask.id: mask for mask in plain.instances}
    ious = [mask_iou(mask, exact[mask.id]) for mask in hard.instances if mask.id in exact]
    assert 0.5 < np.median(ious) < 0.99


def heights(synthetic: SyntheticScene, world: World) -> FloatArray:
    """Return the heights (n,) of the dense points above the floor in metres."""
    assert synthetic.scene.dense is not None
    true = np.array([pose.centre for pose in world.poses])
    to_world = similarity_between(np.array([view.centre for view in synthetic.scene.views]), true)
    return np.asarray(to_world(synthetic.scene.dense.points)[:, 2])
