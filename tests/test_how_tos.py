"""The commands of how-to pages run, with small files under the names that a page uses."""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.metric_cli.test_paths import _command
from tests.synthetic.insertions import write_glb
from tests.synthetic.rooms.solids import box

ROOT = Path(__file__).resolve().parents[1]
BLOCK = re.compile(r"^```(?:sh|console)\n(.*?)^```", re.MULTILINE | re.DOTALL)
PROGRAM = re.compile(r"(?:\$ )?(metric-tree|estimate-scale|insert-object) ")


def _scene(place: Path) -> None:
    (place / "SCENE").symlink_to(ROOT / "data" / "scenes" / "demo_room")
    (place / "pictures").symlink_to(ROOT / "data" / "scenes" / "demo_room" / "images")


def _models(place: Path) -> None:
    write_glb(box((-0.25, 0.25), (-0.25, 0.25), (0, 0.9), "wood"), place / "chair.glb")
    (place / "props").mkdir()
    for name in ("props/chair.glb", "generated.glb"):
        shutil.copy(place / "chair.glb", place / name)
    (place / "mesh.obj").write_text("v 0 0 0\nv 0.6 0 0\nv 0.6 1.1 0.6\nf 1 2 3\n")


#: Pages, what they need, and the exit statuses of their commands: `check-asset` ends with 3 for a wrong model.
RUNS: dict[str, tuple[Callable[[Path], None], set[int]]] = {
    "check-a-model": (_models, {0, 3}),
    "evidence": (_scene, {0}),
    "releases": (lambda _: None, {0}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_the_commands_of_a_how_to_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    prepare, statuses = RUNS[name]
    prepare(tmp_path)
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "how-to" / f"{name}.md").read_text(encoding="utf-8")
    lines = [line for block in BLOCK.findall(page) for line in block.splitlines() if PROGRAM.match(line)]
    assert lines
    for line in lines:
        words = shlex.split(line.removeprefix("$ ").partition(" >")[0], comments=True)
        verb = 2 if words[0] == "metric-tree" else 1
        status = _command(" ".join(words[:verb]))(words[verb:])
        assert status in (statuses | {1} if "--fail-over" in line else statuses), line
