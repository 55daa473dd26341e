"""What hides an object: made masks and points, in pixels, before a flat object at depth 3."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import median_filter

from estimator.projection.visibility import Visibility
from estimator.records.objects import SupportPlane, Up
from estimator.records.scene import Camera, Instance, Scene, View
from insertion.composite.compose import ObjectComposite, occlude_mutually
from insertion.composite.occlusion import (
    close_gaps,
    guided_matte,
    has_unconfirmed_occluder,
    occluded_by_points,
    occluded_fraction,
    on_support,
    stands_on_occluder,
    vote_of_points,
)
from insertion.footage.footage import Frame
from insertion.render.layers import ObjectLayers
from insertion.render.renderer import ObjectImage
from insertion.scene.frame_masks import (
    FrameContent,
    MaskPropagator,
    billboards,
    moving_masks,
    propagate_mask,
    static_cloud,
    static_points,
)
from insertion.scene.pixel_box import PixelBox
from insertion.scene.point_cloud import ColouredPoints, VisiblePoints, visible_points
from insertion.scene.supports import SupportSurfaces

BOX = PixelBox(0, 0, 160, 120)
VIEW = View(
    "0.png", Camera("PINHOLE", 640, 480, np.array([500.0, 500, 320, 240])), np.eye(3), np.zeros(3),
    np.zeros((0, 2)), np.zeros(0, np.int64),
)  # fmt: skip
NEAR, OBJECT, FAR = 2.0, 3.0, 4.0


def _image() -> ObjectImage:
    return ObjectImage(
        np.ones((*BOX.shape, 3), np.float32), np.ones(BOX.shape, np.float32), np.full(BOX.shape, OBJECT, np.float32)
    )


def _object(name: str, *boxes: tuple[int, int, int, int]) -> Instance:
    mask = np.zeros(BOX.shape, bool)
    for x0, y0, x1, y1 in boxes:
        mask[y0:y1, x0:x1] = True
    return Instance(name, 0, name, mask, (0, 0), 1.0)


def _points(*parts: tuple[tuple[int, int, int, int], float], count: int = 25) -> VisiblePoints:
    """Points spread over boxes of pixels (x0, y0, x1, y1), each at a depth."""
    generator = np.random.default_rng(0)
    pixels = np.concatenate([generator.uniform(box[:2], box[2:], (count, 2)) for box, _ in parts])
    depths = np.repeat([depth for _, depth in parts], count)
    return VisiblePoints(np.arange(len(pixels)), pixels, depths * generator.normal(1, 0.002, len(depths)), False)


def _hidden(objects: Sequence[Instance], points: VisiblePoints) -> np.ndarray:
    return occluded_fraction(_image(), BOX, VIEW, objects, points, np.zeros(len(points.rows), bool))[0] > 0.5


def test_points_of_a_mixed_mask_decide_in_each_pixel() -> None:
    top, near, far = (10, 10, 150, 30), (20, 30, 35, 110), (120, 30, 135, 90)
    hidden = _hidden([_object("table", top, near, far)], _points((top, NEAR), (near, NEAR), (far, FAR)))
    assert hidden[40:105, 21:34].all()
    assert not hidden[45:88, 121:134].any()
    assert not hidden[:, 60:100][45:].any()


@pytest.mark.parametrize(("column", "hides"), [(71.5, True), (72.5, False)])
def test_points_within_12_pixels_of_the_object_decide(column: float, hides: bool) -> None:
    """The object ends at column 60; 200 points of the same mask further away are behind it."""
    image = _image()
    image.alpha[:, 60:] = 0
    box = (40, 10, 160, 110)
    close = np.column_stack([np.full(4, column), [58.5, 59.5, 60.5, 61.5]])
    away = np.random.default_rng(0).uniform((120, 10), (160, 110), (200, 2))
    depths = np.repeat([NEAR, FAR], [4, 200])
    points = VisiblePoints(np.arange(204), np.concatenate([close, away]), depths, False)
    fraction, _ = occluded_fraction(image, BOX, VIEW, [_object("wall", box)], points, np.zeros(204, bool))
    assert bool(fraction[60, 50] > 0.5) == hides


def test_dense_points_in_the_border_of_another_mask_do_not_decide() -> None:
    """Points of a dice in front leak into the mask of the desk behind it, where the desk itself has few points."""
    dice, leak, desk = (90, 40, 130, 80), (84, 40, 90, 80), (10, 30, 60, 110)
    points = replace(_points((dice, NEAR), (leak, NEAR), (desk, FAR)), dense=True)
    masks = [_object("dice", dice), _object("desk", (0, 30, 90, 120))]
    hidden = _hidden(masks, points)
    assert hidden[42:78, 92:128].all()
    assert not hidden[32:118, :80].any()


@pytest.mark.parametrize(("ratio", "is_hidden"), [(0.97, False), (0.96, True)])
def test_dense_points_in_a_mask_must_be_clearly_closer(ratio: float, is_hidden: bool) -> None:
    """A board behind the object has points of the object's depth, within the noise of a dense cloud."""
    board, border = (10, 10, 150, 60), (10, 60, 150, 110)
    pixels = np.random.default_rng(0).uniform((10, 10), (150, 60), (60, 2))
    pixels = np.concatenate([pixels, pixels + np.array([0.0, 50.0])])
    depths = np.repeat([OBJECT * ratio, FAR], 60)
    points = VisiblePoints(np.arange(120), pixels, depths, True)
    hidden = _hidden([_object("board", board, border)], points)
    assert hidden[20:45, 20:140].all() == is_hidden
    assert hidden[20:45, 20:140].any() == is_hidden


