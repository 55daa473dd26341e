"""Inputs that caused failures of release 1.0.0: no internal errors, and no files or terminals are changed."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from estimator.instances.label_images import read_label_images
from estimator.outputs.ground_truth import read_truth
from estimator.reconstructions.scene_reader import read_scene
from metric_base.errors import InputError
from metric_cli.estimate_scale.estimate import main

pytestmark = pytest.mark.real_data

DAMAGED = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "damaged"
OBJECTS = ["ansi_objects.json", "five_persons_dims.json", "five_persons_extents.json", "objects_x1.json"]


@pytest.fixture(autouse=True)
def _skip_without_data() -> None:
    if not DAMAGED.is_dir():
        pytest.skip("needs ../shared/data/damaged")


@pytest.mark.parametrize("name", OBJECTS)
def test_output_for_objects_with_control_characters_contains_none(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for form in ([], ["--json"]):
        assert main(["--objects", str(DAMAGED / name), *form]) in (0, 2, 3)
        out, err = capsys.readouterr()
        assert not any(character in out + err for character in "\x1b\x07\x9b\u202e")


def test_overlay_of_images_with_relative_paths_stays_in_its_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene"
    shutil.copytree(DAMAGED / "overlay_dotdot_scene", scene, copy_function=shutil.copyfile)
    for path in [scene, *scene.rglob("*")]:
        path.chmod(0o755 if path.is_dir() else 0o644)
    before = {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in scene.rglob("*") if path.is_file()}
    assert main([str(scene), "--overlay", str(tmp_path / "out" / "overlay")]) == 0, capsys.readouterr().err
    after = {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in scene.rglob("*") if path.is_file()}
    assert after == before
    assert len(list((tmp_path / "out" / "overlay").rglob("*.jpg"))) == len(list((scene / "images").iterdir()))
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["overlay"]


@pytest.mark.parametrize("name", ["png_5000digit_categories.json", "fault_demo_png_2001190_categories.json"])
def test_pixel_value_of_thousands_of_digits_is_an_error_of_one_line(name: str, tmp_path: Path) -> None:
    scene = read_scene(Path(__file__).resolve().parents[2] / "data" / "scenes" / "demo_room")
    shutil.copyfile(DAMAGED / name, tmp_path / "categories.json")
    with pytest.raises(InputError, match="a pixel value from 0 to 65535") as error:
        read_label_images(scene, tmp_path)
    assert len(str(error.value)) < 400


@pytest.mark.parametrize(
    "path", sorted(DAMAGED.glob("truth_fault*")) or [Path("truth_fault")], ids=lambda path: path.name
)
def test_scale_of_a_damaged_truth_file_is_the_stated_one_or_none(path: Path, tmp_path: Path) -> None:
    shutil.copyfile(path, tmp_path / "truth.json")
    stated = json.loads(path.read_text(encoding="utf-8"))["metres_per_unit"]
    assert read_truth(tmp_path).scale in (None, stated)


@pytest.mark.parametrize("number", ["2000143", "2001049", "3000498"])
def test_distant_points_of_a_damaged_cloud_are_removed(number: str, shared: Path) -> None:
    """Such points caused grids of 22 GB."""
    cloud = DAMAGED / f"hang_tum_lite_{number}_dense.ply"
    scene = read_scene(shared / "data" / "scenes" / "tum_office", cloud)
    assert scene.dense is not None
    assert any("far from the cameras" in line for line in scene.warnings)
    extent = np.ptp(np.vstack([scene.points, [view.centre for view in scene.views]]), axis=0).max()
    assert np.ptp(scene.dense.points, axis=0).max() < 500 * extent
