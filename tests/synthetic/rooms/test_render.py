from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.skips import skip_without
from tests.synthetic.rooms.masks import coco_dataset, instances_of
from tests.synthetic.rooms.render import Frame, NoOpenGL, Renderer
from tests.synthetic.rooms.solids import box, join
from tests.synthetic.rooms.world import Placed, World, pose_towards


def frames(world: World, *indices: int, colour: bool = False) -> list[Frame]:
    with skip_without(NoOpenGL), Renderer(world) as renderer:
        return [renderer.frame(index, colour) for index in indices]


def entry(name: str, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Placed:
    size = np.array([x[1] - x[0], y[1] - y[0], z[1] - z[0]])
    return Placed(name, "book", "book", size, box(x, y, z, "print"))


@pytest.fixture
def two_boxes() -> World:
    """Return a wall 4 m ahead, a box in front of it, and a closer box that occludes the left half of the first."""
    far, near = (
        entry("far", (-0.5, 0.5), (2.5, 3.0), (0.5, 1.5)),
        entry("near", (-0.5, 0.0), (1.5, 2.0), (0.5, 1.5)),
    )
    wall = join([box((-9, 9), (4, 4.1), (-9, 9), "wall")])
    pose = pose_towards(np.array([0.0, 0.0, 1.0]), np.array([0.0, 4.0, 1.0]))
    return World("test", 0, (far, near), wall, (pose, pose))


def test_rendered_depth_and_ids_are_exact(two_boxes: World) -> None:
    frame = frames(two_boxes, 0)[0]
    assert frame.depth[5, 5] == pytest.approx(4.0, rel=1e-5)
    assert frame.depth[240, 340] == pytest.approx(2.5, rel=1e-5)
    assert frame.depth[240, 300] == pytest.approx(1.5, rel=1e-5)
    assert {0, 1, 2} == set(np.unique(frame.ids))
    # the near box spans x = -0.5 .. 0 and z = 0.5 .. 1.5 at 1.5 m: 500 px * 0.5 / 1.5 left of the central column 320
    rows, columns = np.nonzero(frame.ids == 2)
    assert (columns.min(), columns.max()) == (pytest.approx(320 - 500 / 3, abs=1), pytest.approx(319, abs=1))
    assert (rows.min(), rows.max()) == (pytest.approx(240 - 500 / 3, abs=1), pytest.approx(239 + 500 / 3, abs=1))


def test_closer_object_occludes_half_of_the_distant_one(two_boxes: World) -> None:
    single = replace(two_boxes, objects=two_boxes.objects[:1])
    complete, occluded = frames(single, 0)[0], frames(two_boxes, 0)[0]
    assert (occluded.ids == 1).sum() == pytest.approx((complete.ids == 1).sum() / 2, rel=0.02)


def test_moving_object_moves_by_its_velocity_and_the_remainder_is_unchanged(two_boxes: World) -> None:
    far, near = two_boxes.objects
    moving = replace(two_boxes, objects=(far, replace(near, velocity=np.array([-0.3, 0.0, 0.0]))))
    first, second = frames(moving, 0, 1)
    shift = np.nonzero(first.ids == 2)[1].min() - np.nonzero(second.ids == 2)[1].min()
    assert shift == pytest.approx(500 * 0.3 / 1.5, abs=1)
    assert np.array_equal(first.depth[:, 500:], second.depth[:, 500:])


def test_almost_all_tiles_of_a_frame_have_texture(room: World) -> None:
    frame = frames(room, 3, colour=True)[0]
    assert frame.colour is not None
    tiles = frame.colour[..., 1].reshape(12, 40, 16, 40).std(axis=(1, 3))
    assert (tiles > 1.0).mean() > 0.98


def test_masks_of_a_frame_equal_the_rendered_ids(room: World) -> None:
    from pycocotools import mask as decode_segmentation

    frame = frames(room, 0)[0]
    instances = instances_of(room, [frame.ids])
    assert {item.track for item in instances} <= {item.track for item in room.objects}
    dataset = coco_dataset(room, [frame.ids], ["a.jpg"])
    numbers = {item.track: k + 1 for k, item in enumerate(room.objects)}
    for annotation in dataset["annotations"]:
        assert np.array_equal(
            decode_segmentation.decode(annotation["segmentation"]) == 1, frame.ids == numbers[annotation["track_id"]]
        )
        assert annotation["area"] == (frame.ids == numbers[annotation["track_id"]]).sum()
