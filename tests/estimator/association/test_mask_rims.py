"""Masks that are larger or smaller than their objects, by the points near their borders."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from estimator.association.mask_checks import continuity_warnings, depth_continuity, rim_agreement, rim_warnings
from estimator.association.point_labels import sparse_labels
from estimator.association.tracks import shared_tracks
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
