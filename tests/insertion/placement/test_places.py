"""Where an object is put, by each of the ways to say it, in a synthetic room with known objects."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import metric_tree
from estimator.projection.cameras import pixels_in_view
from insertion.insertion_scene import InsertionScene
from insertion.placement.free_space import free_positions
from insertion.placement.model_size import model_size
from insertion.placement.on_category import instances_named
from insertion.placement.placed_object import PlacedObject, footprint
from insertion.placement.placement import PlacementError
from insertion.placement.preview import write_preview
from insertion.placement_page import PlacementPage
from insertion.request import ObjectRequest, PixelPosition
from metric_base.errors import InputError
from metric_cli.insert_object.insert import parse_objects, parse_scene
from metric_cli.insert_object.parser import parser
from models3d.gltf.model_reader import read_model
from tests.synthetic.insertions import RecordedRoom, in_unit, place_in, prepared_scene_of, video_room, write_glb
from tests.synthetic.minitree import release
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.shapes import solid

KIND = "sitting room"
#: Number of units of another reconstruction of the room per unit of this one.
UNIT = 0.037


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> RecordedRoom:
    return video_room(KIND, 1003, tmp_path_factory.mktemp("room"), views=5)


@pytest.fixture(scope="module")
def prepared(room: RecordedRoom) -> InsertionScene:
    return prepared_scene_of(room)


@pytest.fixture(scope="module")
def in_other_unit(room: RecordedRoom) -> InsertionScene:
    return prepared_scene_of(in_unit(room, UNIT))


@pytest.fixture(scope="module")
def cup(room: RecordedRoom) -> Path:
    return write_glb(solid("cup", np.array([0.08, 0.08, 0.1])), room.folder / "cup.glb")


@pytest.mark.parametrize("words", ["1,2", "0,0,0", "a,b,c", "1,2,nan"])
def test_up_that_is_no_direction_is_one_line(words: str) -> None:
    options = parser().parse_args(["scene", "--scale", "1", "--up", words, "--model", "a.glb", "--out", "out"])
    with pytest.raises(InputError, match="--up: direction: expected X,Y,Z"):
        parse_scene(options)


def test_a_plane_just_above_a_better_one_is_not_offered(prepared: InsertionScene, cup: Path) -> None:
    model, space = read_model(cup), prepared.space
    size = footprint(model, model_size(model, "file"), space.metres_per_unit)
    plain = free_positions(space, *size)
    assert plain
    floor = prepared.space.supports.surfaces[0]
    thin = replace(floor.plane, height=floor.plane.height + 0.3 * floor.plane.cell, points=floor.plane.points // 3)
    phantom = replace(floor, number=len(prepared.space.supports.surfaces), plane=thin)
    both = replace(space, supports=replace(space.supports, surfaces=(*prepared.space.supports.surfaces, phantom)))
    assert phantom.number not in {place.plane for place in free_positions(both, *size)}
    assert {place.plane for place in plain} <= {place.plane for place in free_positions(both, *size)}


def _foot(room: RecordedRoom, placed: PlacedObject) -> np.ndarray:
    """Where the object stands, in metres of the synthetic room."""
    return np.asarray(room.to_scene.inverse(placed.placement.position[None])[0])


def test_on_a_category_is_on_its_top(room: RecordedRoom, prepared: InsertionScene, cup: Path) -> None:
    (placed,) = place_in(prepared, [ObjectRequest(cup, on="coffee table")])
    table = next(entry for entry in room.world.objects if entry.category == "coffee table")
    foot = _foot(room, placed)
    low, high = table.mesh.vertices.min(axis=0), table.mesh.vertices.max(axis=0)
    assert foot[2] == pytest.approx(high[2], abs=0.02)
    assert (foot[:2] > low[:2]).all()
    assert (foot[:2] < high[:2]).all()


@pytest.mark.parametrize(
    "request_of",
    [
        ObjectRequest,
        lambda cup: ObjectRequest(cup, size="height=0.4", facing="wall"),
        lambda cup: ObjectRequest(cup, on="coffee table", facing=30.0),
        lambda cup: ObjectRequest(cup, at=PixelPosition("2", 320.0, 300.0)),
        lambda cup: ObjectRequest(cup, plane=0, xy_m=(0.3, -0.2)),
        lambda cup: ObjectRequest(cup, plane=0, path=((0.4, 0.0), (0.4, 0.3)), speed_m_s=0.5),
    ],
)
def test_the_unit_of_the_reconstruction_does_not_move_an_object(
    prepared: InsertionScene, in_other_unit: InsertionScene, cup: Path, request_of: Callable[[Path], ObjectRequest]
) -> None:
    (one,), (other,) = (place_in(scene, [request_of(cup)]) for scene in (prepared, in_other_unit))
    assert (one.placement.support, one.placement.plane, one.warnings) == (
        other.placement.support,
        other.placement.plane,
        other.warnings,
    )
    assert other.size_m == pytest.approx(one.size_m)
    for time_s in (0.0, 1.0, 9.0):
        bodies = one.body_at(time_s), other.body_at(time_s)
        units = 1 / prepared.scale.metres_per_unit  # of the first scene to the metre
        np.testing.assert_allclose(bodies[1].position / UNIT, bodies[0].position, atol=1e-4 * units)
        np.testing.assert_allclose(bodies[1].basis, bodies[0].basis, atol=1e-6)
        np.testing.assert_allclose(bodies[1].corners, bodies[0].corners, atol=1e-4)
        assert bodies[1].unit / UNIT == pytest.approx(bodies[0].unit)


def test_who_walks_looks_along_the_way_or_so_many_degrees_from_it(prepared: InsertionScene, cup: Path) -> None:
    way = ObjectRequest(cup, plane=0, path=((0.4, 0.0), (0.4, 0.3)), speed_m_s=0.5)
    ahead, aside = (place_in(prepared, [replace(way, facing=turn)])[0].body_at(0.3) for turn in (0.0, 70.0))
    turn = Rotation.from_rotvec(70.0 * ahead.basis[2], degrees=True)
    np.testing.assert_allclose(aside.parts[0].vertices, turn.apply(ahead.parts[0].vertices), atol=1e-5)


def test_the_last_word_of_a_category_is_enough(room: RecordedRoom, prepared: InsertionScene, cup: Path) -> None:
    one, other = (place_in(prepared, [ObjectRequest(cup, on=name)])[0] for name in ("coffee table", "Table"))
    np.testing.assert_allclose(_foot(room, one), _foot(room, other))


def test_the_tree_knows_what_a_sofa_is(prepared: InsertionScene) -> None:
    assert {item.category for item in instances_named(prepared.space.instances, "sofa")} == {"couch"}


def test_a_word_is_read_as_detectors_mean_it(prepared: InsertionScene, cup: Path) -> None:
    """By itself "bat" is an animal or a stick: the label lists of detectors decide, in `--on` and in `--size prior`."""
    tree = metric_tree.open()
    one, other = (replace(prepared.space.instances[0], category=name) for name in ("bat", "couch"))
    with pytest.raises(metric_tree.UnknownName):
        tree.find("bat")
    listed = tree.find("bat", "detectors")
    assert instances_named([one, other], listed.node_id, tree) == [one]
    assert model_size(read_model(cup), "prior", tree, "bat").source.startswith(f"prior of {listed.node_id}")


def test_a_top_that_is_no_plane_of_the_scene(room: RecordedRoom, prepared: InsertionScene, cup: Path) -> None:
    """Without the plane of the table's top, the object's own points say where its top is."""
    placed = place_in(prepared, [ObjectRequest(cup, on="coffee table")])[0].placement
    others = tuple(one for one in prepared.space.supports.surfaces if one.number != placed.plane)
    supports = replace(prepared.space.supports, surfaces=others)
    fewer = replace(prepared, space=replace(prepared.space, supports=supports))
    again = place_in(fewer, [ObjectRequest(cup, on="coffee table")])[0].placement
    assert placed.plane is not None
    assert again.plane is None
    up = placed.basis[2]
    assert (again.position - placed.position) @ up * prepared.scale.metres_per_unit == pytest.approx(0, abs=0.015)


def test_what_is_larger_than_everything_has_no_place(prepared: InsertionScene, cup: Path) -> None:
    with pytest.raises(PlacementError, match="--at auto: no free level space of this size"):
        place_in(prepared, [ObjectRequest(cup, size="height=300")])


def test_the_preview_lists_the_options_of_each_place(prepared: InsertionScene, cup: Path, tmp_path: Path) -> None:
    (placed,) = place_in(prepared, [ObjectRequest(cup)])
    size = footprint(placed.model, placed.size, placed.metres_per_unit)
    places = write_preview(prepared.space, prepared.images, *size, tmp_path / "places.png")
    assert (tmp_path / "places.png").stat().st_size > 10_000
    words = ["scene", "--scale", "1", "--model", str(cup), *places[0].options.split(), "--out", "out"]
    (request,) = parse_objects(parser().parse_args(words).objects)
    (again,) = place_in(prepared, [request])
    np.testing.assert_allclose(
        again.placement.position, placed.placement.position, atol=1e-3 / prepared.scale.metres_per_unit
    )


def test_the_page_of_a_place_answers_with_the_box_the_picture_and_the_command(
    room: RecordedRoom, prepared: InsertionScene, cup: Path
) -> None:
    page = PlacementPage(
        prepared, [ObjectRequest(cup, on="couch", plane=3)], None, lambda requests: f"at {requests[0].at}"
    )
    kind, start = page.answer("start") or ("", b"")
    frames = json.loads(start)["frames"]
    assert (kind, json.loads(start)["models"]) == ("application/json", ["cup.glb"])
    assert [(one["number"], one["width"], one["height"]) for one in frames] == [(n, 640, 480) for n in range(5)]
    plain = cv2.imdecode(np.frombuffer((page.answer("frame/2") or ("", b""))[1], np.uint8), cv2.IMREAD_COLOR)
    own = cv2.imread(str(room.folder / "images" / frames[2]["name"]))
    assert np.abs(plain.astype(int) - own).mean() < 3  # JPEG
    wish = "0/2/320/400/30"
    corners = json.loads((page.answer(f"box/{wish}") or ("", b""))[1])["corners"]
    asked = ObjectRequest(cup, at=PixelPosition(frames[2]["name"], 320.0, 400.0), facing=30.0)
    (placed,) = place_in(prepared, [asked])
    view = prepared.scene.views[2]
    true, _ = pixels_in_view(view, placed.body.position + placed.body.unit * placed.body.corners)
    box, body = (np.array([points.min(axis=0), points.max(axis=0)]) for points in (np.array(corners), true))
    assert len(corners) == 8
    assert (box[0] < body[0] + 0.1).all()
    assert (box[1] > body[1] - 0.1).all()
    assert (np.ptp(box, axis=0) < 1.45 * np.ptp(body, axis=0)).all()  # of a round cup, seen along a diagonal
    assert (np.abs(box.mean(axis=0) - body.mean(axis=0)) < 0.1 * np.ptp(body, axis=0)).all()
    assert page.answer(f"picture/{wish}") is None  # not drawn yet
    drawn = json.loads((page.answer(f"drawn/{wish}") or ("", b""))[1])
    assert drawn["command"] == f"at {asked.at}"
    assert drawn["says"][0].startswith("0.08 x 0.08 x 0.1 m on ")
    assert (page.answer(f"picture/{wish}") or ("", b""))[0] == "image/jpeg"
    assert page.answer("box/0/9/320/400/30") is None
    assert "refused" in json.loads((page.answer("box/0/2/5/5/0") or ("", b""))[1])
    for body in (b"7", b"{}", b'{"object": 0, "frame": 2, "x": 5, "y": 5, "facing": 0}'):
        assert (page.receive("done", body) or (0, {}))[0] == 400
    assert page.chosen is None
    assert page.receive("other", b"{}") is None


@pytest.mark.parametrize("words", [["--xy", "-0.5,0.2"], ["--xy=-0.5,0.2"]])
def test_metres_may_be_negative(words: list[str]) -> None:
    options = parser().parse_args(["scene", "--model", "a.glb", "--plane", "0", *words, "--out", "out"])
    assert parse_objects(options.objects)[0].xy_m == (-0.5, 0.2)


def test_on_what_is_not_there_is_refused(prepared: InsertionScene, cup: Path) -> None:
    with pytest.raises(
        PlacementError, match=r"--on: expected a category of the instances \(.*couch.*\); found 'piano'"
    ):
        place_in(prepared, [ObjectRequest(cup, on="piano")])


def test_a_plane_and_metres_along_it(room: RecordedRoom, prepared: InsertionScene, cup: Path) -> None:
    """The lowest plane is the floor, and metres are metres whatever the scene's unit is."""
    one, other = (place_in(prepared, [ObjectRequest(cup, plane=0, xy_m=(x, 0.0))])[0] for x in (0.0, 0.3))
    feet = _foot(room, one), _foot(room, other)
    assert feet[0][2] == pytest.approx(0.0, abs=0.02)
    assert np.linalg.norm(feet[1] - feet[0]) == pytest.approx(0.3, abs=0.005)


