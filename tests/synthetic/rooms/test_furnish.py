from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.layout import Footprint, apart
from tests.synthetic.rooms.render import Renderer
from tests.synthetic.rooms.street import street
from tests.synthetic.rooms.world import Placed, World

WORLDS = [(kind, seed) for kind in KINDS for seed in (1000, 1001)]


def are_separated(a: Placed, b: Placed) -> bool:
    """Return True if two meshes are separated in height or along a horizontal direction (without the layout)."""
    first, second = a.mesh.vertices, b.mesh.vertices
    if first[:, 2].min() >= second[:, 2].max() - 1e-6 or second[:, 2].min() >= first[:, 2].max() - 1e-6:
        return True
    for yaw in np.linspace(0, np.pi, 90, endpoint=False):
        axis = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        along_first, along_second = first @ axis, second @ axis
        if along_first.min() > along_second.max() or along_second.min() > along_first.max():
            return True
    return False


@pytest.mark.parametrize(("kind", "seed"), WORLDS)
def test_objects_of_a_room_do_not_intersect_and_have_a_support(kind: str, seed: int) -> None:
    world = furnished_room(kind, seed)
    assert len(world.objects) >= 5
    tops = {item.track: item.mesh.vertices[:, 2].max() for item in world.objects}
    for item in world.objects:
        assert item.mesh.vertices[:, 2].min() == pytest.approx(tops[item.support] if item.support else 0.0, abs=1e-9)
        assert np.all(np.abs(item.mesh.vertices[:, :2]) <= np.array(KINDS[kind].floor) / 2 + 1e-9)
    for a, b in combinations(world.objects, 2):
        assert are_separated(a, b), (a.track, b.track)


@pytest.mark.parametrize("kind", KINDS)
def test_camera_path_is_inside_the_room_and_outside_the_furniture(kind: str) -> None:
    world = furnished_room(kind, 1000)
    eyes = np.array([pose.centre for pose in world.poses])
    assert np.all(np.abs(eyes[:, :2]) < np.array(KINDS[kind].floor) / 2)
    for item in world.objects:
        low, high = item.mesh.vertices.min(axis=0), item.mesh.vertices.max(axis=0)
        assert not np.any(np.all((eyes > low) & (eyes < high), axis=1))


def objects_of(world: World) -> list[tuple[str, str, tuple[float, ...]]]:
    return [(item.track, item.label, tuple(item.mesh.vertices.ravel())) for item in world.objects]


def test_rooms_are_equal_for_equal_seeds_and_different_for_different_seeds() -> None:
    assert objects_of(furnished_room("bedroom", 5)) == objects_of(furnished_room("bedroom", 5))
    assert objects_of(furnished_room("bedroom", 5)) != objects_of(furnished_room("bedroom", 6))


@pytest.mark.parametrize("count", [1, 4, 8])
def test_room_with_a_number_of_objects_keeps_their_supports(count: int) -> None:
    world = furnished_room("kitchen", 1000, Knobs(objects=count))
    assert len(world.objects) == count
    tracks = {item.track for item in world.objects}
    assert all(item.support is None or item.support in tracks for item in world.objects)


def test_all_objects_have_a_wrong_label_if_the_fraction_is_one() -> None:
    wrong = furnished_room("study", 1000, Knobs(mislabelled=1.0))
    assert all(item.label != item.category for item in wrong.objects)


def test_all_objects_are_tilted_if_the_fraction_is_one() -> None:
    tilted = furnished_room("study", 1000, Knobs(tilted=1.0, tilt_deg=30))
    assert all(item.tilt_deg == pytest.approx(30) for item in tilted.objects)


def test_heading_of_a_narrow_turn_stays_within_its_range() -> None:
    world = furnished_room("study", 1000, Knobs(turn_deg=4.0))
    heading = [np.degrees(np.arctan2(pose.rotation[2, 1], pose.rotation[2, 0])) for pose in world.poses]
    assert max(heading) - min(heading) == pytest.approx(4.0, abs=0.1)


@pytest.mark.parametrize("seed", [1000, 1001, 1002])
def test_street_has_moving_objects_and_static_objects_that_do_not_intersect(seed: int) -> None:
    world = street(seed)
    moving = [item for item in world.objects if np.any(item.velocity)]
    assert moving
    assert len(world.objects) > len(moving) + 4
    still = [item for item in world.objects if not np.any(item.velocity)]
    assert all(are_separated(a, b) for a, b in combinations(still, 2))


def test_sky_has_infinite_depth_and_no_object() -> None:
    with Renderer(street(1002)) as renderer:
        frame = renderer.frame(0)
    assert np.isinf(frame.depth[0]).any()
    assert not frame.ids[np.isinf(frame.depth)].any()


def test_fraction_above_one_is_an_error() -> None:
    with pytest.raises(ValueError, match=r"mislabelled: expected a fraction from 0 to 1; found 2"):
        Knobs(mislabelled=2.0)


def test_rectangles_are_apart_if_an_axis_separates_them_by_the_gap() -> None:
    square = Footprint(np.zeros(2), np.ones(2), 0.0)
    assert apart(square, Footprint(np.array([2.5, 0.0]), np.ones(2), 0.0), 0.4)
    assert not apart(square, Footprint(np.array([2.2, 0.0]), np.ones(2), np.pi / 4), 0.0)
    assert apart(square, Footprint(np.array([2.5, 0.0]), np.ones(2), np.pi / 4), 0.0)