def test_a_mask_without_points_occludes_if_the_mask_below_it_does() -> None:
    table, cup = (10, 60, 150, 110), (70, 40, 80, 60)
    points = _points((table, NEAR))
    assert _hidden([_object("cup", cup), _object("table", table)], points)[42:58, 72:78].all()
    lamp = (70, 10, 80, 30)  # hangs free: nothing states that it is near
    assert not _hidden([_object("lamp", lamp), _object("table", table)], points)[12:28, 72:78].any()


def test_a_gap_between_masks_is_closed_unless_points_behind_are_visible() -> None:
    left, right, gap = (10, 10, 70, 110), (76, 10, 150, 110), (71, 15, 75, 105)
    objects = [_object("left", left), _object("right", right)]
    points = _points((left, NEAR), (right, NEAR))
    assert _hidden(objects, points)[20:100, 70:76].all()
    seen_through = _points((left, NEAR), (right, NEAR), (gap, FAR))
    assert not _hidden(objects, seen_through)[20:100, 72:74].any()


def test_points_at_the_depth_of_the_object_do_not_vote() -> None:
    couch = (10, 30, 150, 110)
    touching = _points((couch, NEAR), (couch, OBJECT * 1.005))
    assert _hidden([_object("couch", couch)], touching)[35:105, 15:145].all()


def test_points_that_this_view_does_not_observe_do_not_vote() -> None:
    couch, edge = (10, 30, 150, 110), (10, 30, 60, 50)
    leak = _points((couch, NEAR), (edge, FAR))
    seen = np.repeat([True, False], 25)
    assert not _hidden([_object("couch", couch)], leak)[33:47, 13:57].all()
    assert _hidden([_object("couch", couch)], replace(leak, observed=seen))[33:107, 13:147].all()


def test_a_video_frame_uses_the_points_that_its_nearest_view_observed() -> None:
    points = np.array([[0.0, 0.0, 2.0], [1.0, 0.0, 4.0]])
    rows = (np.array([0]), np.array([1]))
    known = Visibility(rows, np.array([[0.0, 0, 0], [5.0, 0, 0]]), np.array([[0.0, 0, 1], [0.0, 0, 1]]), complete=False)
    cloud = ColouredPoints(points, np.zeros((2, 3), np.float32), False, known)
    front = visible_points(VIEW, cloud)
    assert front.observed is not None
    assert dict(zip(front.rows.tolist(), front.observed.tolist(), strict=True)) == {0: True, 1: False}


def test_gaps_of_rows_and_of_columns_are_closed() -> None:
    reach, behind = 6, np.full(BOX.shape, OBJECT, np.float32)
    for axis in (0, 1):
        hidden = np.ones(BOX.shape, bool)
        hidden[(slice(40, 50), slice(None)) if axis == 0 else (slice(None), slice(40, 50))] = False
        assert close_gaps(hidden, reach, behind, np.zeros((0, 2)), np.zeros(0))[20:-20, 20:-20].all()


