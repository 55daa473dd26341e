"""Where an object is put, by each of the ways to say it, in a synthetic room with known objects."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import metric_tree
from insertion.models.gltf import read_model
from insertion.models.size import model_size
from insertion.pipeline.objects import Placed, place_objects, space_for
from insertion.pipeline.prepared_scene import PreparedScene
from insertion.pipeline.preview import write_preview
from insertion.pipeline.request import ObjectRequest
from insertion.placement.free_space import candidates
from insertion.placement.on_objects import instances_named
from insertion.placement.place import NoPlace
from metric_base.errors import InputError
from metric_cli.insert_object.insert import parser
from metric_cli.insert_object.scene_arguments import prepared_scene_of as stage_of_arguments
from metric_cli.insert_object.scene_arguments import requests_of
from tests.synthetic.insertions import RecordedRoom, prepared_scene_of, video_room, write_glb
from tests.synthetic.minitree import release
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.shapes import solid

KIND = "sitting room"


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> RecordedRoom:
    return video_room(KIND, 1003, tmp_path_factory.mktemp("room"), views=5)


@pytest.fixture(scope="module")
def prepared(room: RecordedRoom) -> PreparedScene:
    return prepared_scene_of(room)


@pytest.fixture(scope="module")
def cup(room: RecordedRoom) -> Path:
    return write_glb(solid("cup", np.array([0.08, 0.08, 0.1])), room.folder / "cup.glb")


@pytest.mark.parametrize("words", ["1,2", "0,0,0", "a,b,c", "1,2,nan"])
def test_up_that_is_no_direction_is_one_line(words: str) -> None:
    options = parser().parse_args(["scene", "--scale", "1", "--up", words, "--model", "a.glb", "--out", "out"])
    with pytest.raises(InputError, match="--up: direction: expected X,Y,Z"):
        stage_of_arguments(options)


def test_a_plane_just_above_a_better_one_is_not_offered(prepared: PreparedScene, cup: Path) -> None:
    model = read_model(cup)
    space = space_for(prepared, model, model_size(model, "file"))
    plain = candidates(space)
    assert plain
    floor = prepared.supports.surfaces[0]
    thin = replace(floor.plane, height=floor.plane.height + 0.3 * floor.plane.cell, points=floor.plane.points // 3)
    phantom = replace(floor, number=len(prepared.supports.surfaces), plane=thin)
    both = replace(space, supports=replace(space.supports, surfaces=(*prepared.supports.surfaces, phantom)))
    assert phantom.number not in {place.plane for place in candidates(both)}
    assert {place.plane for place in plain} <= {place.plane for place in candidates(both)}


def _foot(room: RecordedRoom, placed: Placed) -> np.ndarray:
    """Where the object stands, in metres of the synthetic room."""
    return np.asarray(room.to_scene.inverse(placed.place.position[None])[0])


def test_on_a_category_is_on_its_top(room: RecordedRoom, prepared: PreparedScene, cup: Path) -> None:
    (placed,) = place_objects(prepared, [ObjectRequest(cup, on="coffee table")])
    table = next(entry for entry in room.world.objects if entry.category == "coffee table")
    foot = _foot(room, placed)
    low, high = table.mesh.vertices.min(axis=0), table.mesh.vertices.max(axis=0)
    assert foot[2] == pytest.approx(high[2], abs=0.02)
    assert (foot[:2] > low[:2]).all()
    assert (foot[:2] < high[:2]).all()


def test_the_last_word_of_a_category_is_enough(room: RecordedRoom, prepared: PreparedScene, cup: Path) -> None:
    one, other = (place_objects(prepared, [ObjectRequest(cup, on=name)])[0] for name in ("coffee table", "Table"))
    np.testing.assert_allclose(_foot(room, one), _foot(room, other))


def test_the_tree_knows_what_a_sofa_is(prepared: PreparedScene) -> None:
    assert {item.category for item in instances_named(prepared.instances, "sofa")} == {"couch"}


def test_a_word_is_read_as_detectors_mean_it(prepared: PreparedScene, cup: Path) -> None:
    """By itself "bat" is an animal or a stick: the label lists of detectors decide, in `--on` and in `--size prior`."""
    tree = metric_tree.open()
    one, other = (replace(prepared.instances[0], category=name) for name in ("bat", "couch"))
    with pytest.raises(metric_tree.UnknownName):
        tree.find("bat")
    listed = tree.find("bat", "detectors")
    assert instances_named([one, other], listed.node_id, tree) == [one]
    assert model_size(read_model(cup), "prior", tree, "bat").source.startswith(f"prior of {listed.node_id}")


def test_a_top_that_is_no_plane_of_the_scene(room: RecordedRoom, prepared: PreparedScene, cup: Path) -> None:
    """Without the plane of the table's top, the object's own points say where its top is."""
    placed = place_objects(prepared, [ObjectRequest(cup, on="coffee table")])[0].place
    others = tuple(one for one in prepared.supports.surfaces if one.number != placed.plane)
    fewer = replace(prepared, supports=replace(prepared.supports, surfaces=others))
    again = place_objects(fewer, [ObjectRequest(cup, on="coffee table")])[0].place
    assert placed.plane is not None
    assert again.plane is None
    up = placed.basis[2]
    assert (again.position - placed.position) @ up * prepared.scale.metres_per_unit == pytest.approx(0, abs=0.015)


def test_what_is_larger_than_everything_has_no_place(prepared: PreparedScene, cup: Path) -> None:
    with pytest.raises(NoPlace, match="--at auto: no free level space of this size"):
        place_objects(prepared, [ObjectRequest(cup, size="height=300")])


def test_the_preview_lists_the_options_of_each_place(prepared: PreparedScene, cup: Path, tmp_path: Path) -> None:
    (placed,) = place_objects(prepared, [ObjectRequest(cup)])
    places = write_preview(prepared, space_for(prepared, placed.model, placed.size), tmp_path / "places.png")
    assert (tmp_path / "places.png").stat().st_size > 10_000
    words = ["scene", "--scale", "1", "--model", str(cup), *places[0].options.split(), "--out", "out"]
    (request,) = requests_of(parser().parse_args(words))
    (again,) = place_objects(prepared, [request])
    np.testing.assert_allclose(again.place.position, placed.place.position, atol=1e-3 / prepared.scale.metres_per_unit)


@pytest.mark.parametrize("words", [["--xy", "-0.5,0.2"], ["--xy=-0.5,0.2"]])
def test_metres_may_be_negative(words: list[str]) -> None:
    options = parser().parse_args(["scene", "--model", "a.glb", "--plane", "0", *words, "--out", "out"])
    assert requests_of(options)[0].xy_m == (-0.5, 0.2)


def test_on_what_is_not_there_is_refused(prepared: PreparedScene, cup: Path) -> None:
    with pytest.raises(NoPlace, match=r"--on: expected a category of the instances \(.*couch.*\); found 'piano'"):
        place_objects(prepared, [ObjectRequest(cup, on="piano")])


def test_a_plane_and_metres_along_it(room: RecordedRoom, prepared: PreparedScene, cup: Path) -> None:
    """The lowest plane is the floor, and metres are metres whatever the scene's unit is."""
    one, other = (place_objects(prepared, [ObjectRequest(cup, plane=0, xy_m=(x, 0.0))])[0] for x in (0.0, 0.3))
    feet = _foot(room, one), _foot(room, other)
    assert feet[0][2] == pytest.approx(0.0, abs=0.02)
    assert np.linalg.norm(feet[1] - feet[0]) == pytest.approx(0.3, abs=0.005)


