"""Conditions of objects in numbers: frames of `--at`, paths, several objects, previews, requests of an insertion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import cv2
import numpy as np
import pytest

from estimator.records.result import ScaleResult
from estimator.records.scene import Instance
from insertion.footage.footage import Frame
from insertion.insert import insert
from insertion.placement.model_size import model_size
from insertion.placement.on_category import instances_named, placement_on_category
from insertion.placement.placed_object import PlacedObject, place_objects
from insertion.placement.placement import PlacementError
from insertion.placement.preview import _draw_ring, write_preview
from insertion.request import InsertionRequest, ObjectRequest, PixelPosition, SceneSource
from insertion.scene.scale import MetricScale, scale_of_result
from metric_base.errors import InputError
from metric_tree.tree import Tree
from models3d.model import Model
from tests.insertion.placement.test_placement_thresholds import ALONG_Y, columns, space, surface, view
from tests.synthetic.insertions import write_glb
from tests.synthetic.rooms.shapes import solid

FRAMES = [Frame(k, f"{k:03}.png", float(k), view((0, -5, 2), ALONG_Y) if k else None, None) for k in range(3)]
SCALE = MetricScale(1.0, None, None, "option")


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cube of 0.2 m."""
    return write_glb(solid("book", np.full(3, 0.2)), tmp_path_factory.mktemp("models") / "box.glb")


def place(*requests: ObjectRequest, side: int = 30) -> list[PlacedObject]:
    """Objects on a square surface of `side` cells of 0.1, seen from the front."""
    scene = space(np.array([[0.0, 5.0, 0.0]]), surface(shape=(side, side)), views=(view((0, -5, 2), ALONG_Y),))
    return place_objects(requests, scene, FRAMES)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("001.png", None), ("001", None), ("1", None), ("2", None),
        ("3", "an index from 0 to 2; found '3'"), ("01", None), ("a", "found 'a'"), ("0", "000.png has none"),
    ],
)  # fmt: skip
def test_a_frame_has_a_name_or_an_index(name: str, message: str | None, box: Path) -> None:
    request = ObjectRequest(box, at=PixelPosition(name, 320.0, 440.0))
    if message is None:
        assert place(request)[0].placement.support == "plane 0"
    else:
        with pytest.raises(PlacementError, match=message):
            place(request)


def test_an_error_names_the_object_if_there_are_several(box: Path) -> None:
    wrong = ObjectRequest(box, plane=7)
    with pytest.raises(PlacementError, match=r"^--plane"):
        place(wrong)
    with pytest.raises(PlacementError, match=r"^object 2 \(box.glb\): --plane"):
        place(ObjectRequest(box, plane=0), wrong)


def test_a_path_needs_a_position_and_no_wall(box: Path) -> None:
    path = ((0.5, 0.0),)
    with pytest.raises(InputError, match=r"--path: expected --at .* or --plane with it; found neither"):
        place(ObjectRequest(box, path=path))
    with pytest.raises(InputError, match="--facing: expected degrees from the direction of --path; found wall"):
        place(ObjectRequest(box, plane=0, path=path, facing="wall"))


@pytest.mark.parametrize(("end", "n_outside"), [(1.4, 0), (1.51, 1), (3.05, 11)])
def test_samples_of_a_path_outside_of_the_surface_are_counted(end: float, n_outside: int, box: Path) -> None:
    """21 positions from 0 to the end; the surface ends at 1.5."""
    (placed,) = place(ObjectRequest(box, plane=0, path=((end, 0.0),)))
    line = f"--path: {n_outside} of 21 sample points are outside the observed part of plane 0"
    assert [text for text in placed.warnings if "--path" in text] == ([line] if n_outside else [])


def test_an_object_walks_from_its_start_to_its_end(box: Path) -> None:
    (placed,) = place(ObjectRequest(box, plane=0, path=((1.0, 0.0),), speed_m_s=1.0, path_start_s=0.5))
    assert placed.moves
    x = [placed.body_at(time_s).position[0] for time_s in (0.0, 0.5, 1.0, 1.5, 2.0)]
    assert x == pytest.approx([0, 0, 0.5, 1, 1])
    (still,) = place(ObjectRequest(box, plane=0))
    assert not still.moves
    assert still.body_at(1.0) is still.body


def test_an_object_in_free_space_avoids_the_earlier_ones(box: Path) -> None:
    first, second = place(ObjectRequest(box), ObjectRequest(box))
    assert np.linalg.norm(first.placement.position - second.placement.position) > 0.2
    assert (first.warnings, second.warnings) == ((), ())
    fixed = ObjectRequest(box, plane=0)
    assert [one.warnings for one in place(fixed, replace(fixed, xy_m=(0.05, 0.0)))] == [
        (),
        ("box.glb: intersects box.glb",),
    ]
    assert [one.warnings for one in place(fixed, replace(fixed, xy_m=(0.5, 0.0)))] == [(), ()]


def test_a_preview_needs_a_free_position(tmp_path: Path) -> None:
    scene = space(np.array([[0.0, 5.0, 0.0]]), surface(shape=(30, 30)), views=(view((0, -5, 2), ALONG_Y),))
    images: Any = SimpleNamespace(rows=(0,), image=lambda _: np.zeros((480, 640, 3), np.uint8))
    with pytest.raises(PlacementError, match="--preview: no free level space of this size; try a smaller --size"):
        write_preview(scene, images, 5.0, 300.0, tmp_path / "a.png")
    assert not (tmp_path / "a.png").exists()
    positions = write_preview(scene, images, 0.1, 0.4, tmp_path / "a.png")
    assert all(one.in_image for one in positions)
    assert cv2.imread(str(tmp_path / "a.png")).any()