def test_a_box_includes_its_first_pixels_and_excludes_its_last() -> None:
    front = VisiblePoints(np.arange(4), np.array([[2.0, 3], [8, 3], [2, 9], [7.9, 8.9]]), np.ones(4), False)
    assert np.flatnonzero(front.in_box(PixelBox(2, 3, 8, 9))).tolist() == [0, 3]


def test_a_mask_with_an_origin_is_propagated_to_its_position() -> None:
    item = replace(_object("box", (0, 0, 20, 16)), origin=(300, 200))
    carried = propagate_mask(item, VIEW, VIEW, np.array([1 / NEAR, 0.0, 0.0]))
    assert carried is not None
    assert np.abs(np.array(carried.origin) - item.origin).max() <= 1
    assert np.abs(np.array(carried.mask.shape) - [16, 20]).max() <= 3


def _joined(depth: float, alpha: float = 1.0) -> ObjectComposite:
    image = ObjectImage(
        np.ones((*BOX.shape, 3), np.float32),
        np.full(BOX.shape, alpha, np.float32),
        np.full(BOX.shape, depth, np.float32),
    )
    layers = ObjectLayers(BOX, image, np.ones((*BOX.shape, 3), np.float32), np.full(BOX.shape, np.nan, np.float32))
    return ObjectComposite(layers, np.zeros(BOX.shape, np.float32), np.ones((*BOX.shape, 3), np.float32))


def test_inserted_objects_occlude_by_depth() -> None:
    near, far = occlude_mutually([_joined(NEAR), _joined(FAR)])
    assert (near.visible, far.visible) == (1.0, 0.0)
    assert [item.visible for item in occlude_mutually([_joined(NEAR), _joined(NEAR)])] == [1.0, 1.0]
    assert _joined(NEAR, alpha=0.0).visible == 0.0


def test_masks_are_those_of_the_nearest_annotated_view() -> None:
    """Steps count by the depth of the scene: a metre is little before a wall ten metres away."""
    views = tuple(replace(VIEW, name=f"{x}.png", translation=np.array([-x, 0.0, 0.0])) for x in (0.0, 2.0, 9.0))
    wall = np.column_stack([np.random.default_rng(0).uniform(-3, 3, (400, 2)), np.full(400, 10.0)])
    cloud = ColouredPoints(wall, np.zeros((400, 3), np.float32), True)
    mask = Instance("", 0, "box", np.ones((100, 160), bool), (240, 190))
    masks = {row: (replace(mask, view=row, id=str(row)),) for row in range(3)}
    propagator = MaskPropagator(Scene(Path(), "memory", views, wall, None), masks, cloud)
    for x, nearest in ((0.5, "0"), (1.5, "1"), (20.0, None)):
        found = propagator.masks(None, replace(VIEW, translation=np.array([-x, 0.0, 0.0])))
        assert [item.id for item in found] == ([] if nearest is None else [nearest])


def test_a_frame_has_its_own_masks_if_it_has_the_size_of_its_reconstruction() -> None:
    wall = np.column_stack([np.random.default_rng(0).uniform(-3, 3, (400, 2)), np.full(400, 10.0)])
    cloud = ColouredPoints(wall, np.zeros((400, 3), np.float32), True)
    scene = Scene(Path(), "memory", (VIEW,), wall, None)
    mask = Instance("own", 0, "box", np.ones((100, 160), bool), (240, 190))
    supports = SupportSurfaces(Up(np.array([0.0, -1.0, 0.0]), "cameras", 0.0), ())
    content = FrameContent(scene, cloud, supports, MaskPropagator(scene, {0: (mask,)}, cloud))
    camera = replace(VIEW.camera, width=2 * VIEW.camera.width, height=2 * VIEW.camera.height)
    large = replace(VIEW, camera=replace(camera, params=2 * VIEW.camera.params))
    (own,) = content.at(Frame(3, "3.png", None, VIEW, 0)).masks
    assert own is mask
    for view, row, width in ((VIEW, None, 160), (large, 0, 320)):
        (propagated,) = content.at(Frame(3, "3.png", None, view, row)).masks
        assert propagated is not mask
        assert propagated.mask.shape[1] == pytest.approx(width, abs=3)


