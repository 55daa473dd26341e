"""The images of the documentation agree with the results of the program (`make pictures` writes them)."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / "docs" / "images"
RESULTS: dict[str, dict[str, Any]] = json.loads((PICTURES / "results.json").read_text(encoding="utf-8"))
#: Images of a video, whose reconstruction varies from run to run: the frames are not compared.
FROM_VIDEO = {"walk.jpg"}
#: Maximum relative difference of the numbers of these images.
MAX_CAPTURE_DIFFERENCE = 0.05
#: Maximum relative difference of numbers: the estimate depends on the version of the linear algebra.
MAX_RELATIVE_DIFFERENCE = 0.02
#: Maximum mean difference of grey values (0 to 255) of an image, reduced to a width of 320 pixels.
MAX_GREY_DIFFERENCE = 4.0


@pytest.fixture(scope="module")
def drawing() -> ModuleType:
    spec = importlib.util.spec_from_file_location("draw_images", ROOT / "docs" / "draw_images.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _grey(file: Path) -> Any:
    image = Image.open(file).convert("L")
    return np.asarray(image.resize((320, round(320 * image.height / image.width))), float)


def test_every_image_has_a_function_and_a_page(drawing: ModuleType) -> None:
    files = {file.name for file in PICTURES.iterdir() if file.is_file()} - {"results.json", "architecture.svg"}
    assert files == set(drawing.IMAGES) == set(RESULTS)
    # insertions before and after: the program of today cannot draw the images of an earlier version
    files |= {file.name for file in (PICTURES / "insertion").iterdir()}
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    shown = {
        Path(name).name for page in pages for name in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text("utf-8"))
    }
    assert shown == files | {"architecture.svg"}


@pytest.mark.parametrize("name", sorted(RESULTS))
def test_images_have_the_recorded_size(name: str) -> None:
    with Image.open(PICTURES / name) as image:
        assert list(image.size) == RESULTS[name]["size"]


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(RESULTS))
def test_images_agree_with_the_program(
    name: str, drawing: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drawing, "WALK_FRAMES", (170, 170))  # the content of these frames is not compared
    current, recorded = drawing.draw(name, tmp_path), RESULTS[name]
    tolerance = MAX_CAPTURE_DIFFERENCE if name in FROM_VIDEO else MAX_RELATIVE_DIFFERENCE
    assert current["size"] == recorded["size"]
    for key in ("metres_per_unit", "interval"):
        assert current[key] == pytest.approx(recorded[key], rel=tolerance), key
    assert list(current["objects"]) == list(recorded["objects"])
    for label, (*metres, verdict) in current["objects"].items():
        assert metres == pytest.approx(recorded["objects"][label][:-1], rel=tolerance, abs=0.011), label
        assert verdict == recorded["objects"][label][-1], label
    if name not in FROM_VIDEO:
        difference = np.abs(_grey(tmp_path / name) - _grey(PICTURES / name)).mean()
        assert difference < MAX_GREY_DIFFERENCE
