"""Point labels: visibility, masks, votes."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import csr_array

from estimator.association.point_labels import PointLabels, dense_labels, is_at_object, point_votes, sparse_labels
from estimator.association.point_labels import pixels_in_masks as view_labels
from estimator.projection.visibility import project_unoccluded
from estimator.records.scene import Camera, DenseCloud, Instance, Scene, View
from tests.synthetic.shapes import box, floor, orbit, synthetic_scene


@pytest.fixture(scope="module")
def synthetic():
    objects = [
        floor(6),
        box("cabinet", (0.6, 0.4, 1.0), (0, 0, 0)),
        box("chair", (0.4, 0.4, 0.8), (0.9, -0.5, 0), 20),
        box(None, (4, 0.1, 2.5), (0, 1.0, 0)),
    ]
    return synthetic_scene(
        objects, orbit(8, 3.0, 1.4, arc=120, size=(200, 150), focal=160.0), dense=16_000, noise=0.001
    )


def tracks_of(synthetic):
    names = sorted({instance.track for instance in synthetic.instances})
    return {name: [k for k, i in enumerate(synthetic.instances) if i.track == name] for name in names}


def test_pixel_belongs_to_the_mask_cell_it_lies_in():
    mask = np.array([[True, False], [False, True]])
    instance = Instance("1", 0, "cup", mask, (10, 20))
    pixels = np.array([[10.0, 20.0], [10.99, 20.99], [11.0, 20.5], [11.5, 21.5], [9.99, 20.0], [12.0, 21.0]])
    assert view_labels(pixels, [instance])[0].tolist() == [0, 1, 3]


def test_overlapping_masks_both_label():
    whole = Instance("1", 0, "cabinet", np.ones((4, 4), dtype=bool), (0, 0))
    part = Instance("2", 0, "poster", np.ones((2, 2), dtype=bool), (1, 1))
    cabinet, poster = view_labels(np.array([[0.5, 0.5], [1.5, 1.5]]), [whole, part])
    assert cabinet.tolist() == [0, 1]
    assert poster.tolist() == [1]


def test_the_wall_behind_is_not_taken(synthetic):
    labels = dense_labels(synthetic.scene, synthetic.instances)
    for name, members in tracks_of(synthetic).items():
        rows = point_votes(labels, synthetic.instances, [members])[0]
        owner = synthetic.owner[rows]
        assert (owner == int(name)).mean() > 0.97
        assert (owner == int(name)).sum() > 0.9 * (synthetic.owner == int(name)).sum()


def test_projection_without_visibility_would_take_the_wall(synthetic):
    """The depth test excludes the wall, which is included if every point is declared visible everywhere."""
    count, views = len(synthetic.scene.dense.points), len(synthetic.scene.views)
    everywhere = DenseCloud(
        synthetic.scene.dense.points, np.arange(0, count * views + 1, views), np.tile(np.arange(views), count)
    )
    labels = dense_labels(replace(synthetic.scene, dense=everywhere), synthetic.instances)
    cabinet = tracks_of(synthetic)["1"][0]
    members = labels.membership[[cabinet]].indices
    assert (synthetic.owner[members] == 3).mean() > 0.1


def test_visibility_file_is_believed(synthetic):
    """A point listed in no view is seen by none, however it projects."""
    count = len(synthetic.scene.dense.points)
    nowhere = DenseCloud(synthetic.scene.dense.points, np.zeros(count + 1, dtype=np.int64), np.empty(0, dtype=np.int64))
    labels = dense_labels(replace(synthetic.scene, dense=nowhere), synthetic.instances)
    assert labels.visibility.nnz == 0
    assert labels.membership.nnz == 0


def test_sparse_points_count_only_where_they_were_observed(synthetic):
    labels = sparse_labels(synthetic.scene, synthetic.instances)
    observed = sum(len(view.point_index) for view in synthetic.scene.views)
    assert labels.visibility.nnz == observed
    assert 0 < labels.membership.nnz < observed


def test_a_missed_detection_is_no_vote_against(synthetic):
    labels = dense_labels(synthetic.scene, synthetic.instances)
    members = tracks_of(synthetic)["1"]
    kept = [k for k in members if synthetic.instances[k].view % 2 == 0]
    fewer = [instance for k, instance in enumerate(synthetic.instances) if k not in set(members) - set(kept)]
    labels_fewer = dense_labels(synthetic.scene, fewer)
    rows = point_votes(labels, synthetic.instances, [members])[0]
    rows_fewer = point_votes(labels_fewer, fewer, [[k for k, i in enumerate(fewer) if i.track == "1"]])[0]
    assert len(rows_fewer) > 0.85 * len(rows)


def test_points_behind_the_camera_are_not_seen(synthetic):
    view = synthetic.scene.views[0]
    behind = view.centre - 2.0 * view.rotation[2] + np.random.default_rng(0).normal(0, 0.1, (50, 3))
    sight = project_unoccluded(view, behind)
    assert sight.rows.size == 0
    assert sight.pixels.shape == (0, 2)


def test_no_instances_and_no_points(synthetic):
    assert dense_labels(synthetic.scene, []).membership.shape == (0, len(synthetic.scene.dense.points))
    bare = replace(synthetic.scene, dense=DenseCloud(np.empty((0, 3))))
    assert dense_labels(bare, synthetic.instances).membership.nnz == 0
    with pytest.raises(ValueError, match="no dense cloud"):
        dense_labels(replace(synthetic.scene, dense=None), synthetic.instances)


def test_a_stray_far_behind_its_mask_is_left_out():
    """A point three mask diagonals behind the rest, seen in the mask, is not of the object."""
    synthetic = synthetic_scene(
        [box("cup", (0.3, 0.3, 0.3), (0, 0, 0))], orbit(2, 2.0, 0.8, arc=20, size=(160, 120), focal=120.0), 2000
    )
    view, instance = synthetic.scene.views[0], synthetic.instances[0]
    centre = view.rotation.T @ (np.array([0, 0, 6.0]) - view.translation)
    points = np.vstack([synthetic.scene.dense.points, centre])
    offsets = np.arange(0, 2 * len(points) + 1, 2)
    cloud = DenseCloud(points, offsets, np.tile([0, 1], len(points)))
    labels = dense_labels(replace(synthetic.scene, dense=cloud), [instance])
    assert len(points) - 1 not in labels.membership.indices
    assert labels.membership.nnz > 500


def labels_by_hand(inside, looked):
    """Labels of n points: inside (m, n) the masks, looked (v, n) by the views, mask k being of view k."""
    inside, looked = csr_array(np.array(inside, dtype=np.float32)), csr_array(np.array(looked, dtype=np.float32))
    count = inside.shape[1]
    return PointLabels(np.zeros((count, 3)), np.arange(count), inside, looked, looked, inside)


def masks_of_views(count):
    return [Instance(str(k), k, "chair", np.ones((2, 2), dtype=bool), (0, 0)) for k in range(count)]


def test_a_point_that_two_of_many_views_see_is_no_part_of_the_object():
    """Twenty views see the first three points inside the mask; only two see the last, which smear left on the way."""
    seen = np.ones((20, 4))
    seen[2:, 3] = 0
    labels = labels_by_hand(seen, seen)
    assert point_votes(labels, masks_of_views(20), [range(20)])[0].tolist() == [0, 1, 2]
    few = labels_by_hand(seen[:6], seen[:6])
    assert point_votes(few, masks_of_views(6), [range(6)])[0].tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_of_two_that_agree_as_well_the_smaller_has_the_point(order):
    """A poster within the mask of its cabinet keeps its points, in whatever order they come."""
    inside = np.array([[1, 1, 1, 1], [0, 0, 1, 1]])
    labels = labels_by_hand(inside, np.ones((2, 4)))
    masks = [Instance(str(k), 0, "chair", np.ones((2, 2), dtype=bool), (0, 0)) for k in range(2)]
    rows = point_votes(labels, masks, [[k] for k in order])
    assert [rows[order.index(k)].tolist() for k in range(2)] == [[0, 1], [2, 3]]


@pytest.mark.parametrize(("views", "from_box", "votes", "is_part"), [
    (10, False, 6, True), (10, False, 5, False), (20, True, 17, True), (20, True, 16, False),
])  # fmt: skip
def test_a_point_belongs_to_masks_from_60_percent_and_to_boxes_from_85_percent_of_the_views(
    views, from_box, votes, is_part
):
    inside = np.ones((views, 2))
    inside[votes:, 1] = 0
    labels = labels_by_hand(inside, np.ones((views, 2)))
    masks = [replace(mask, from_box=from_box) for mask in masks_of_views(views)]
    rows = point_votes(labels, masks, [range(views)])[0]
    assert rows.tolist() == ([0, 1] if is_part else [0])


@pytest.mark.parametrize(
    ("from_box", "diagonals", "is_part"),
    [(False, 1.4, True), (False, 1.6, False), (True, 0.9, True), (True, 1.1, False)],
)
def test_points_behind_the_object_by_more_than_its_mask_are_background(from_box, diagonals, is_part):
    """The mask of 30 x 40 pixels has a diagonal of half the distance of the object, whose focal length is 100 px."""
    camera = Camera("PINHOLE", 100, 100, np.array([100.0, 100.0, 50.0, 50.0]))
    view = View("a", camera, np.eye(3), np.zeros(3), np.empty((0, 2)), np.empty(0, np.int64))
    points = np.array([[0.0, 0.0, 1.0]] * 5 + [[0.0, 0.0, 1.0 + 0.5 * diagonals]])
    scene = Scene(Path("a"), "memory", (view,), np.empty((0, 3)), DenseCloud(points, np.arange(7), np.zeros(6, int)))
    mask = Instance("1", 0, "cup", np.ones((40, 30), dtype=bool), (35, 30), from_box=from_box)
    assert dense_labels(scene, [mask]).membership.nnz == (6 if is_part else 5)


@pytest.mark.parametrize(("seen_by", "is_part"), [(7, True), (5, False)])
def test_a_point_is_seen_by_15_percent_of_the_views_of_the_usual_one(seen_by, is_part):
    """Forty views see the other points."""
    seen = np.ones((40, 4))
    seen[seen_by:, 3] = 0
    rows = point_votes(labels_by_hand(seen, seen), masks_of_views(40), [range(40)])[0]
    assert (3 in rows) == is_part


@pytest.mark.parametrize(("offset", "is_part"), [(9, True), (11, False)])
def test_the_depth_of_a_box_is_that_of_its_central_half(offset, is_part):
    """A box of 40 pixels, at whose centre two points are: points beside them are central within 10 pixels."""
    camera = Camera("PINHOLE", 200, 200, np.array([100.0, 100.0, 100.0, 100.0]))
    box = Instance("1", 0, "chair", np.ones((40, 40), dtype=bool), (80, 80), from_box=True)
    pixels = np.array([[100.0, 100.0], [101.0, 101.0], *[[100.0 + offset, 100.0]] * 3])
    depths = np.array([1.0, 1.0, 5.0, 5.0, 5.0])  # a median of 5 with the other points, and of 1 without
    points = SimpleNamespace(depths=depths, pixels=pixels)
    assert is_at_object(points, np.arange(5), box, camera).tolist() == [not is_part] * 2 + [is_part] * 3