def _ground() -> SupportPlane:
    """The floor 0.8 below the camera of VIEW, whose y points down."""
    basis = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
    return SupportPlane(basis, -0.8, 0.0, 100, np.zeros(2), 1.0, np.ones((2, 2), bool))


def _walker(depth: float, columns: tuple[int, int]) -> Instance:
    """Somebody 1.7 tall whose feet are at a depth."""
    top, bottom = (max(round(240 + 500 * y / depth), 0) for y in (-0.9, 0.8))
    mask = np.ones((min(bottom, 480) - top, columns[1] - columns[0]), bool)
    return Instance("walker", 0, "person", mask, (columns[0], top), 1.0)


def test_the_feet_of_a_moving_mask_give_its_depth() -> None:
    box = PixelBox(100, 100, 540, 470)
    behind = np.full(box.shape, 3.0, np.float32)
    for depth, hides in ((2.0, True), (2.9, True), (3.1, False), (6.0, False)):
        (one,) = billboards([_walker(depth, (300, 340))], VIEW, _ground())
        assert one.offset == pytest.approx(depth, rel=0.01)
        hidden = one.occludes(box, VIEW, behind)
        assert hidden.any() == hides
        if hides:
            assert hidden[:, 200:240].sum() == hidden.sum() > 1000
    (cut,) = billboards([_walker(1.5, (300, 340))], VIEW, _ground())  # its feet are below the image
    assert cut.occludes(box, VIEW, behind).any()
    flying = Instance("bird", 0, "bird", np.ones((20, 20), bool), (300, 50), 1.0)
    assert billboards([flying], VIEW, _ground()) == []


def test_a_billboard_is_upright_in_a_view_from_above() -> None:
    """A camera that looks down by 30 degrees: the head is closer along the axis than the feet."""
    turn = np.radians(30)
    rotation = np.array([[1, 0, 0], [0, np.cos(turn), -np.sin(turn)], [0, np.sin(turn), np.cos(turn)]])
    view = replace(VIEW, rotation=rotation)
    ends = np.array([[0.0, 0.8, 1.5], [0.0, 0.3, 1.5]]) @ rotation.T  # feet and head
    pixels = 500 * ends[:, :2] / ends[:, 2:] + [320, 240]
    top, bottom = round(pixels[1, 1]), round(pixels[0, 1])
    item = Instance("walker", 0, "person", np.ones((bottom - top, 40), bool), (300, top), 1.0)
    (one,) = billboards([item], view, _ground())
    for row, depth in ((top + 2, ends[1, 2]), (bottom - 2, ends[0, 2])):
        box = PixelBox(315, row, 325, row + 1)
        for share, hides in ((0.97, False), (1.03, True)):
            behind = np.full(box.shape, depth * share, np.float32)
            assert one.occludes(box, view, behind).all() == hides


@pytest.mark.parametrize(("n_rows", "is_left"), [(3, False), (4, True)])
def test_the_feet_are_the_lowest_4_percent_of_a_mask(n_rows: int, is_left: bool) -> None:
    """A mask of 100 rows whose lowest rows are on the left, the others on the right."""
    mask = np.zeros((100, 60), bool)
    mask[:, 40:] = True
    mask[-n_rows:] = False
    mask[-n_rows:, :10] = True
    (one,) = billboards([Instance("walker", 0, "person", mask, (500, 300), 1.0)], VIEW, _ground())
    left, right = (
        billboards([Instance("walker", 0, "person", mask[:, part], (x, 300), 1.0)], VIEW, _ground())[0]
        for part, x in ((slice(10), 500), (slice(40, 60), 540))
    )
    assert right.offset == pytest.approx(left.offset, rel=0.2)
    assert (one.direction[0] == pytest.approx(left.direction[0], abs=1e-6)) == is_left


def test_points_behind_a_moving_mask_are_not_visible() -> None:
    points = _points(((0, 0, 60, 120), FAR), ((100, 0, 160, 120), FAR))
    left = static_points(points, [_object("walker", (0, 0, 80, 120))])
    assert len(left.rows) == 25
    assert left.pixels[:, 0].min() >= 100
    assert static_points(left, [_object("walker", (0, 0, 80, 120))]) is left


