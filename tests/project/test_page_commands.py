"""The commands of every page run, in order in one folder, or are in `NOT_RUN` with the reason."""

from __future__ import annotations

import gzip
import json
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from starlette.testclient import TestClient

import metric_tree
from estimator.projection.cameras import pixels_in_view
from estimator.reconstructions.scene_reader import read_scene
from explorer.server.app import application
from metric_cli.estimate_scale.estimate import main as estimate_scale
from tests.crawler.page.test_archives import PRODUCT, warc_records
from tests.metric_cli.test_paths import command_of
from tests.project.test_docs import PAGES, ROOT
from tests.synthetic.insertions import first_views, write_glb
from tests.synthetic.minitree import release
from tests.synthetic.networks import RenderedViews, write_output
from tests.synthetic.rooms.solids import box
from tests.synthetic.splats import write_cameras, write_splat

#: A block of shell commands, and the output that the page shows below a block with prompts.
BLOCK = re.compile(r"^```(?:sh|console)\n(.*?)^```(?:\n```text\n(.*?)^```)?", re.MULTILINE | re.DOTALL)
ADDRESS = re.compile(r"^curl .*?http://127\.0\.0\.1:8000([^'\s]*)", re.MULTILINE)
#: Maximum relative difference between a number in the shown output and the same number today: the last digits depend
#: on the version of the linear algebra, and a reconstruction on the order of its threads.
MAX_SHOWN_DIFFERENCE = 0.03
#: Masks of a scene.
MASKS = "instances.json"
#: Patterns of commands that do not run here, and the reason.
NOT_RUN = {
    r"^pip install ": "reads the package index; `make release-check` installs the wheel",
    r"^(python -m venv trainer|trainer/bin/)": "needs PyTorch; `make train-check` trains a small network",
    r"^make ": "sets up the repository, or runs all tests",
    r"^docker ": "needs Docker",
    r"^metric-tree serve( |$)": "does not end; its addresses are requested below",
    r"^curl ": "its address is requested below",
    r"^while IFS=, read -r f o n; do curl ": "reads Common Crawl",
    r"^metric-tree crawl ": "needs a site; tests/crawler/fetch/test_crawl.py runs crawls of a site on this machine",
    r"^metric-tree build (data/raw|crawls/ikea|raw crawls/ikea|CRAWL)": "tests/end_to_end/test_pictures.py runs it",
    r"^metric-tree (cutout|export) ": "tests/end_to_end/test_pictures.py runs both",
    r"^metric-tree query chair --tree RELEASE_WITH_CUTOUTS": "tests/end_to_end/test_pictures.py writes a sheet",
    r"^estimate-scale video\.mp4": "a reconstruction, as that of docs/how-to/scale-from-a-video.md",
    r"^estimate-scale data/scenes/walk_carpark/": "tests/end_to_end/test_docs_images.py runs it",
    r"^insert-object walk ": "tests/end_to_end/test_docs_images.py runs it",
    r"^estimate-scale .* --draw$": "waits for a person; tests/end_to_end/test_first_use.py draws",
    r"^estimate-scale (street|model)( |$)": "tests/end_to_end/test_first_use.py runs the first commands",
    r"^estimate-scale SCENE --detector ": "tests/capture/test_capture.py runs a small network",
    r"^metric-tree explain ycb_hope_dims:1": "not shipped; tests/metric_cli/test_explain.py reads a log",
    r"^python -m data\.generate words": "writes to the repository",
    r"^python -m pytest ": "is a test",
}  # fmt: skip
#: Replacements that make a command quick (the site of a small release) or name files of the test.
REPLACEMENTS = {
    "frame=12,x=640,y=500": "frame=1,x=320,y=400",
    r"^(metric-tree site out/site)$": r"\1 --tree releases/2.0.0",
    r"^metric-tree validate releases/mine": "metric-tree validate releases/2.0.0",
    r"^metric-tree diff 3\.0\.0 4\.0\.0": "metric-tree diff releases/1.0.0 releases/2.0.0",
    r"--tree (\d)": r"--tree releases/\1",
    r"^(metric-tree build raw/lamps.*)$": r"\1 --workers 1",
    r"^(metric-tree review record .*)$": r"\1 --folder decisions",
}


@dataclass(frozen=True, slots=True)
class Block:
    """Commands of a page, and the lines that it shows as their output."""

    commands: tuple[str, ...]
    shown: tuple[str, ...]


def _blocks(page: Path) -> Iterator[Block]:
    for text, shown in BLOCK.findall(page.read_text(encoding="utf-8")):
        lines = [line.removeprefix("$ ") for line in text.replace("\\\n", " ").splitlines()]
        commands = [re.sub(r"\s+# .*$", "", line).strip() for line in lines]
        yield Block(tuple(filter(None, commands)), tuple(shown.splitlines()))


