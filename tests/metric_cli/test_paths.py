"""Every option of every command that names a path, from the parsers themselves: what may be replaced."""

from __future__ import annotations

import argparse
import gzip
import json
import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks.user_study import make
from metric_base.errors import InputError
from metric_base.files import check_output, has_schema, set_rules, whole_file
from metric_cli.estimate_scale import parser as estimate_scale
from metric_cli.insert_object import insert
from metric_cli.insert_object.parser import parser as insert_object_parser
from metric_cli.parser import (
    OutputFile,
    arguments_of,
    check_paths,
    input_path,
    new_folder,
    output_folder,
    streamed_path,
)
from metric_cli.subcommands import SUBCOMMANDS, parser_of
from tests.synthetic import minitree
from tests.synthetic.raw_fixture import synthetic_items, written
from tests.synthetic.small_scene import write_small_scene

PARSERS = {
    "estimate-scale": estimate_scale.parser(),
    "insert-object": insert_object_parser(),
    "python -m benchmarks.user_study": make.page_parser(),
    "python -m benchmarks.user_study report": make.report_parser(),
    **{f"metric-tree {subcommand}": parser_of(subcommand) for subcommand in SUBCOMMANDS},
}
#: Metavars of arguments that may name a path.
NAMES_PATH = re.compile(r"FILE|DIR|PATH|OUT|SCENE|WORK|RAW|LIST|JSON|IMAGES")
#: Types of arguments that may name a file; existing files are inputs.
TEXTS = {None, str}


WRITTEN = [
    (name, action)
    for name, parser in PARSERS.items()
    for action in arguments_of(parser)
    if isinstance(action.type, OutputFile) or action.type in {new_folder, output_folder}
]
#: The words of a small run of each command, and of some options in separate runs: every path is in the folder.
RUNS = {
    "estimate-scale": "--objects objects.json",
    "estimate-scale --overlay": "scene --images scene/images",
    "estimate-scale --write-scaled": "scene",
    "estimate-scale --work": "photos --frames 2",
    "insert-object": "scene --model chair.gltf --scale 0.3 --out absent.mp4",
    "python -m benchmarks.user_study": "scene --model chair.gltf --scale 0.3 --out absent.html",
    "python -m benchmarks.user_study report": "answers.json",
    "metric-tree query": "rat --tree mini",
    "metric-tree crawl": "generic --out absent --start-url http://127.0.0.1:9/ --contact me@example.org --delay 0",
    "metric-tree import": "table --sources declared --input table.csv",
    "metric-tree extract": "products.nq",
    "metric-tree build": "raw.jsonl --workers 1 --no-heldout --without-curated --out absent",
    "metric-tree review --folder": "record *:~chair chair.n.01 --reviewer me",
    "metric-tree report": "mini",
    "metric-tree check-asset": "chair.gltf --category chair --tree mini",
    "metric-tree true-size": "chair.gltf --category chair --tree mini",
    "metric-tree select": "--tree mini",
    "metric-tree render": "raw.jsonl --models models --out absent",
    "metric-tree cutout": "mini --out absent",
    "metric-tree export": "--tree mini --out absent",
    "metric-tree priors": "--tree mini",
    "metric-tree site": "--tree mini --workers 1",
    "metric-tree publish": "--tree mini",
}
#: Suffix of an output whose command checks it; `.json` for others.
ENDINGS = {
    "FILE.png": ".png", "FILE.html": ".html", "FILE.csv": ".csv", "FILE.md": ".md", "FILE.jsonl": ".jsonl",
    "--figure": ".svg", "--preview": ".png", "--parquet": ".parquet", "--fix": ".gltf", "metric-tree report": ".html",
    "python -m benchmarks.user_study": ".html", "insert-object": ".mp4", "metric-tree true-size": ".gltf",
}  # fmt: skip
#: What commands keep in folders, here of somebody else.
KEPT = (
    "frames/a.jpg", "frames.json", "sparse/0/images.bin", "instances.json", "result.json", "drawing.json",
    "cautions.json",
    "stamps/frames.json", "databases/features.db", "items-000000001-000000002.jsonl", "frontier.sqlite",
    "pictures/a.png", "pictures-000001-000001.jsonl", "quarantine.jsonl", "report.json", "work/a.pickle",
    "table.jsonl.gz", "recorded.jsonl", "index.html",
)  # fmt: skip
TRIED: Counter[str] = Counter()