def test_points_on_moving_masks_are_removed_from_the_cloud() -> None:
    """A car in the left of two of three frames; the third has no mask and does not count."""
    left, right = np.array([[-1.6, -1.4, 4.0]]), np.array([[0.4, 0, 4.0]])
    cloud = ColouredPoints(np.vstack([left, right]), np.zeros((2, 3), np.float32), False)
    frames = [Frame(k, f"{k}.png", None, VIEW, None) for k in range(3)]
    car = _object("car", (80, 0, 160, 120))
    np.testing.assert_array_equal(static_cloud(cloud, {0: (car,), 1: (car,)}, frames).points, right)
    assert len(static_cloud(cloud, {0: (car,), 1: (_object("car", (0, 0, 1, 1)),)}, frames).points) == 2


def test_masks_of_frames_are_read_by_the_names_of_the_frames(tmp_path: Path) -> None:
    polygon = [300, 200, 340, 200, 340, 400, 300, 400]
    images = [{"id": k, "file_name": f"{k:06d}.png", "width": 640, "height": 480} for k in (0, 2)]
    annotation = {"id": 1, "image_id": 2, "category_id": 1, "segmentation": [polygon], "iscrowd": 0, "area": 8000}
    document = {"images": images, "categories": [{"id": 1, "name": "person"}], "annotations": [annotation]}
    file = tmp_path / "moving.json"
    file.write_text(json.dumps(document))
    frames = [Frame(k, f"{k:06d}.png", k / 30, None if k == 1 else VIEW, None) for k in range(3)]
    read = moving_masks(file, Scene(tmp_path, "memory", (VIEW,), np.zeros((0, 3))), frames)
    assert list(read) == [2]
    assert read[2][0].mask.sum() == pytest.approx(8000, rel=0.05)


def test_the_matte_follows_the_edge_of_the_image_if_there_is_one() -> None:
    hidden = np.zeros((80, 120), bool)
    hidden[:, :59] = True
    picture = np.full((80, 120, 3), 40, np.uint8)
    stays = guided_matte(hidden, picture, 6)[40]
    picture[:, 60:] = 200
    moved = guided_matte(hidden, picture, 6)[40]
    assert moved[59] > 0.7 > 0.3 > stays[59]
    assert moved[58] > 0.9 > 0.1 > moved[60]


def test_the_matte_is_1_inside_a_mask() -> None:
    """A mask three pixels too wide, over an occluder that is hardly darker: the filter alone leaves 3 % inside."""
    picture = np.full((80, 120, 3), 120.0)
    picture[:, 60:] = 110
    noisy = np.clip(picture + np.random.default_rng(3).normal(0, 1.0, picture.shape), 0, 255).astype(np.uint8)
    hidden = np.zeros((80, 120), bool)
    hidden[:, 57:] = True
    share = guided_matte(hidden, noisy, 8)
    assert (share[:, 59:] == 1).all()
    assert (share[:, :55] == 0).all()


