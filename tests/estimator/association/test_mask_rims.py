"""Masks that are larger or smaller than their objects, by the points near their borders."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from scipy.sparse import csr_array

from estimator.association import mask_checks
from estimator.association.mask_checks import (
    continuity_warnings,
    depth_continuity,
    overlap_warnings,
    overlapping_fraction,
    rim_agreement,
    rim_warnings,
    straight_fractions,
    straight_warnings,
)
from estimator.association.point_labels import PointLabels, sparse_labels
from estimator.association.tracks import shared_tracks
from estimator.records.scene import Camera, Instance, View
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.quick import quick_scene


def wider(mask, pixels):
    """The mask of an instance with so many pixels more on each side."""
    grown = cv2.dilate(np.pad(mask.mask, pixels).astype(np.uint8), np.ones((2 * pixels + 1,) * 2, np.uint8)) > 0
    return replace(mask, mask=grown, origin=tuple(edge - pixels for edge in mask.origin))


@pytest.fixture(scope="module")
def room():
    return quick_scene(furnished_room("kitchen", 44), seed=44, dense_a_frame=0)


@pytest.fixture(scope="module")
def sitting_room():
    return quick_scene(furnished_room("sitting room", 45), seed=45, dense_a_frame=0)


@pytest.mark.parametrize(("share", "doubtful"), [(0.0, False), (0.02, False), (0.1, True)])
def test_masks_grown_by_a_fifth_are_doubtful(room, share, doubtful):
    masks = [wider(mask, round(share * np.sqrt(mask.mask.sum()))) for mask in room.instances]
    labels = sparse_labels(room.scene, masks)
    tracks = [track.members for track in shared_tracks(masks, [labels])]
    problems = rim_warnings(rim_agreement(room.scene.views, labels, masks, tracks))
    assert len(problems) == doubtful
    if doubtful:
        assert "larger than their objects" in problems[0].message


def test_boxes_and_lone_masks_say_nothing(room):
    labels = sparse_labels(room.scene, room.instances)
    boxes = [replace(mask, from_box=True) for mask in room.instances]
    assert rim_warnings(rim_agreement(room.scene.views, labels, boxes, [range(len(boxes))])) == ()
    assert rim_warnings(rim_agreement(room.scene.views, labels, room.instances, [(0,), (1,)])) == ()


@pytest.mark.parametrize(
    ("inside", "outside", "doubtful"),
    [
        (0.79, 0.01, True),  # fewer than 80 % of the points in the rims are inside other masks
        (0.81, 0.01, False),
        (0.7, 0.16, True),  # 30 % outside, 1.8 times as many as the points just outside of the masks
        (0.7, 0.17, False),
        (np.nan, 0.1, False),
    ],
)
def test_both_sides_of_the_thresholds_of_the_rims(inside, outside, doubtful):
    assert len(rim_warnings((inside, outside))) == doubtful


@pytest.mark.parametrize(("share", "doubtful"), [(0.0, False), (0.02, False), (0.2, True)])
def test_masks_that_end_inside_of_their_objects_are_doubtful(sitting_room, share, doubtful):
    """Masks eroded by a fifth of their size on each side."""
    masks = []
    for mask in sitting_room.instances:
        pixels = round(share * np.sqrt(mask.mask.sum()))
        padded = np.pad(mask.mask, pixels + 1).astype(np.uint8)
        eroded = cv2.erode(padded, np.ones((2 * pixels + 1,) * 2, np.uint8)) > 0
        if eroded.any():
            masks.append(replace(mask, mask=eroded, origin=tuple(edge - pixels - 1 for edge in mask.origin)))
    scene = sitting_room.scene
    problems = continuity_warnings(depth_continuity(scene.views, scene.points, masks))
    assert len(problems) == doubtful
    if doubtful:
        assert "smaller than their objects" in problems[0].message
    boxes = [replace(mask, from_box=True) for mask in masks]
    assert np.isnan(depth_continuity(scene.views, scene.points, boxes))


@pytest.mark.parametrize(("continuity", "doubtful"), [(0.69, False), (0.71, True), (np.nan, False)])
def test_both_sides_of_the_threshold_of_the_continuity(continuity, doubtful):
    problems = continuity_warnings(continuity)
    assert [problem.is_doubtful for problem in problems] == [True] * doubtful


def joined(mask, masks):
    """The mask together with the nearest other one of its image."""
    others = [other for other in masks if other.view == mask.view and other is not mask]
    if not others:
        return mask
    other = min(others, key=lambda one: np.hypot(*np.subtract(one.origin, mask.origin)))
    low = np.minimum(mask.origin, other.origin)
    high = np.maximum(*(np.add(one.origin, one.mask.shape[::-1]) for one in (mask, other)))
    both = np.zeros((high - low)[::-1], dtype=bool)
    for one in (mask, other):
        (left, top), (height, width) = one.origin - low, one.mask.shape
        both[top : top + height, left : left + width] |= one.mask
    return replace(mask, mask=both, origin=tuple(low.tolist()))


@pytest.mark.parametrize("kind", ["right", "larger", "joined", "boxes"])
def test_masks_that_share_their_pixels_are_doubtful(room, kind):
    masks = list(room.instances)
    if kind == "larger":
        masks = [wider(mask, round(0.1 * np.sqrt(mask.mask.sum()))) for mask in masks]
    elif kind != "right":
        masks = [joined(mask, masks) for mask in masks]
    masks = [replace(mask, from_box=kind == "boxes") for mask in masks]
    problems = overlap_warnings(overlapping_fraction(masks))
    assert [problem.is_doubtful for problem in problems] == [True] * (kind in {"larger", "joined"})


@pytest.mark.parametrize(("fraction", "doubtful"), [(0.29, False), (0.31, True), (np.nan, False)])
def test_both_sides_of_the_maximum_of_overlapping_masks(fraction, doubtful):
    assert len(overlap_warnings(fraction)) == doubtful


@pytest.mark.parametrize("side", ["left", "right", "top", "bottom", "all", "none"])
def test_masks_that_end_in_a_straight_line_are_doubtful(room, side):
    masks = []
    for mask in room.instances:
        height, width = mask.mask.shape
        rows, columns = np.indices(mask.mask.shape)
        inside = {
            "left": columns >= width // 2,
            "right": columns < width // 2,
            "top": rows >= height // 2,
            "bottom": rows < height // 2,
        }.get(side, np.ones_like(mask.mask))
        pixels = inside if side == "all" else mask.mask & inside
        if pixels.any():
            used = np.ix_(np.flatnonzero(pixels.any(axis=1)), np.flatnonzero(pixels.any(axis=0)))
            origin = tuple(np.add(mask.origin, [used[1].min(), used[0].min()]).tolist())
            masks.append(replace(mask, mask=pixels[used], origin=origin))
    problems = straight_warnings(straight_fractions(room.scene.views, masks))
    assert [problem.is_doubtful for problem in problems] == [True] * (side != "none")
    if side not in {"all", "none"}:
        assert f"straight line at the {side}" in problems[0].message
    assert np.isnan(straight_fractions(room.scene.views, masks[:9])).all()


@pytest.mark.parametrize(("fraction", "doubtful"), [(0.59, False), (0.61, True), (np.nan, False)])
def test_both_sides_of_the_maximum_of_straight_masks(fraction, doubtful):
    assert len(straight_warnings(np.array([0.1, fraction, 0.1, 0.1]))) == doubtful


def _mask(
    height: int, width: int, filled: int, origin: tuple[int, int] = (20, 20), *, from_box: bool = False
) -> Instance:
    """A mask of a view of 200 x 100 pixels whose left side has so many pixels, and the other sides one each."""
    pixels = np.zeros((height, width), dtype=bool)
    pixels[1 : 1 + filled, 0] = pixels[0, 1] = pixels[-1, 1] = pixels[height // 2, -1] = True
    return Instance("1", 0, "chair", pixels, origin, from_box=from_box)


@pytest.mark.parametrize(
    ("mask", "n_masks", "left"),
    [
        (_mask(20, 20, 12), 10, 1.0),  # `MIN_STRAIGHT_FILL` of 0.6
        (_mask(20, 20, 11), 10, 0.0),
        (_mask(20, 20, 12), 9, np.nan),  # `MIN_MASKS`
        (_mask(12, 20, 9), 10, 1.0),  # `MIN_STRAIGHT_PX`
        (_mask(11, 20, 9), 10, np.nan),
        (_mask(20, 11, 12), 10, np.nan),
        (_mask(20, 20, 12, from_box=True), 10, np.nan),
        (_mask(20, 20, 12, (2, 20)), 10, 1.0),
        (_mask(20, 20, 12, (1, 20)), 10, 0.0),  # the border of the image cuts it
    ],
)
def test_a_side_is_straight_if_three_fifths_of_it_are_in_the_mask(mask: Instance, n_masks: int, left: float) -> None:
    camera = Camera("PINHOLE", 200, 100, np.array([100.0, 100, 100, 50]))
    view = View("a", camera, np.eye(3), np.zeros(3), np.zeros((0, 2)), np.zeros(0, dtype=int))
    fractions = straight_fractions([view], [mask] * n_masks)
    assert fractions[0] == pytest.approx(left, nan_ok=True)
    if not np.isnan(left):
        assert fractions[1:].tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(("n_observations", "is_known"), [(49, False), (51, True)])
def test_rims_have_100_observations_by_other_views(n_observations, is_known, monkeypatch):
    """MIN_RIM_OBSERVATIONS: of each of two masks so many points are in the rim, and a fifth of them in the other."""
    n = 2 * n_observations
    inside = np.zeros((2, n))
    inside[0, :n_observations] = inside[1, n_observations:] = 1
    inside[:, ::5] = 1
    member, seen = csr_array(inside), csr_array(np.ones((2, n)))
    labels = PointLabels(np.zeros((n, 3)), np.arange(n), member, seen, seen, member)
    masks = [Instance(str(view), view, "chair", np.ones((1, 1), dtype=bool), (0, 0)) for view in (0, 1)]
    views = [SimpleNamespace(point_index=np.arange(n)) for _ in masks]
    rims = [np.arange(n_observations), np.arange(n_observations, n)]
    monkeypatch.setattr(mask_checks, "border_observations", lambda _, mask: (rims[mask.view], rims[mask.view][:0]))
    agreement = rim_agreement(views, labels, masks, [(0, 1)])
    assert agreement == pytest.approx((0.2 if is_known else np.nan, np.nan), nan_ok=True, abs=0.01)


@pytest.mark.parametrize(("side", "n_rim"), [(14, 0), (16, 2)])
def test_the_rim_of_a_mask_is_two_pixels_wide_or_wider(side, n_rim):
    """A tenth of the side: masks with a rim of a pixel are not compared. Keypoints in the rim, inside and outside."""
    mask = Instance("1", 0, "chair", np.ones((side, side), dtype=bool), (10, 10))
    keypoints = np.array([[10.5, 18.0], [11.9, 18.0], [13.5, 18.0], [9.5, 18.0], [6.0, 18.0]])
    rim, outside = mask_checks.border_observations(SimpleNamespace(keypoints=keypoints), mask)
    assert rim.tolist() == [0, 1][:n_rim]
    assert outside.tolist() == [3] * bool(n_rim)


@pytest.mark.parametrize(("step", "continuity"), [(0.028, 1.0), (0.032, 0.0)])
@pytest.mark.parametrize(("n", "is_known"), [(99, False), (100, True)])
def test_points_of_a_surface_differ_by_three_percent_in_depth(step, continuity, n, is_known):
    """MAX_DEPTH_STEP; a hundred observations outside of the mask (MIN_RIM_OBSERVATIONS), each by one in its rim."""
    mask = Instance("1", 0, "chair", np.ones((60, 240), dtype=bool), (100, 100))
    x = 102.5 + 2.0 * np.arange(n)
    keypoints = np.concatenate([np.column_stack([x, np.full(n, 101.5)]), np.column_stack([x, np.full(n, 98.5)])])
    depth = np.repeat([5.0, 5.0 * (1 + step)], n)
    camera = Camera("SIMPLE_PINHOLE", 640, 480, np.array([500.0, 320, 240]))
    points = np.column_stack([(keypoints - [320, 240]) / 500 * depth[:, None], depth])
    view = View("a", camera, np.eye(3), np.zeros(3), keypoints, np.arange(2 * n))
    found = depth_continuity([view], points, [mask])
    assert found == pytest.approx(continuity if is_known else np.nan, nan_ok=True)
    assert np.isnan(depth_continuity([view], points, [replace(mask, from_box=True)]))