def command_of(name: str) -> Callable[[list[str]], int]:
    from metric_cli.estimate_scale.estimate import main as estimate_main
    from metric_cli.subcommands import main as tree_main

    if name.startswith("python -m benchmarks.user_study"):
        words = name.split()[3:]
        return lambda more: make.main([*words, *more])
    program, *subcommand = name.split()
    if subcommand == ["crawl"]:  # a reactor runs once in a process
        code = "import sys; from metric_cli.subcommands import main; sys.exit(main(sys.argv[1:]))"
        return lambda words: (
            subprocess.run([sys.executable, "-c", code, *subcommand, *words], check=False, timeout=300).returncode
        )
    main = {"estimate-scale": estimate_main, "insert-object": insert.main, "metric-tree": tree_main}[program]
    return lambda words: main([*subcommand, *words])


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a small input of every kind."""
    place = tmp_path_factory.mktemp("inputs")
    write_small_scene(place / "forms")
    (place / "forms" / "colmap").rename(place / "scene")
    shutil.rmtree(place / "forms")
    for folder in ("scene/images", "photos", "models", "declared"):
        (place / folder).mkdir()
    for file in ("scene/images/a.jpg", "photos/a.jpg", "photos/b.jpg"):
        Image.effect_noise((64, 48), 90).save(place / file)
    minitree.release(place / "mini")
    written(place / "raw.jsonl", synthetic_items(3))
    triangle = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.5]], dtype="<f4")
    (place / "chair.bin").write_bytes(triangle.tobytes())
    accessor = {
        "bufferView": 0,
        "componentType": 5126,
        "count": 3,
        "type": "VEC3",
        "min": [0, 0, 0],
        "max": [1, 1, 0.5],
    }
    model = {
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "scene": 0, "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "accessors": [accessor],
        "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"uri": "chair.bin", "byteLength": 36}],
    }  # fmt: skip
    (place / "chair.gltf").write_text(json.dumps(model))
    size = {"length": 0.5, "width": 0.5, "height": 0.9}
    item = {"id": "1", "category": "chair", "dimensions": size}
    (place / "objects.json").write_text(json.dumps({"schema": "metric-tree/objects/1", "objects": [item]}))
    (place / "answers.json").write_text("{}")
    (place / "products.nq").write_text("# no product\n")
    (place / "declared" / "table.toml").write_text(DECLARATION)
    (place / "table.csv").write_text("no,w\n1,10\n")
    return place


DECLARATION = """
id = "table"
title = "Made table"
url = "https://example.org/table"
licence = "CC0-1.0"
licence_basis = "made for a test"
kind = "measured"
ship = true
[[tables]]
files = ["*.csv"]
unit = "cm"
id = "{no}"
category = ["box"]
axes = { width = "w" }
"""


def _state(place: Path) -> dict[str, str]:
    """Type and content of each file below a folder."""
    return {
        str(path.relative_to(place)): str(path.readlink())
        if path.is_symlink()
        else sha256(path.read_bytes()).hexdigest()
        if path.is_file()
        else "folder"
        for path in sorted(place.rglob("*"))
    }


def _words(name: str, action: argparse.Action) -> list[str]:
    own = f"{name} {action.option_strings[0]}" if action.option_strings else name
    return [word.replace("~", " ") for word in RUNS.get(own, RUNS.get(name, "absent")).split()]


@dataclass
class _Walk:
    """The runs of one option of one command, in the folder `place`, which is the working folder."""

    command: Callable[[list[str]], int]
    words: list[str]
    option: list[str]
    place: Path

    def status(self, target: str, kind: str, *more: str) -> int:
        """The exit status with a target; nothing else may have changed, and nothing appear where it was refused."""
        before = _state(self.place)
        status = self.command([*self.words, *self.option, target, *more])
        after = _state(self.place)
        changed = {
            file for file, state in before.items() if after.get(file) != state and file.partition("/")[0] != "absent"
        }
        assert changed <= ({target} if kind == "own" or more else set()), (target, kind)
        assert status != 2 or kind == "kept" or set(after) <= set(before), (target, kind, set(after) - set(before))
        TRIED[kind] += 1
        return status

    def files(self) -> list[str]:
        """The files that the words name, those in folders too."""
        named = [word for word in self.words if Path(word).exists()]
        found = [str(file) for word in named for file in (Path(word), *sorted(Path(word).rglob("*"))) if file.is_file()]
        return found + (["chair.bin"] if "chair.gltf" in named else [])

    def try_file(self, ending: str) -> None:
        """An option that names a file."""
        refused = [(file, "input") for file in self.files()] + [("symbolic", "link")]
        # a second name of a file in a folder that is read may go: the file stays
        refused += [(f"hard{ending}", "link")] if any(Path(word).is_file() for word in self.words) else []
        for target, kind in refused:
            assert self.status(target, kind) == 2, target
            assert self.status(target, kind, "--overwrite") == 2, target
        assert self.status(f"other{ending}", "other") == 2
        self.status(f"other{ending}", "other", "--overwrite")
        self.status("others", "folder of others")
        status = self.status(f"own{ending}", "absent")
        if status in {0, 3} and Path(f"own{ending}").is_file():
            assert self.status(f"own{ending}", "own", "--overwrite") == status

    def try_folder(self, ending: str, new: bool) -> None:
        """An option that names a folder, which must be new or may be kept."""
        targets = ["others", "linked", *(word for word in self.words if new and Path(word).is_dir())]
        for target in targets:
            status = self.status(target, "folder of others" if new else "kept")
            assert status == 2 or not new, target
        for target in (f"other{ending}", *self.files()[: 3 * new]):
            assert self.status(target, "other") == 2, target


@pytest.mark.parametrize(
    ("name", "action"), WRITTEN, ids=["-".join([name.replace(" ", "-"), one.dest]) for name, one in WRITTEN]
)
def test_a_whole_command_replaces_no_input_and_no_file_of_others(
    name: str, action: argparse.Action, inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Inputs, links to them, and existing files and folders stay as they are; `--overwrite` replaces an output."""
    place = tmp_path / "run"
    shutil.copytree(inputs, place)
    monkeypatch.chdir(place)
    monkeypatch.setenv("METRIC_TREE_CACHE", str(tmp_path / "cache"))
    walk = _Walk(command_of(name), _words(name, action), action.option_strings[:1], place)
    keys = [*walk.option, str(action.metavar), name]
    ending = next((ENDINGS[key] for key in keys if key in ENDINGS), ".json")
    source = next(iter(walk.files()), "objects.json")
    Path("symbolic").symlink_to(source)
    os.link(source, f"hard{ending}")
    Path("linked").symlink_to("others")
    for file in (f"other{ending}", *(f"others/{file}" for file in KEPT)):
        (place / file).parent.mkdir(parents=True, exist_ok=True)
        (place / file).write_text("a user's")
    if isinstance(action.type, OutputFile):
        walk.try_file(ending)
    else:
        walk.try_folder(ending, action.type is new_folder)


