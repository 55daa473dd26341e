"""First uses of `estimate-scale` from an empty home folder, as command lines of docs/how-to/first-scale.md."""

from __future__ import annotations

import io
import json
import re
import shlex
import shutil
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from estimator import read_instances, read_scene
from metric_cli.estimate_scale.estimate import main
from tests.synthetic.evidence import draw_marker, marker_picture, position_table, write_exif
from tests.synthetic.exports import write_export
from tests.synthetic.rooms.similarity import similarity_between
from tests.synthetic.walk import Walk, synthetic_walk

STREET = Path("data/scenes/lund_street").resolve()
#: True scale of the street, and of the synthetic hall, in metres per unit.
STREET_SCALE, HALL_SCALE = 16.4, 0.4


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with a COLMAP model and its images without masks, a model alone, and an empty home."""
    (tmp_path / "home").mkdir()
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("METRIC_TREE_CACHE", raising=False)
    shutil.copytree(STREET / "sparse", tmp_path / "street" / "sparse")
    shutil.copytree(STREET / "images", tmp_path / "street" / "images")
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    assert not list((tmp_path / "home").iterdir())


@pytest.fixture
def hall(here: Path) -> Walk:
    """A folder of nerfstudio without masks."""
    walk = synthetic_walk(here / "hall", scale=HALL_SCALE)
    write_export(walk.scene, "nerfstudio", here / "hall")
    return walk


def scale(command: str, capsys: pytest.CaptureFixture[str]) -> float:
    """Run a command line of a user and return the printed scale; the printed interval contains the true one."""
    program, *words = shlex.split(command)
    assert program == "estimate-scale"
    assert main(words) == 0
    out, err = capsys.readouterr()
    found = re.match(r"scale ([\d.]+) m per unit(?: \(uncertain\))?   90% interval ([\d.]+) to ([\d.]+)", out)
    assert found is not None, out
    value, low, high = map(float, found.groups())
    true = STREET_SCALE if "street" in command else HALL_SCALE
    assert low / 1.1 < true < 1.1 * high  # the true scale of the street is known to 10 %
    assert re.search(rf"\nestimate-scale: next: {re.escape(command)} --", "\n" + err)
    return value


def detections() -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return images and categories of the street, and boxes as a detector writes them."""
    document = json.loads((STREET / "instances.json").read_text())
    boxes = [
        {"image_id": row["image_id"], "category_id": row["category_id"], "bbox": row["bbox"], "score": 0.9}
        for row in document["annotations"]
    ]
    return {name: document[name] for name in ("images", "categories")}, boxes


def test_a_model_without_masks_names_the_next_commands(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["street"]) == 2
    line = capsys.readouterr().err
    assert "--draw (a local page), --detector auto (rfdetr-seg-medium, Apache-2.0), or --instances FILE" in line
    assert "estimate-scale street --draw" in line
    shutil.rmtree(here / "street" / "images")
    assert main(["street"]) == 2
    line = capsys.readouterr().err
    assert "--images DIR with '" in line
    assert "estimate-scale street --camera-height handheld" in line