@pytest.mark.parametrize(("plane", "xy", "word"), [(99, (0.0, 0.0), "--plane"), (0, (50.0, 0.0), "--xy")])
def test_no_such_plane_or_point(
    prepared: InsertionScene, cup: Path, plane: int, xy: tuple[float, float], word: str
) -> None:
    with pytest.raises(PlacementError, match=word):
        place_in(prepared, [ObjectRequest(cup, plane=plane, xy_m=xy)])


def test_facing_the_wall_is_square_to_the_room(room: RecordedRoom, prepared: InsertionScene, cup: Path) -> None:
    (placed,) = place_in(prepared, [ObjectRequest(cup, plane=0, facing="wall")])
    front = room.to_scene.rotation.T @ placed.front
    # walls run along x and y; within ten degrees
    assert np.abs(front[:2]).max() > np.cos(np.radians(10))
    # its back is to the wall: the front looks into the room
    inward = -_foot(room, placed)[:2] / (np.array(KINDS[KIND].floor) / 2)
    axis = int(np.abs(front[:2]).argmax())
    assert front[axis] * inward[axis] > 0 or abs(inward[axis]) < 0.5


def test_the_size_of_the_prior(room: RecordedRoom, prepared: InsertionScene, cup: Path, tmp_path: Path) -> None:
    import metric_tree

    tree = metric_tree.open(release(tmp_path / "tree").directory)
    names = [node.name for node in tree.leaves() if "height" in (node.dims or ())]
    request = replace(ObjectRequest(cup, plane=0), size="prior", category=names[0])
    (placed,) = place_in(prepared, [request], tree)
    median = float(tree.find(names[0]).prior(("height",)).quantile(0.5)[0]) / 1000
    assert placed.size_m["height"] == pytest.approx(median, rel=1e-6)
    high = np.ptp(placed.body.corners @ placed.body.basis[2]) * placed.body.unit
    assert high * prepared.scale.metres_per_unit == pytest.approx(median, rel=1e-6)
