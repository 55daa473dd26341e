from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.association.mask_checks import mask_iou as overlap
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
def test_alignment_finds_the_similarity(seed: int) -> None:
    generator = np.random.default_rng(seed)
    points, change = generator.normal(size=(8, 3)), random_similarity(generator)
    found = similarity_between(points, change(points))
    assert found.scale == pytest.approx(change.scale, rel=1e-6)
    assert np.allclose(found.rotation, change.rotation, atol=1e-6)
    assert np.allclose(change.inverse(change(points)), points, atol=1e-6)


def test_observations_project_where_they_were_seen(synthetic: SyntheticScene) -> None:
    for view in synthetic.scene.views:
        local = synthetic.scene.points[view.point_index] @ view.rotation.T + view.translation
        assert np.all(local[:, 2] > 0)
        pixels = view.camera.params[:2] * local[:, :2] / local[:, 2:] + view.camera.params[2:]
        # depth noise of 0.4 % along the point's own ray moves it by a pixel or so in another view; one in a hundred
        # is a stray
        assert np.median(np.linalg.norm(pixels - view.keypoints, axis=1)) < 2


def test_the_truth_is_the_scenes_scale(synthetic: SyntheticScene, room: World) -> None:
    true = np.array([pose.centre for pose in room.poses])
    here = np.array([view.centre for view in synthetic.scene.views])
    ratio = np.linalg.norm(true[0] - true[-1]) / np.linalg.norm(here[0] - here[-1])
    assert synthetic.truth.metres_per_unit == pytest.approx(ratio, rel=1e-6)


def test_points_of_a_mask_lie_in_their_objects_box(synthetic: SyntheticScene, room: World) -> None:
    """Sparse points, labelled by their own observations and carried back to metres, lie on what the masks name."""
    labels = sparse_labels(synthetic.scene, synthetic.instances)
    true = np.array([pose.centre for pose in room.poses])
    back = similarity_between(np.array([view.centre for view in synthetic.scene.views]), true)
    items = {entry.track: entry for entry in room.objects}
    inside = []
    for row, instance in enumerate(synthetic.instances):
        rows = labels.membership[[row]].indices
        mesh = items[str(instance.track)].mesh.vertices
        low, high = mesh.min(axis=0) - 0.05, mesh.max(axis=0) + 0.05
        points = back(synthetic.scene.points[rows])
        inside += list(np.all((points > low) & (points < high), axis=1))
    assert np.mean(inside) > 0.95


def test_dense_points_are_seen_by_the_views_that_their_visibility_names(synthetic: SyntheticScene) -> None:
    cloud = synthetic.scene.dense
    assert cloud is not None
    assert cloud.visible_offsets is not None
    assert cloud.visible_views is not None
    assert len(cloud.visible_offsets) == len(cloud.points) + 1
    assert cloud.visible_offsets[-1] == len(cloud.visible_views)
    assert np.diff(cloud.visible_offsets).min() >= 1


@pytest.mark.slow
def test_feet_that_leave_no_points(room: World) -> None:
    from dataclasses import replace

    bare = replace(room, objects=tuple(replace(entry, no_foot=True) for entry in room.objects))
    whole, cut = (quick_scene(world, Knobs(stray=0.0, depth_noise=0.0), seed=1) for world in (room, bare))
    assert whole.scene.dense is not None
    assert cut.scene.dense is not None
    assert len(cut.scene.dense.points) < len(whole.scene.dense.points)


def test_oncoming_cars_leave_fewer_points_than_parked_ones() -> None:
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


def test_files_read_back_as_the_scene_that_was_written(synthetic: SyntheticScene, room: World, tmp_path: Path) -> None:
    write_scene(synthetic, room, tmp_path)
    again = read_scene(tmp_path)
    assert [view.name for view in again.views] == [view.name for view in synthetic.scene.views]
    assert np.allclose(again.points, synthetic.scene.points, rtol=1e-6, atol=1e-6)
    for one, other in zip(again.views, synthetic.scene.views, strict=True):
        assert np.allclose(one.rotation, other.rotation, atol=1e-9)
        assert np.array_equal(one.point_index, other.point_index)
    assert again.dense is not None
    assert synthetic.scene.dense is not None
    assert np.array_equal(again.dense.visible_views, synthetic.scene.dense.visible_views)
    found = read_instances(None, again)
    assert [item.track for item in found] == [item.track for item in synthetic.instances]
    assert all(np.array_equal(a.mask, b.mask) for a, b in zip(found, synthetic.instances, strict=True))


def test_hard_rooms_have_the_errors_of_real_ones() -> None:
    """Points between surfaces, below the floor and fewer on bare faces; masks that are off at the border."""
    knobs = with_knobs(HARD, objects=5, views=8)
    world = furnished_room("study", 1101, knobs)
    plain = quick_scene(world, with_knobs(knobs, smear=0, gloss=0, bare_faces=0, mask_error_px=0), dense_a_frame=800)
    hard = quick_scene(world, knobs, dense_a_frame=800)
    assert (heights(hard, world) < -0.05).mean() > (heights(plain, world) < -0.05).mean() + 0.005
    assert hard.scene.dense is not None
    assert plain.scene.dense is not None
    assert len(hard.scene.dense.points) < len(plain.scene.dense.points)
    own = {mask.id: mask for mask in plain.instances}
    shares = [overlap(mask, own[mask.id]) for mask in hard.instances if mask.id in own]
    assert 0.5 < np.median(shares) < 0.99


def heights(synthetic: SyntheticScene, world: World) -> FloatArray:
    """(n,) heights of the dense points above the floor, in metres."""
    assert synthetic.scene.dense is not None
    true = np.array([pose.centre for pose in world.poses])
    back = similarity_between(np.array([view.centre for view in synthetic.scene.views]), true)
    return np.asarray(back(synthetic.scene.dense.points)[:, 2])