@pytest.mark.parametrize(("plane", "xy", "word"), [(99, (0.0, 0.0), "--plane"), (0, (50.0, 0.0), "--xy")])
def test_no_such_plane_or_point(
    prepared: PreparedScene, cup: Path, plane: int, xy: tuple[float, float], word: str
) -> None:
    with pytest.raises(NoPlace, match=word):
        place_objects(prepared, [ObjectRequest(cup, plane=plane, xy_m=xy)])


def test_facing_the_wall_is_square_to_the_room(room: RecordedRoom, prepared: PreparedScene, cup: Path) -> None:
    (placed,) = place_objects(prepared, [ObjectRequest(cup, plane=0, facing="wall")])
    front = room.to_scene.rotation.T @ placed.front
    # walls run along x and y; within ten degrees
    assert np.abs(front[:2]).max() > np.cos(np.radians(10))
    # its back is to the wall: the front looks into the room
    inward = -_foot(room, placed)[:2] / (np.array(KINDS[KIND].floor) / 2)
    axis = int(np.abs(front[:2]).argmax())
    assert front[axis] * inward[axis] > 0 or abs(inward[axis]) < 0.5


def test_the_size_of_the_prior(room: RecordedRoom, prepared: PreparedScene, cup: Path, tmp_path: Path) -> None:
    import metric_tree

    tree = metric_tree.open(release(tmp_path / "tree").directory)
    names = [node.name for node in tree.leaves() if "height" in (node.dims or ())]
    request = replace(ObjectRequest(cup, plane=0), size="prior", category=names[0])
    (placed,) = place_objects(prepared, [request], tree)
    median = float(tree.find(names[0]).prior(("height",)).quantile(0.5)[0]) / 1000
    assert placed.size_m["height"] == pytest.approx(median, rel=1e-6)
    high = np.ptp(placed.body.corners @ placed.body.basis[2]) * placed.body.unit
    assert high * prepared.scale.metres_per_unit == pytest.approx(median, rel=1e-6)
