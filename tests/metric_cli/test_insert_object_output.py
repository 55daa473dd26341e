"""Lines that `insert-object` prints for its objects."""

from __future__ import annotations

import json
from argparse import Namespace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from insertion.placement.preview import FreePosition
from insertion.request import InsertionRequest, ObjectRequest, PixelPosition, SceneSource
from insertion.result import FrameReport, InsertionResult
from insertion.scene.scale import MetricScale
from metric_cli.insert_object.insert import command_line, run


@pytest.mark.parametrize(
    ("low", "ending"),
    [
        (None, "0.5 metres per unit, stated without an interval; in 2 of 3 frames"),
        (0.4, "the error of the scale, and of the height in the image, is -20% to +20%; in 2 of 3 frames"),
    ],
)
def test_an_object_has_its_size_scale_and_number_of_frames(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], low: float | None, ending: str
) -> None:
    frames = tuple(FrameReport(f"{k}.png", None, box, 1.0) for k, box in enumerate([(0, 0, 9, 9), None, (1, 1, 2, 2)]))
    scale = MetricScale(0.5, low, None if low is None else 0.6, "option")
    size_m = {"length": 1.0, "width": 0.5, "height": 0.25}
    result = InsertionResult("a.glb", scale, size_m, np.zeros(3), np.ones(3), 0.0, "plane 0", frames, {}, ("dark",))
    inserted = SimpleNamespace(warnings=("blurred",), objects=(result,))
    monkeypatch.setattr("insertion.insert.insert", lambda *_: inserted)
    monkeypatch.setattr("insertion.insertion_scene.open_scene", lambda _: None)
    request = cast(InsertionRequest, SimpleNamespace(scene=None, out=Path("out")))
    assert run(Namespace(json=False, preview=None, place=None), request, ()) == 0
    out, err = capsys.readouterr()
    assert out.startswith("a.glb: 1 x 0.5 x 0.25 m (length, width, height) on plane 0; 0.5 metres per unit")
    assert out.endswith(f"{ending}\n")
    assert err.splitlines() == ["insert-object: warning: blurred", "insert-object: warning: dark"]


def test_the_command_with_the_chosen_position_has_no_other_position() -> None:
    request = ObjectRequest(Path("a.glb"), at=PixelPosition("3", 1.0, 2.0), facing=90.0)
    argv = ["scene", "--place", "8000", "--model", "a.glb", "--on=couch", "--xy", "1,2"]
    line = "insert-object scene --model a.glb --at frame=3,x=1.0,y=2.0 --facing 90"
    assert command_line([request], argv, has_out=True) == line
    assert command_line([request], ["scene", "--place", "--model", "a.glb"], has_out=False) == f"{line} --out OUT.mp4"


@pytest.mark.parametrize(("as_json", "has_out"), [(True, False), (False, False), (True, True), (False, True)])
def test_free_positions_are_the_output_if_there_is_no_other(
    as_json: bool, has_out: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    places = [FreePosition(0, 1, (0.5, -0.25), 0.75, True), FreePosition(1, 0, (0.0, 0.0), -0.001, False)]
    monkeypatch.setattr("insertion.placement.preview.write_preview", lambda *_: places)
    monkeypatch.setattr("insertion.placement.placed_object.footprint", lambda *_: (0.1, 0.2))
    monkeypatch.setattr("insertion.placement.model_size.model_size", lambda *_: None)
    monkeypatch.setattr("models3d.gltf.model_reader.read_model", lambda _: None)
    scene = SimpleNamespace(scale=SimpleNamespace(metres_per_unit=1.0), space=None, images=None)
    monkeypatch.setattr("insertion.insertion_scene.open_scene", lambda _: scene)
    monkeypatch.setattr("insertion.insert.insert", lambda *_: SimpleNamespace(warnings=(), objects=()))
    monkeypatch.setattr("metric_cli.insert_object.insert._print", lambda *_: None)
    objects = (ObjectRequest(Path("a.glb")),)
    out = Path("out") if has_out else None
    request = cast(InsertionRequest, SimpleNamespace(scene=None, out=out, objects=objects, tree=None))
    assert run(Namespace(json=as_json, preview=Path("a.png"), place=None), request, ()) == 0
    captured = capsys.readouterr()
    lines = (captured.err if has_out else captured.out).splitlines()
    if as_json and not has_out:
        record = json.loads(captured.out)
        assert record["schema"] == "metric-tree/places/1"
        assert [place["in_image"] for place in record["places"]] == [True, False]
        return
    assert lines == [
        "0: --plane 1 --xy 0.500,-0.250   0.75 m above the lowest plane",
        "1: --plane 0 --xy 0.000,0.000   0.00 m above the lowest plane; not in the image",
    ]
    assert (captured.out if has_out else captured.err) == ""


@pytest.mark.parametrize(("as_json", "has_out"), [(False, True), (True, True), (False, False)])
def test_the_placement_page_prints_its_command_and_the_objects_are_inserted(
    as_json: bool, has_out: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    chosen = (ObjectRequest(Path("a.glb"), at=PixelPosition("3", 1.0, 2.0), facing=90.0),)
    page = SimpleNamespace(url="http://here", serve=lambda: None, chosen=chosen)
    monkeypatch.setattr("insertion.placement_page.PlacementPage", lambda *_: page)
    monkeypatch.setattr("insertion.insertion_scene.open_scene", lambda _: None)
    inserted: list[object] = []

    def insert(request: InsertionRequest, *_: object) -> object:
        inserted.append(request.objects)
        return SimpleNamespace(warnings=(), objects=())

    monkeypatch.setattr("insertion.insert.insert", insert)
    monkeypatch.setattr("metric_cli.insert_object.insert._print", lambda *_: None)
    source = SceneSource(folder=Path(), scale=MetricScale(1.0, None, None, "option"))
    out = Path("out") if has_out else None
    request = InsertionRequest(scene=source, objects=(ObjectRequest(Path("a.glb")),), out=out)
    words = ["scene", "--model", "a.glb", "--place"]
    assert run(Namespace(json=as_json, preview=None, place=0), request, words) == 0
    captured = capsys.readouterr()
    assert "place the object on this page: http://here" in captured.err
    assert captured.out.startswith("insert-object scene --model a.glb --at frame=3") != as_json
    assert inserted == [chosen] * has_out
