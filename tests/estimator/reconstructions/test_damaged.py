"""Damaged input: one line, quickly, and nothing but that line."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from estimator.instances.instance_reader import read_instances_and_warnings
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.scene import Instance, Scene
from metric_base.errors import InputError
from metric_cli.estimate_scale.estimate import main
from tests.support.damaged import CASES, MAX_SECONDS, Case, outcome
from tests.synthetic import minitree
from tests.synthetic.small_scene import write_small_scene

FORMS = ("colmap", "text", "opensfm")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("small") / "whole"
    write_small_scene(folder)
    return folder


@pytest.fixture(scope="module")
def warm(small: Path) -> Path:
    """Every form read once, so that no case is charged with an import."""
    for form in FORMS:
        read_instances_and_warnings(read_scene(small / form))
    return small


@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_one_line_within_a_second_of_the_processor(case: Case, warm: Path, tmp_path: Path) -> None:
    shutil.copytree(warm, tmp_path / "copy")
    result = outcome(case, tmp_path / "copy")
    assert result.error is None
    assert result.message is not None
    assert "\n" not in result.message
    assert "expected" in result.message
    assert "found" in result.message
    assert str(tmp_path) in result.message, "the file is named"
    assert len(result.message) < 400  # one line
    assert result.seconds < MAX_SECONDS
    assert result.peak_bytes < 30e6


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return minitree.release(tmp_path_factory.mktemp("tree") / "mini").directory


@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_the_command_answers_with_the_same_line_and_exit_2(
    case: Case, warm: Path, tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(warm, tmp_path / "copy")
    message = outcome(case, tmp_path / "copy").message
    folder = tmp_path / "copy" / case.form
    instances = [] if case.instances is None else ["--instances", str(folder / case.instances)]
    written = ["--output", str(tmp_path / "result.json"), "--write-scaled", str(tmp_path / "metric")]
    status = main([str(folder), "--tree", str(tree), *instances, *written])
    captured = capsys.readouterr()
    assert status == 2
    if case.name in {"instances: missing", "pictures: no names"}:  # the command also offers masks and other evidence
        assert captured.err.startswith(f"estimate-scale: {message.partition(': expected ')[0]}: expected masks by ")
        assert captured.err.count("\n") == 1
    else:
        assert captured.err == f"estimate-scale: {message}\n"
    assert captured.out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["copy"], "nothing is written"


def test_kinds_are_many_and_apart() -> None:
    assert len({case.name for case in CASES}) == len(CASES) >= 30


def files_of(folder: Path, form: str) -> list[str]:
    return sorted(str(file.relative_to(folder / form)) for file in (folder / form).rglob("*") if file.is_file())


def check_whole(scene: Scene, instances: tuple[Instance, ...]) -> None:
    """Invariants that the rest of the program requires."""
    assert scene.views
    for instance in instances:
        camera = scene.views[instance.view].camera
        height, width = instance.mask.shape
        x, y = instance.origin
        assert instance.mask.any()
        assert x >= 0
        assert y >= 0
        assert x + width <= camera.width
        assert y + height <= camera.height


def message_of(folder: Path) -> str:
    """The error of a scene, or nothing where it was read and is whole; every other exception goes through."""
    try:
        scene = read_scene(folder)
        check_whole(scene, read_instances_and_warnings(scene)[0])
    except InputError as bad:
        return str(bad)
    return ""


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_flipped_bytes_give_a_scene_or_one_line(data: st.DataObject, warm: Path, tmp_path: Path) -> None:
    form = data.draw(st.sampled_from(FORMS))
    name = data.draw(st.sampled_from(files_of(warm, form)))
    copy = tmp_path / form
    if not copy.exists():
        shutil.copytree(warm / form, copy)
    content = bytearray((warm / form / name).read_bytes())
    flips = st.lists(st.tuples(st.integers(0, len(content) - 1), st.integers(0, 255)), min_size=1, max_size=4)
    for place, value in data.draw(flips):
        content[place] = value
    (copy / name).write_bytes(content)
    message = message_of(copy)
    (copy / name).write_bytes((warm / form / name).read_bytes())
    assert "\n" not in message


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_truncation_gives_a_scene_or_one_line(data: st.DataObject, warm: Path, tmp_path: Path) -> None:
    form = data.draw(st.sampled_from(FORMS))
    name = data.draw(st.sampled_from(files_of(warm, form)))
    copy = tmp_path / form
    if not copy.exists():
        shutil.copytree(warm / form, copy)
    content = (warm / form / name).read_bytes()
    (copy / name).write_bytes(content[: data.draw(st.integers(0, len(content) - 1))])
    message = message_of(copy)
    (copy / name).write_bytes(content)
    assert "\n" not in message


ODD_VALUES = (None, True, "x", "", -1, 0, 10**30, 1e308, float("nan"), float("inf"), [], {}, [[]], [None], {"id": {}})


def paths_in(document: object, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """The way to every value of a JSON document but its root."""
    items = (
        document.items() if isinstance(document, dict) else enumerate(document) if isinstance(document, list) else ()
    )
    found: list[tuple[str | int, ...]] = []
    for key, value in items:
        found += [(*path, key), *paths_in(value, (*path, key))]
    return found


JSON_FILES = ("colmap/instances.json", "opensfm/reconstruction.json", "opensfm/instances/categories.json")


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_odd_values_in_json_give_a_scene_or_one_line(data: st.DataObject, warm: Path, tmp_path: Path) -> None:
    name = data.draw(st.sampled_from(JSON_FILES))
    form = name.split("/")[0]
    if not (tmp_path / form).exists():
        shutil.copytree(warm / form, tmp_path / form)
    document = json.loads((warm / name).read_text(encoding="utf-8"))
    *way, last = data.draw(st.sampled_from(paths_in(document)))
    place = document
    for key in way:
        place = place[key]
    place[last] = data.draw(st.sampled_from(ODD_VALUES))
    (tmp_path / name).write_text(json.dumps(document), encoding="utf-8")
    message = message_of(tmp_path / form)
    shutil.copyfile(warm / name, tmp_path / name)
    assert "\n" not in message