@pytest.mark.parametrize(("height", "is_above"), [(25, True), (26, False)])
def test_the_number_of_a_flat_ring_is_above_it(height: int, is_above: bool) -> None:
    image = np.zeros((480, 640, 3), np.uint8)
    corners = [(200, 300), (440, 300), (440, 300 + height), (200, 300 + height)]
    _draw_ring(image, np.array(corners, dtype=float), 1)
    assert image[270:290, 300:340].any() == is_above


def test_an_object_to_stand_on_has_points() -> None:
    scene = space(np.array([[0.0, 5.0, 0.0]]), surface())
    with pytest.raises(PlacementError, match="--on: the cloud has no points on any box"):
        placement_on_category(scene, "box", [columns(0, 0, 10)], 0.05, 0.3)


def test_categories_match_by_name_last_word_or_tree(mini: Tree) -> None:
    items = [Instance(str(k), 0, name, np.ones((2, 2), bool), (0, 0)) for k, name in enumerate(
        ("chair", "desk chair", "mouse", "unheard-of"))]  # fmt: skip

    def found(name: str, some: list[Instance] = items) -> list[str]:
        return [item.category for item in instances_named(some, name, mini)]

    assert found("Chair ") == ["chair"]
    assert found("chair", items[1:]) == ["desk chair"]
    assert found("furniture") == ["chair", "desk chair"]
    for name, some, names in (("unheard-of", [], "no instance at all"), ("trackball", items, "chair, desk chair")):
        with pytest.raises(PlacementError, match=f"--on: expected a category of the instances .{names}"):
            found(name, some)
    with pytest.raises(PlacementError, match="found 'qwertz'"):
        found("qwertz")


def test_a_prior_of_a_size_has_an_axis() -> None:
    """The height decides, else the length or width; sizes without a known axis are refused."""

    def tree_of(*dims: str) -> Tree:
        prior = SimpleNamespace(quantile=lambda _: np.array([500.0]))
        node = SimpleNamespace(node_id="a.n.01", dims=dims, prior=lambda _: prior, outer=lambda one: one)
        return cast(Tree, SimpleNamespace(find=lambda *_: node))

    model = cast(Model, SimpleNamespace(name="a", size_m={"length": 1.0, "width": 2.0, "height": 4.0}))
    factors = [model_size(model, "prior", tree_of(*dims), "a").factor for dims in (("length", "height"), ("width",))]
    assert factors == [0.125, 0.25]
    with pytest.raises(InputError, match=r"expected a category with a known height, length or width; found a.n.01"):
        model_size(model, "prior", tree_of("extent1"), "a")
    for tree, category in ((None, "a"), (tree_of("height"), None)):
        with pytest.raises(InputError, match="--size prior: expected --category NAME"):
            model_size(model, "prior", tree, category)


def test_a_result_without_a_scale_is_refused() -> None:
    interval = SimpleNamespace(low=0.4, high=0.6)
    result = SimpleNamespace(scale=0.5, interval=interval, status="resolved", of={"model": "a"})
    scale = scale_of_result(cast(ScaleResult, result))
    assert (scale.metres_per_unit, scale.low, scale.high, scale.source) == (0.5, 0.4, 0.6, "result")
    for name in ("scale", "interval"):
        with pytest.raises(InputError, match="expected a result that has a scale, found 'resolved'"):
            scale_of_result(cast(ScaleResult, SimpleNamespace(**{**vars(result), name: None})))


def test_a_request_has_an_object_and_for_outlines_an_interval(box: Path) -> None:
    source, known = SceneSource(folder=Path(), scale=SCALE), replace(SCALE, low=0.9, high=1.1)
    objects = (ObjectRequest(box),)
    with pytest.raises(InputError, match="--model: expected at least one object; found none"):
        InsertionRequest(scene=source, objects=())
    with pytest.raises(InputError, match="--show-interval: expected a scale with an interval"):
        InsertionRequest(scene=source, objects=objects, show_interval=True)
    InsertionRequest(scene=replace(source, scale=known), objects=objects, show_interval=True)


def test_an_insertion_has_an_output_and_cycles_no_motion(box: Path) -> None:
    request = InsertionRequest(scene=SceneSource(folder=Path(), scale=SCALE), objects=(ObjectRequest(box, plane=0),))
    with pytest.raises(InputError, match="--out: expected a video or a folder; found none"):
        insert(request, cast(Any, None))
    scene = space(np.array([[0.0, 5.0, 0.0]]), surface(shape=(30, 30)), views=(view((0, -5, 2), ALONG_Y),))
    opened: Any = SimpleNamespace(space=scene, footage=SimpleNamespace(frames=FRAMES))
    walks = (replace(request.objects[0], path=((1.0, 0.0),)),)
    with pytest.raises(InputError, match=r"--renderer blender: expected objects that stand still .* found box.glb"):
        insert(replace(request, out=Path("a"), objects=walks, renderer="blender"), opened)