def _nearest(pixel: tuple[int, int], points: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the nearest points (n, 2) to the middle of a pixel (column, row), and how far they are."""
    distance = np.hypot(*(points - np.array(pixel) - 0.5).T)
    rows = np.argsort(distance)[:count]
    return rows, distance[rows]


def test_a_pixel_of_a_mask_has_the_vote_of_its_five_nearest_points() -> None:
    generator = np.random.default_rng(5)
    mask = np.zeros((24, 30), bool)
    mask[4:20, 3:27] = True
    points, nearer = generator.uniform((3, 4), (27, 20), (60, 2)), generator.random(60) < 0.6
    votes = np.zeros(mask.shape, bool)
    for row, column in np.argwhere(mask):
        votes[row, column] = nearer[_nearest((column, row), points, 5)[0]].mean() > 0.5
    np.testing.assert_array_equal(vote_of_points(mask, points, nearer), median_filter(votes, 5))


def test_without_a_mask_70_percent_of_seven_near_points_must_be_closer() -> None:
    generator = np.random.default_rng(6)
    where, behind = np.ones((24, 30), bool), np.full((24, 30), OBJECT, np.float32)
    where[:, :4] = False
    points = generator.uniform((0, 0), (20, 24), (200, 2))  # nothing is known of the right third
    depths = OBJECT * generator.choice([0.9, 0.97, 1.1], 200, p=[0.7, 0.15, 0.15])  # 3 % is noise
    hides = np.zeros(where.shape, bool)
    for row, column in np.argwhere(where):
        rows, distance = _nearest((column, row), points, 7)
        toward = (points[rows] - [column + 0.5, row + 0.5]) / distance[:, None]
        hides[row, column] = (
            (depths[rows] < 0.95 * OBJECT).mean() > 0.7
            and distance[3] < 4.0
            and np.linalg.norm(toward.mean(axis=0)) < 0.85  # not beside all of them
        )
    assert 50 < hides.sum() < 400
    np.testing.assert_array_equal(occluded_by_points(where, behind, points, depths, 4.0), median_filter(hides, 5))
    assert not occluded_by_points(where, behind, points[:6], depths[:6], 4.0).any()


def test_an_occluder_of_dense_points_ends_at_its_edge() -> None:
    """Nothing is known of 30 columns beside a post with a point every 2 pixels; they are no part of it."""
    y, x = np.mgrid[1:120:2, 1:40:2]
    post = np.column_stack([x.ravel(), y.ravel()]).astype(float)
    wall = post + np.array([70.0, 0.0])
    pixels, depths = np.concatenate([post, wall]), np.repeat([NEAR, FAR], [len(post), len(wall)])
    hidden = occluded_by_points(np.ones(BOX.shape, bool), _image().depth, pixels, depths, 24.0)
    assert hidden[:, :39].all()
    assert not hidden[:, 44:].any()
    outline = post[(x.ravel() < 3) | (x.ravel() > 37) | (y.ravel() < 3) | (y.ravel() > 117)]  # a plain surface
    outline = np.concatenate([outline, post[::29]])
    hidden = occluded_by_points(np.ones(BOX.shape, bool), _image().depth, outline, np.full(len(outline), NEAR), 24.0)
    assert hidden[5:115, 3:37].mean() > 0.97


@pytest.mark.parametrize(("count", "is_possible"), [(6, True), (5, False)])
def test_six_points_in_front_and_in_no_mask_are_a_possible_occluder(count: int, is_possible: bool) -> None:
    layers = ObjectLayers(BOX, _image(), np.ones((*BOX.shape, 3), np.float32), np.ones(BOX.shape, np.float32))
    box = (10, 10, 60, 60)
    points, support = _points((box, NEAR), count=count), np.zeros(count, bool)
    assert has_unconfirmed_occluder(layers, points, support, []) == is_possible
    assert not has_unconfirmed_occluder(layers, points, ~support, [])
    assert not has_unconfirmed_occluder(layers, points, support, [_object("box", box)])
    assert not has_unconfirmed_occluder(layers, replace(points, dense=True), support, [])
    assert not has_unconfirmed_occluder(layers, _points((box, OBJECT * 0.98), count=count), support, [])


def test_a_mask_stands_on_an_occluder_if_half_of_the_pixels_below_are_occluded() -> None:
    mask, hidden = np.zeros((20, 20), bool), np.zeros((20, 20), bool)
    mask[5:10, 5:15] = True
    for columns, stands in (((5, 11), True), ((5, 9), False)):
        hidden[:] = False
        hidden[10:, slice(*columns)] = True
        assert stands_on_occluder(hidden, mask) == stands
    mask[5:] = True  # nothing of the image is below
    assert not stands_on_occluder(hidden, mask)


def test_points_at_the_height_of_the_foot_are_on_the_support() -> None:
    """5 % of the object, or the error of the cloud there; never a third of the object."""
    heights = np.array([0.09, 0.11, -0.09, 0.23, 0.25, 0.55, 0.65])
    depths = np.array([1.0, 1.0, 1.0, 20.0, 20.0, 200.0, 200.0])
    cloud = ColouredPoints(np.column_stack([np.zeros((7, 2)), heights + 1]), np.zeros((7, 3), np.float32), False)
    front = VisiblePoints(np.arange(7), np.zeros((7, 2)), depths, False)
    body = SimpleNamespace(position=np.array([5.0, 5.0, 1.0]), basis=np.eye(3), unit=2.0)
    assert on_support(body, cloud, front).tolist() == [True, False, True, True, False, True, False]  # type: ignore[arg-type]
    assert on_support(body, cloud, front, sigma=0.05).tolist()[:2] == [True, True]  # type: ignore[arg-type]
