"""Every option of every command that names a path, from the parsers themselves: what may be replaced."""

from __future__ import annotations

import argparse
import os
import re
from pathlib import Path

import pytest

from metric_base.errors import InputError
from metric_base.files import whole_file
from metric_base.outputs import ANY_SCHEMA, is_own_output, set_rules
from metric_cli.arguments import OutputFile, check_paths, input_path, output_folder
from metric_cli.estimate_scale import options as estimate_scale
from metric_cli.insert_object import insert, study
from metric_cli.verbs import VERBS, parser_of

PARSERS = {
    "estimate-scale": estimate_scale.parser(),
    "insert-object": insert.parser(),
    "insert-object study": study._page_parser(),
    "insert-object study report": study._report_parser(),
    **{f"metric-tree {verb}": parser_of(verb) for verb in VERBS},
}
#: What a metavar says of an argument that may name a path.
NAMES_PATH = re.compile(r"FILE|DIR|PATH|OUT|SCENE|WORK|RAW|LIST|JSON|IMAGES")
#: Texts that name a file or something else; whatever of them exists is an input.
TEXTS = {None, str}
SUFFIXES = (".json", ".jsonl", ".png", ".jpg", ".svg", ".pdf", ".html", ".csv", ".md", ".mp4", ".mkv", ".glb", ".txt")


def _actions(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    """The arguments of a parser and of the verbs below it."""
    below = [action.choices for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    inner = [one for choices in below for sub in choices.values() for one in _actions(sub)]
    return [*parser._actions, *inner]


OUTPUTS = [(name, action) for name, parser in PARSERS.items() for action in parser._actions]
OUTPUTS = [(name, action) for name, action in OUTPUTS if isinstance(action.type, OutputFile)]


@pytest.mark.parametrize("name", PARSERS)
def test_every_argument_that_names_a_path_says_whether_it_is_read_or_written(name: str) -> None:
    for action in _actions(PARSERS[name]):
        says = isinstance(action.type, OutputFile) or action.type in {input_path, output_folder}
        assert says or action.type in TEXTS or not NAMES_PATH.search(str(action.metavar)), action
        assert action.type is not Path, action


def _check(name: str, action: argparse.Action, target: Path, source: Path, overwrite: bool = False) -> None:
    values: dict[str, object] = {one.dest: None for one in PARSERS[name]._actions}
    values |= {"overwrite": overwrite, action.dest: target}
    check_paths(PARSERS[name], argparse.Namespace(**values, anything_read=[source]))


@pytest.mark.parametrize(("name", "action"), OUTPUTS, ids=[f"{name} {action.dest}" for name, action in OUTPUTS])
def test_an_output_replaces_no_input_and_no_file_of_others(name: str, action: argparse.Action, tmp_path: Path) -> None:
    assert isinstance(action.type, OutputFile)
    scene = tmp_path / "scene"
    (scene / "images").mkdir(parents=True)
    for number, suffix in enumerate(SUFFIXES):
        source, other, own = scene / f"in{suffix}", tmp_path / f"other{suffix}", tmp_path / f"own{suffix}"
        picture, symbolic, hard = scene / "images" / f"a{suffix}", tmp_path / f"s{number}", tmp_path / f"h{suffix}"
        for file in (source, other, picture):
            file.write_text("a user's")
        symbolic.symlink_to(source)
        os.link(source, hard)
        for target in (source, other, picture, symbolic, hard):
            with pytest.raises(InputError, match="choose another name"):
                _check(name, action, target, source)
        for target in (source, symbolic, hard):
            with pytest.raises(InputError, match="is read in this run"):
                _check(name, action, target, source, overwrite=True)
        for target in (source, picture):  # part of a folder that is read
            with pytest.raises(InputError, match="is read in this run"):
                _check(name, action, target, scene, overwrite=True)
        _check(name, action, other, source, overwrite=True)
        _check(name, action, tmp_path / f"absent{suffix}", source)
        if suffix.startswith(".json"):
            schema = action.type.schema + ("x/1" if action.type.schema == ANY_SCHEMA else "1")
            own.write_text(f'{{"schema": "{schema}"}}')
            _check(name, action, own, source)
            own.write_text('{"schema": "metric-tree/objects/1"}')  # written by hand, as input
            if action.type.schema != ANY_SCHEMA:
                with pytest.raises(InputError, match="already exists"):
                    _check(name, action, own, source)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp"])
def test_a_stamped_picture_is_ours_and_the_same_picture(tmp_path: Path, suffix: str) -> None:
    from PIL import Image

    picture, file = Image.new("RGB", (7, 5), (200, 30, 60)), tmp_path / f"out{suffix}"
    with whole_file(file, "--figure") as work:
        picture.save(work, {".jpg": "JPEG", ".png": "PNG", ".webp": "WEBP"}[suffix])
    assert is_own_output(file)
    assert Image.open(file).getpixel((3, 2)) == pytest.approx((200, 30, 60), abs=6)
    plain = tmp_path / f"plain{suffix}"
    picture.save(plain)
    assert not is_own_output(plain)
    with whole_file(file, "--figure") as work:  # an own output may be written again
        picture.save(work, {".jpg": "JPEG", ".png": "PNG", ".webp": "WEBP"}[suffix])
    with pytest.raises(InputError, match="already exists"), whole_file(plain, "--figure") as work:
        work.write_bytes(b"")


@pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".webm"])
def test_a_stamped_video_is_ours_and_plays(tmp_path: Path, suffix: str) -> None:
    import av
    import numpy as np

    from insertion.footage.video_writer import VideoWriter

    file = tmp_path / f"out{suffix}"
    with whole_file(file, "--out") as work, VideoWriter(work, suffix) as video:
        for number in range(5):
            video.write(np.full((32, 32, 3), 40 * number, dtype=np.uint8), number / 10)
    assert is_own_output(file)
    with av.open(str(file)) as container:
        assert sum(1 for _ in container.decode(video=0)) == 5


def test_a_stamped_model_is_ours_and_the_same_model(tmp_path: Path) -> None:
    from insertion.models.gltf import read_model

    source = Path(__file__).resolve().parents[2] / "data" / "models" / "rocking_horse.glb"
    file = tmp_path / "out.glb"
    with whole_file(file, "--fix") as work:
        work.write_bytes(source.read_bytes())
    assert is_own_output(file)
    assert read_model(file).size_m == read_model(source).size_m


def test_buffers_and_videos_that_an_input_names_are_inputs(tmp_path: Path) -> None:
    (tmp_path / "chair.gltf").write_text('{"images": [{"uri": "wood.png"}], "buffers": [{"uri": "chair.bin"}]}')
    (tmp_path / "frames.json").write_text(f'{{"source": "{tmp_path / "film.mp4"}"}}')
    for name in ("wood.png", "film.mp4"):
        (tmp_path / name).write_text("a user's")
    parser, options = PARSERS["insert-object"], argparse.Namespace(overwrite=True, objects=None, scene=None)
    for name, source in (("wood.png", {"model": tmp_path / "chair.gltf"}), ("film.mp4", {"scene": tmp_path})):
        values = vars(options) | {"objects": [source], "preview": tmp_path / name, "out": None}
        with pytest.raises(InputError, match="is read in this run"):
            check_paths(parser, argparse.Namespace(**values))
    set_rules((), overwrite=False)
