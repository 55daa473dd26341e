"""The examples of docs/reference/formats.md are read, and are the scene and the mask that the page states."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from estimator.evidence.gps import Gps
from estimator.evidence.known_lengths import parse_known_lengths
from estimator.instances.instance_reader import read_instances
from estimator.pipeline import measure_objects
from estimator.projection.cameras import pixels_in_view
from estimator.reconstructions.scene_reader import read_scene

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "formats.md"
#: A file's name in backquotes, the rest of its line, and its content in a fence.
EXAMPLE = re.compile(r"`([\w.]+)`[^\n]*(?:\n[^\n`]+)?:\n```\w+\n(.*?)```", re.DOTALL)
SCENES = {
    "COLMAP": ["cameras.txt", "images.txt", "points3D.txt"],
    "OpenSfM": ["reconstruction.json"],
    "nerfstudio": ["transforms.json", "points.ply"],
    "3D Gaussian Splatting": ["cameras.json", "points.ply"],
    "Bundler": ["bundle.out", "list.txt"],
    "Metashape": ["cameras.xml", "points.ply"],
    "RealityCapture": ["registration.csv", "points.ply"],
    "Meshroom": ["cameras.sfm"],
}
MASKS = {"instances.json": [], "results.json": [], "a.txt": ["data.yaml"], "a.json": []}


@pytest.fixture(scope="module")
def examples() -> dict[str, str]:
    return dict(EXAMPLE.findall(PAGE.read_text(encoding="utf-8")))


def write_examples(folder: Path, examples: dict[str, str], names: list[str]) -> None:
    folder.mkdir(exist_ok=True)
    for name in names:
        (folder / name).write_text(examples[name], encoding="utf-8")
    Image.new("L", (640, 480)).save(folder / "a.jpg")


def test_every_example_is_tested(examples: dict[str, str]) -> None:
    tested = {name for names in SCENES.values() for name in names}
    tested |= {name for first, others in MASKS.items() for name in (first, *others)}
    assert set(examples) == tested | {"positions.csv", "lengths.txt"}


@pytest.mark.parametrize("form", SCENES)
def test_the_scene_of_the_page(form: str, examples: dict[str, str], tmp_path: Path) -> None:
    write_examples(tmp_path / "scene", examples, SCENES[form])
    scene = read_scene(tmp_path / "scene")
    (view,) = scene.views
    assert Path(view.name).name == "a.jpg"
    assert view.centre == pytest.approx([1, 2, 3])
    assert scene.points == pytest.approx(np.array([[1.1, 2.2, 5]]))
    assert pixels_in_view(view, scene.points)[0] == pytest.approx(np.array([[345, 290]]), abs=1e-4)
    assert view.point_index.tolist() == [0]
    assert view.keypoints == pytest.approx(np.array([[345, 290]]), abs=1e-4)


@pytest.mark.parametrize("first", MASKS)
def test_the_mask_of_the_page(first: str, examples: dict[str, str], tmp_path: Path) -> None:
    write_examples(tmp_path / "scene", examples, SCENES["COLMAP"])
    write_examples(tmp_path / "masks", examples, [first, *MASKS[first]])
    place = tmp_path / "masks" / first
    (chair,) = read_instances(place.parent if MASKS[first] else place, read_scene(tmp_path / "scene"))
    assert chair.category == "chair"
    assert (*chair.origin, *chair.mask.shape[::-1]) == pytest.approx((300, 200, 100, 100), abs=1)
    assert chair.mask.mean() > 0.98


def test_the_positions_and_lengths_of_the_page(examples: dict[str, str], tmp_path: Path) -> None:
    write_examples(tmp_path, examples, [*SCENES["COLMAP"], "positions.csv", "lengths.txt"])
    scene = read_scene(tmp_path)
    (row,) = Gps(tmp_path / "positions.csv").observe(scene, measure_objects(scene, ()))
    assert row.reason == "1 views have a position, 4 needed"
    (length,) = parse_known_lengths([str(tmp_path / "lengths.txt")])
    assert (length.distance, length.metres, length.sigma) == pytest.approx((0.8, 0.8, 0.00625))