def test_the_walk_over_paths_is_counted(capsys: pytest.CaptureFixture[str]) -> None:
    """`pytest -s` prints the count; every command that writes has a line."""
    missing = {name for name, _ in WRITTEN} - {key.partition(" --")[0] for key in RUNS}
    assert not missing
    with capsys.disabled():
        sys.stdout.write(f"\n{len(WRITTEN)} options that name outputs, {sum(TRIED.values())} runs: {dict(TRIED)}\n")


@pytest.mark.parametrize("name", PARSERS)
def test_every_argument_that_names_a_path_says_whether_it_is_read_or_written(name: str) -> None:
    for action in arguments_of(PARSERS[name]):
        says = isinstance(action.type, OutputFile) or action.type in {
            input_path,
            streamed_path,
            new_folder,
            output_folder,
        }
        assert says or action.type in TEXTS or not NAMES_PATH.search(str(action.metavar)), action
        assert action.type is not Path, action


def test_an_existing_output_is_replaced_with_overwrite_only(tmp_path: Path) -> None:
    file = tmp_path / "out.png"
    for is_allowed in (True, False):
        set_rules((), overwrite=is_allowed)
        file.write_text("before")
        if is_allowed:
            with whole_file(file, "--figure") as work:
                work.write_text("after")
        else:
            with pytest.raises(InputError, match="already exists"), whole_file(file, "--figure") as work:
                work.write_text("after")
        assert file.read_text() == ("after" if is_allowed else "before")


@pytest.mark.parametrize("suffix", [".json", ".jsonl.gz"])
def test_a_command_continues_a_file_of_its_schema(tmp_path: Path, suffix: str) -> None:
    set_rules((), overwrite=False)
    file = tmp_path / f"out{suffix}"
    for schema, is_allowed in (("metric-tree/asset/1", True), ("metric-tree/scale/1", False)):
        text = json.dumps({"schema": schema}).encode()
        file.write_bytes(gzip.compress(text) if suffix.endswith(".gz") else text)
        assert has_schema(file, "metric-tree/asset/") is is_allowed
        if is_allowed:
            check_output(file, "--out", "metric-tree/asset/")
        else:
            with pytest.raises(InputError, match="already exists"):
                check_output(file, "--out", "metric-tree/asset/")


def test_files_of_an_input_folder_are_inputs(tmp_path: Path) -> None:
    scene = tmp_path / "scene"
    (scene / "images").mkdir(parents=True)
    names = {"images/a.png": True, "points.ply": True, "instances.json": True, "figure.png": False, "page.html": False}
    set_rules((scene,), overwrite=True)
    for name, is_input in names.items():
        (scene / name).write_text("")
        if is_input:
            with pytest.raises(InputError, match="is read in this run"):
                check_output(scene / name, "--out")
        else:
            check_output(scene / name, "--out")
    set_rules((), overwrite=False)


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