def _nothing(folder: Path) -> None:
    """Pages whose commands need no more than the shipped data."""


def _scene(folder: Path) -> None:
    (folder / "SCENE").symlink_to(ROOT / "data" / "scenes" / "demo_room")
    (folder / "pictures").symlink_to(ROOT / "data" / "scenes" / "demo_room" / "images")


def _metres(folder: Path) -> None:
    """Write positions, depth maps, outputs of networks, a photograph and a splat for the demo room."""
    _scene(folder)
    scene = read_scene(ROOT / "data" / "scenes" / "demo_room")
    metres = json.loads((folder / "SCENE" / "truth.json").read_text(encoding="utf-8"))["metres_per_unit"]
    rows = [",".join([view.name, *map(str, (metres * view.centre).tolist())]) for view in scene.views]
    (folder / "positions.csv").write_text("\n".join(["name,x,y,z", *rows]), encoding="utf-8")
    (folder / "depth").mkdir()
    depths_m, images, dataset = [], folder / "SCENE" / "images", json.loads((folder / "SCENE" / MASKS).read_text())
    for view in scene.views[:6]:
        pixels, depths = pixels_in_view(view, scene.points[view.point_index])
        inside = np.isfinite(pixels[:, 0]) & (depths > 0)
        grid = np.stack(np.meshgrid(*(np.arange(side) + 0.5 for side in (view.camera.width, view.camera.height))), -1)
        nearest = cKDTree(pixels[inside]).query(grid)[1]
        depths_m.append((metres * depths[inside][nearest]).astype("f4"))
        np.save(folder / "depth" / f"{Path(view.name).stem}.npy", depths_m[-1])
    views, (focal, centre) = scene.views[:6], (scene.views[0].camera.focal_px / 4, scene.views[0].camera.width / 8)
    maps = RenderedViews(
        tuple(view.name for view in views),
        np.stack(depths_m)[:, ::4, ::4],
        np.stack([view.rotation for view in views]),
        metres * np.stack([view.centre for view in views]),
        np.tile([[focal, 0, centre], [0, focal, centre * 3 / 4], [0, 0, 1]], (len(views), 1, 1)),
        1.0,
        (),
        dataset,
    )
    write_output("CUT3R", maps, folder / "cut3r")
    write_output("Depth Anything 3", maps, folder / "da3")
    write_splat(folder / "da3" / "exports" / "gs_ply" / "0000.ply", maps.points.reshape(-1, 3)[::7] / 1.7)
    shutil.copy(images / views[0].name, folder / "photo.jpg")
    np.savez(folder / "depth.npz", depth=maps.depth[0], intrinsics=maps.intrinsics[0])
    rows = [row for row in dataset["annotations"] if row["image_id"] == dataset["images"][0]["id"]]
    first = [dataset["images"][0] | {"file_name": "photo.jpg"}]
    (folder / "masks.json").write_text(json.dumps(dataset | {"images": first, "annotations": rows}))
    write_cameras(scene, folder / "trained" / "cameras.json")
    write_splat(folder / "trained" / "point_cloud" / "iteration_30000" / "point_cloud.ply", scene.points)


def _insertions(folder: Path) -> None:
    """Write two views of the demo room with its scale (scene and work folder), models, and answers of a participant."""
    work = first_views(ROOT / "data" / "scenes" / "demo_room", 2, folder / "work")
    (folder / "SCENE").symlink_to(work)
    assert estimate_scale([str(work), "--output", str(work / "result.json"), "--quiet"]) == 0
    write_glb(box((-0.25, 0.25), (-0.25, 0.25), (0, 0.9), "wood"), folder / "chair.glb")
    write_glb(box((-0.02, 0.02), (-0.02, 0.02), (0, 0.05), "wood"), folder / "cushion.glb")


def _detections(folder: Path) -> None:
    """Write the masks of the demo room as results of COCO, whose names are in the data set."""
    _scene(folder)
    dataset = json.loads((folder / "SCENE" / MASKS).read_text(encoding="utf-8"))
    results = [row | {"score": 0.9} for row in dataset.pop("annotations")]
    (folder / "results.json").write_text(json.dumps(results))
    (folder / "dataset.json").write_text(json.dumps(dataset | {"annotations": []}))


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


def _raw_items(folder: Path) -> None:
    (folder / "raw").mkdir()
    text = gzip.decompress((ROOT / "data" / "raw" / "open_models.jsonl.gz").read_bytes())
    (folder / "raw" / "open_models.jsonl").write_bytes(text)


def _saved_page(folder: Path) -> None:
    shutil.copy(ROOT / "data" / "examples" / "site" / "page.html", folder / "page.html")
    (folder / "pages.warc.gz").write_bytes(gzip.compress(b"".join(warc_records())))
    (folder / "products.nq.gz").write_bytes(gzip.compress(PRODUCT.format("shelf", 80, "120 cm", "").encode()))


