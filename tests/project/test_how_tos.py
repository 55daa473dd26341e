"""The commands of the how-to pages run, with small files in folder of the files that a page names."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from starlette.testclient import TestClient

import metric_tree
from benchmarks.user_study.answers import ANSWERS_SCHEMA
from explorer.server.app import application
from metric_cli.estimate_scale.estimate import main as estimate_scale
from tests.metric_cli.test_paths import command_of
from tests.synthetic.insertions import write_glb
from tests.synthetic.minitree import release
from tests.synthetic.rooms.solids import box

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```(?:sh|console)\n(.*?)^```", re.MULTILINE | re.DOTALL)
PROGRAM = re.compile(r"(?:\$ )?(metric-tree|estimate-scale|insert-object) ")
ADDRESS = re.compile(r"^curl .*?http://127\.0\.0\.1:8000([^'\s]*)", re.MULTILINE)
#: Replacements of commands that are slow (a reconstruction, which the test of another page runs; the site of the
#: shipped release), that depend on the user's files, or that do not end (a server).
REPLACEMENTS = {
    r"^estimate-scale (video\.mp4|data/scenes/walk_carpark/video\.mp4|data/scenes/lund_street).*": "",
    r"^insert-object walk .*": "",
    "frame=12,x=640,y=500": "frame=1,x=320,y=400",
    r"^metric-tree site out/site +#": "metric-tree site out/site --tree 2.0.0 #",
    r"^metric-tree build .*": "",
    r"^metric-tree validate releases/mine": "metric-tree validate",
    r"^metric-tree site OUT .*": "",
    r"--tree (\d)": r"--tree releases/\1",
    r"^metric-tree serve .*": "",
}


def _scene(folder: Path) -> None:
    (folder / "data").symlink_to(ROOT / "data")
    (folder / "SCENE").symlink_to(ROOT / "data" / "scenes" / "demo_room")
    (folder / "pictures").symlink_to(ROOT / "data" / "scenes" / "demo_room" / "images")


def _insertions(folder: Path) -> None:
    """Write two views of the demo room with its scale (scene and work folder), models, and answers of a participant."""
    import pycolmap

    work = folder / "work"
    shutil.copytree(ROOT / "data" / "scenes" / "demo_room", work)
    (model,) = {path.parent for path in work.rglob("images.bin")}
    reconstruction = pycolmap.Reconstruction(str(model))
    for image in sorted(reconstruction.images.values(), key=lambda image: image.name)[2:]:
        reconstruction.deregister_frame(image.frame_id)
    reconstruction.write(str(model))
    (folder / "SCENE").symlink_to(work)
    assert estimate_scale([str(work), "--output", str(work / "result.json"), "--quiet"]) == 0
    write_glb(box((-0.25, 0.25), (-0.25, 0.25), (0, 0.9), "wood"), folder / "chair.glb")
    write_glb(box((-0.02, 0.02), (-0.02, 0.02), (0, 0.05), "wood"), folder / "cushion.glb")
    rows = [{"step": step, "answer": answer} for step, answer in ((-30, "too small"), (0, "right"), (30, "too large"))]
    answers = {"schema": ANSWERS_SCHEMA, "participant": "p", "study": "s", "object": "chair", "answers": rows}
    (folder / "ANSWERS").write_text(json.dumps(answers))


def _releases(folder: Path) -> None:
    """Write two small releases with the names of the page."""
    for version in ("1.0.0", "2.0.0"):
        release(folder / "releases" / version, manifest=lambda fields, version=version: fields.update(version=version))


def _models(folder: Path) -> None:
    write_glb(box((-0.25, 0.25), (-0.25, 0.25), (0, 0.9), "wood"), folder / "chair.glb")
    (folder / "props").mkdir()
    for name in ("props/chair.glb", "generated.glb"):
        shutil.copy(folder / "chair.glb", folder / name)
    (folder / "mesh.obj").write_text("v 0 0 0\nv 0.6 0 0\nv 0.6 1.1 0.6\nf 1 2 3\n")


#: For each page, a function that writes its files, and the expected exit statuses; `check-asset` returns 3 for a model
#: with a wrong size.
RUNS: dict[str, tuple[Callable[[Path], None], set[int]]] = {
    "docs/how-to/check-a-model.md": (_models, {0, 3}),
    "docs/how-to/evidence.md": (_scene, {0, 3}),
    "README.md": (_scene, {0, 3}),
    "docs/how-to/scale-of-a-reconstruction.md": (_scene, {0, 3}),
    "docs/how-to/explorer.md": (_releases, {0}),
    "docs/how-to/insert-an-object.md": (_insertions, {0}),
    "docs/how-to/releases.md": (lambda _: None, {0}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_commands_of_a_how_to_end_with_an_expected_status(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare, statuses = RUNS[name]
    prepare(tmp_path)
    monkeypatch.chdir(tmp_path)
    page = (ROOT / name).read_text(encoding="utf-8").replace("\\\n", " ")
    for pattern, replacement in REPLACEMENTS.items():
        page = re.sub(pattern, replacement, page, flags=re.MULTILINE)
    lines = [line for block in BLOCK.findall(page) for line in block.splitlines() if PROGRAM.match(line)]
    assert lines
    for line in lines:
        words = shlex.split(line.removeprefix("$ ").partition(" >")[0], comments=True)
        n_names = 2 if words[0] == "metric-tree" else 1
        status = command_of(" ".join(words[:n_names]))(words[n_names:])
        assert status in (statuses | {1} if "--fail-over" in line else statuses), line


def test_addresses_of_the_explorer_page_have_status_200() -> None:
    page = (ROOT / "docs" / "how-to" / "explorer.md").read_text(encoding="utf-8")
    client = TestClient(application([metric_tree.open()]))
    addresses = ADDRESS.findall(page)
    assert len(addresses) == 3
    for address in addresses:
        assert client.get(address).status_code == 200, address
