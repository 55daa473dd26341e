"""A result is used with the model and the masks that it is of, and with no others."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from estimator.instances.instance_reader import read_instances
from estimator.outputs.rescaled import write_rescaled
from estimator.reconstructions.scene_reader import read_scene
from insertion.insertion_scene import open_scene
from insertion.request import SceneSource
from insertion.scene.scale import read_scale
from metric_base.errors import InputError
from metric_cli.estimate_scale.estimate import main

DEMO = Path(__file__).resolve().parents[2] / "data" / "scenes" / "demo_room"


@pytest.fixture(scope="module")
def estimated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scene") / "room"
    shutil.copytree(DEMO, folder)
    assert main([str(folder), "--output", str(folder / "result.json"), "--quiet"]) == 0
    return folder


def test_a_result_states_what_it_is_of(estimated: Path, tmp_path: Path) -> None:
    of = json.loads((estimated / "result.json").read_text())["of"]
    assert of["masks_from"] == "scene"
    assert all(len(of[name]) == 64 for name in ("model", "masks", "options"))
    open_scene(SceneSource(folder=estimated, scale=read_scale(estimated, None)))
    for name, words in (("level", ["--level", "0.8"]), ("same", [])):
        file = tmp_path / f"{name}.json"
        assert main([str(estimated), "--output", str(file), "--quiet", *words]) == 0
        other = json.loads(file.read_text())["of"]
        assert (other["options"] == of["options"]) == (name == "same")
        assert (other["model"], other["masks"]) == (of["model"], of["masks"])


def _other_masks(folder: Path) -> None:
    """As a run that was killed between its masks and its answer leaves them."""
    document = json.loads((folder / "instances.json").read_text())
    document["annotations"].pop()
    (folder / "instances.json").write_text(json.dumps(document))


def _other_model(folder: Path) -> None:
    write_rescaled(read_scene(folder), 1.25, folder / "metric")
    shutil.rmtree(folder / "sparse")
    shutil.move(folder / "metric" / "sparse", folder / "sparse")


@pytest.mark.parametrize(("change", "what"), [(_other_masks, "of.masks"), (_other_model, "of.model")])
def test_a_result_of_something_else_is_refused(change, what: str, estimated: Path, tmp_path: Path) -> None:
    folder = tmp_path / "room"
    shutil.copytree(estimated, folder)
    change(folder)
    for stated in (None, estimated / "result.json"):
        with pytest.raises(InputError, match=what):
            open_scene(SceneSource(folder=folder, scale=read_scale(folder, stated)))
    open_scene(SceneSource(folder=folder, scale=read_scale(folder, 0.3)))  # a number is the user's own word


def test_masks_drawn_for_the_scene_are_found_next_to_it(estimated: Path, tmp_path: Path) -> None:
    """As `estimate-scale` does, which writes them to `SCENE.metric-tree`."""
    folder = tmp_path / "room"
    shutil.copytree(estimated, folder)
    (tmp_path / "room.metric-tree").mkdir()
    (folder / "instances.json").rename(tmp_path / "room.metric-tree" / "instances.json")
    source = SceneSource(folder=folder, scale=read_scale(folder, 0.3))
    masks = open_scene(source).space.instances
    assert len(masks) == len(read_instances(DEMO / "instances.json", read_scene(folder)))
    (tmp_path / "room.metric-tree" / "instances.json").unlink()
    assert open_scene(source).space.instances == ()


def test_a_folder_that_was_exchanged_is_not_written_at_scale(estimated: Path, tmp_path: Path) -> None:
    scene = read_scene(estimated)
    read_instances(None, scene)
    earlier = replace(scene, points=scene.points * 1.1)
    with pytest.raises(InputError, match="exchanged since it was read"):
        write_rescaled(earlier, 0.3, tmp_path / "metric")
    assert not list(tmp_path.iterdir())


def test_a_result_that_does_not_say_what_it_is_of_is_used_with_a_warning(estimated: Path, tmp_path: Path) -> None:
    record = json.loads((estimated / "result.json").read_text())
    assert read_scale(estimated, None).warnings() == ()
    assert read_scale(estimated, 0.3).warnings() == ()
    old = tmp_path / "old.json"
    old.write_text(json.dumps({name: value for name, value in record.items() if name != "of"}))
    (line,) = read_scale(estimated, old).warnings()
    assert "old.json does not record its model" in line