def _annotations(folder: Path) -> None:
    (folder / "set" / "annotations").mkdir(parents=True)
    (folder / "set" / "annotations" / "instances_train.json").write_text('{"categories": [{"name": "chair"}]}')


#: For each page, a function that writes its files, and the expected exit statuses; `check-asset` returns 3 for a model
#: with a wrong size.
RUNS: dict[str, tuple[Callable[[Path], None], set[int]]] = {
    "README.md": (_scene, {0, 3}),
    "docs/how-to/check-a-model.md": (_models, {0, 3}),
    "docs/how-to/crawl-a-site.md": (_saved_page, {0}),
    "docs/how-to/detectors.md": (_detections, {0}),
    "docs/how-to/evidence.md": (_scene, {0, 3}),
    "docs/how-to/explorer.md": (_releases, {0}),
    "docs/how-to/fix-a-category.md": (_raw_items, {0}),
    "docs/how-to/insert-an-object.md": (_insertions, {0}),
    "docs/how-to/metres.md": (_metres, {0}),
    "docs/how-to/releases.md": (_releases, {0}),
    "docs/how-to/scale-of-a-reconstruction.md": (_scene, {0, 3}),
    "docs/how-to/training-sets.md": (_annotations, {0}),
    "docs/tutorial/first-scene.md": (_scene, {0, 3}),
}


def _agrees(shown: str, printed: str) -> bool:
    """Return True if two lines have the same words, numbers within `MAX_SHOWN_DIFFERENCE`, integers within 1."""
    number = re.compile(r"\d+(?:\.\d+)?")
    if number.sub("0", shown).split() != number.sub("0", printed).split():
        return False
    pairs = zip(number.findall(shown), number.findall(printed), strict=True)
    return all(
        math.isclose(float(a), float(b), rel_tol=MAX_SHOWN_DIFFERENCE, abs_tol=0.011 if "." in a else 1.0)
        for a, b in pairs
    )


def _run(command: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Return exit status and output.

    Two programs run in this process, which saves their start; a shell runs `insert-object`, whose renderer would keep
    300 MB, and all others.
    """
    line, _, target = command.partition(" > ")
    words = shlex.split(line)
    n_names = {"estimate-scale": 1, "metric-tree": 2}.get(words[0], 0)
    if not n_names:
        environment = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
        done = subprocess.run(
            ["bash", "-c", command],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=300,
        )
        return done.returncode, done.stdout
    capsys.readouterr()
    status = command_of(" ".join(words[:n_names]))(words[n_names:])
    printed = capsys.readouterr().out
    if target:
        (folder / target).write_text(printed, encoding="utf-8")
    return status, printed


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [page for page in PAGES if any(_blocks(page))], ids=lambda page: page.relative_to(ROOT).as_posix()
)
def test_commands_of_a_page_run_and_print_the_shown_lines(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    prepare, statuses = RUNS.get(page.relative_to(ROOT).as_posix(), (_nothing, {0}))
    (tmp_path / "data").symlink_to(ROOT / "data")
    prepare(tmp_path)
    monkeypatch.chdir(tmp_path)
    for block in _blocks(page):
        printed = ""
        for command in block.commands:
            if any(re.search(pattern, command) for pattern in NOT_RUN):
                continue
            line = command
            for pattern, replacement in REPLACEMENTS.items():
                line = re.sub(pattern, replacement, line)
            status, out = _run(line, tmp_path, capsys)
            assert status in (statuses | {1} if "--fail-over" in line else statuses), line
            printed += out
        for shown in block.shown if printed else ():
            if shown.strip(" ─.") and "─" not in shown:
                assert any(_agrees(shown, other) for other in printed.splitlines()), f"{shown}\n{printed}"


def test_every_reason_not_to_run_a_command_and_every_replacement_is_needed() -> None:
    commands = [command for page in PAGES for block in _blocks(page) for command in block.commands]
    patterns = [*NOT_RUN, *REPLACEMENTS]
    assert [pattern for pattern in patterns if not any(re.search(pattern, command) for command in commands)] == []


def test_addresses_of_the_explorer_page_have_status_200() -> None:
    page = (ROOT / "docs" / "how-to" / "explorer.md").read_text(encoding="utf-8")
    client = TestClient(application([metric_tree.open()]))
    addresses = ADDRESS.findall(page)
    assert len(addresses) == 3
    for address in addresses:
        assert client.get(address).status_code == 200, address


def test_every_command_of_the_page_of_metres_is_in_a_block() -> None:
    page = ROOT / "docs" / "how-to" / "metres.md"
    inline = re.findall(r"`(estimate-scale [^`\n]*)`", BLOCK.sub("", page.read_text(encoding="utf-8")))
    commands = [command for block in _blocks(page) for command in block.commands]
    assert [line for line in inline if not any(command.startswith(line) for command in commands)] == []