def test_objects_are_drawn_on_a_model_and_kept(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # `capsys` would lose what the thread prints between the reading and the clearing of the captured text.
    said = io.StringIO()
    with monkeypatch.context() as patched:
        patched.setattr(sys, "stderr", said)
        thread = threading.Thread(target=main, args=(["street", "--draw"],), daemon=True)
        thread.start()
        until = time.monotonic() + 120
        while (url := re.search(r"http://\S+/", said.getvalue())) is None:
            assert thread.is_alive(), said.getvalue()
            assert time.monotonic() < until, f"no address after 120 s: {said.getvalue()}"
            time.sleep(0.05)
    with urllib.request.urlopen(f"{url[0]}start", timeout=120) as answer:
        names = [frame["name"] for frame in json.load(answer)["frames"]]
    scene = read_scene(STREET)
    images = {name: {"name": name, "objects": list[Any]()} for name in names}
    for instance in read_instances(None, scene):
        name = scene.views[instance.view].name
        if name in images:
            outlines = cv2.findContours(instance.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]
            corners = max(outlines, key=len)[:, 0] + instance.origin
            images[name]["objects"].append({"name": "car", "kind": "polygon", "points": corners.tolist()})
    body = json.dumps({"images": list(images.values()), "close": True}).encode()
    urllib.request.urlopen(urllib.request.Request(f"{url[0]}save", body), timeout=120).close()
    thread.join(120)
    assert not thread.is_alive(), said.getvalue()
    assert (here / "street.metric-tree" / "instances.json").is_file()
    assert not (here / "street" / "instances.json").exists()
    capsys.readouterr()
    scale("estimate-scale street", capsys)


def test_boxes_of_a_detector_and_masks_as_png(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names, boxes = detections()
    (here / "dataset.json").write_text(json.dumps(names))
    (here / "boxes.json").write_text(json.dumps(boxes))
    scale("estimate-scale street --instances boxes.json --categories dataset.json", capsys)

    scene = read_scene(STREET)
    (here / "masks").mkdir()
    for row, view in enumerate(scene.views):
        labels = np.zeros((view.camera.height, view.camera.width), dtype=np.uint8)
        for value, instance in enumerate((one for one in read_instances(None, scene) if one.view == row), 1):
            (x, y), (height, width) = instance.origin, instance.mask.shape
            labels[y : y + height, x : x + width][instance.mask] = value
        cv2.imwrite(str(here / "masks" / f"{view.name}.png"), labels)
    (here / "masks" / "categories.json").write_text(json.dumps({n + 1: "car" for n in range(3)}))
    scale("estimate-scale street --instances masks", capsys)


def test_the_next_command_of_a_file_has_no_suffix_in_the_name_of_the_folder(
    hall: Walk, capsys: pytest.CaptureFixture[str]
) -> None:
    a, b = (",".join(f"{value:.9f}" for value in row) for row in hall.units(np.array([[0.0, 0, 0], [1, 0, 0]])))
    assert main(["hall/transforms.json", "--known-length", f"({a})", f"({b})", "1"]) == 0
    assert "--write-scaled hall/transforms-metric  #" in capsys.readouterr().err


def test_lengths_and_heights_with_units(hall: Walk, capsys: pytest.CaptureFixture[str]) -> None:
    a, b = (",".join(f"{value:.9f}" for value in row) for row in hall.units(np.array([[0.0, 0, 0], [1, 0, 0]])))
    command = f"estimate-scale hall --known-length '({a})' '({b})' "
    values = [scale(command + length, capsys) for length in ("1", "3.28084ft", "39.37in", "100cm", "1000 mm")]
    assert values == pytest.approx([HALL_SCALE] * 5, rel=1e-3)
    assert scale("estimate-scale hall --camera-height 4.92ft", capsys) == pytest.approx(HALL_SCALE, rel=0.02)
    assert scale("estimate-scale hall --camera-height handheld", capsys) == pytest.approx(HALL_SCALE, rel=0.1)


def test_positions_and_markers(hall: Walk, capsys: pytest.CaptureFixture[str]) -> None:
    position_table(Path("path.csv"), hall.scene, hall.metres, "x y z")
    assert scale("estimate-scale hall --gps path.csv", capsys) == pytest.approx(HALL_SCALE, rel=0.02)
    draw_marker(hall, marker_picture("DICT_4X4_50"), 0.8 * 520 / 400)
    assert scale("estimate-scale hall --marker DICT_4X4_50:80cm", capsys) == pytest.approx(HALL_SCALE, rel=0.02)


def test_gps_of_the_images_is_used_without_an_option(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    walk = synthetic_walk(here / "hall", scale=HALL_SCALE)
    write_export(walk.scene, "nerfstudio", here / "hall")
    write_exif(walk, 1.0)
    assert scale("estimate-scale hall", capsys) == pytest.approx(HALL_SCALE, rel=0.05)


def test_a_video_a_folder_of_images_and_a_polycam_folder(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All three are reconstructed next to the input; the truth is that of the rendered video."""
    demo = STREET.parent / "demo_video"
    shutil.copy(demo / "video.mp4", "walk.mp4")
    shutil.copy(demo / "instances.json", "masks.json")
    truth = {frame["index"]: frame for frame in json.loads((demo / "truth.json").read_text())["frames"]}

    def check(command: str, work: Path, target: str) -> None:
        assert main(shlex.split(command)[1:]) == 0
        out, err = capsys.readouterr()
        found = re.match(r"scale [\d.]+ m per unit(?: \(uncertain\))?   90% interval ([\d.]+) to ([\d.]+)", out)
        assert found is not None, out
        assert f"estimate-scale: next: {command} --write-scaled {target}  #" in err
        views = read_scene(work).views
        true = [truth[int(Path(view.name).stem)] for view in views]
        true_centres = np.array([-np.array(frame["rotation"]).T @ frame["translation"] for frame in true])
        metres = 1 / similarity_between(true_centres, np.array([view.centre for view in views])).scale
        low, high = map(float, found.groups())
        assert low < metres < high

    check("estimate-scale walk.mp4 --instances masks.json --frames 8", here / "walk.mp4.metric-tree", "walk-metric")
    (here / "photos").mkdir()
    for file in (here / "walk.mp4.metric-tree" / "frames").iterdir():
        cv2.imwrite(str(here / "photos" / file.name), cv2.resize(cv2.imread(str(file)), None, fx=0.5, fy=0.5))
    check("estimate-scale photos --instances masks.json", here / "photos.metric-tree", "photos-metric")
    shutil.copytree(here / "photos", here / "polycam" / "keyframes" / "images")
    shutil.copytree(here / "photos.metric-tree", here / "polycam.metric-tree")  # the same images: stages are reused
    check("estimate-scale polycam --instances masks.json", here / "polycam.metric-tree", "polycam-metric")
