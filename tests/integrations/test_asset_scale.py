"""The examples of `integrations/asset_scale` on recorded inputs."""

from __future__ import annotations

from pathlib import Path
from runpy import run_path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "integrations" / "asset_scale"
#: Answers of the form that EmbodiedGen parses, with the extents of normalised meshes, and the plausible heights in m.
RECORDED = [
    ({"category": "cup", "min_height": 0.1, "max_height": 0.15}, [0.8, 1.0, 0.8], (0.08, 0.15)),
    ({"category": "office chair", "min_height": 0.9, "max_height": 1.1}, [0.6, 1.0, 0.6], (0.85, 1.2)),
    ({"category": "cup", "min_height": 10.0, "max_height": 15.0}, [0.8, 1.0, 0.8], (0.06, 0.18)),  # centimetres
]


@pytest.mark.parametrize(("attributes", "extents", "expected"), RECORDED)
def test_embodiedgen(attributes: dict[str, object], extents: list[float], expected: tuple[float, float]) -> None:
    found = run_path(str(FOLDER / "embodiedgen.py"))["metric_height"](attributes, extents)
    assert expected[0] < found["real_height"] < expected[1]
    assert found["height_range"][0] < found["real_height"] < found["height_range"][1]
    assert found["category"] == attributes["category"]


def test_embodiedgen_keeps_the_height_of_an_unknown_category() -> None:
    attributes = {"category": "zxqvt", "min_height": 0.2, "max_height": 0.4}
    found = run_path(str(FOLDER / "embodiedgen.py"))["metric_height"](attributes, [1, 1, 1])
    assert found["real_height"] == pytest.approx(0.3)


@pytest.mark.parametrize(("unit", "factor"), [(1, 1.0), (10, 0.1), (100, 0.01)])
def test_scenesmith(unit: float, factor: float) -> None:
    choice = run_path(str(FOLDER / "scenesmith.py"))["realistic_factor"](
        "refrigerator", [0.7 * unit, 0.7 * unit, 1.75 * unit]
    )
    assert choice.factor == factor
    assert choice.probability > 0.9
    assert "refrigerator" in choice.reason


def test_examples_are_short() -> None:
    assert all(len(path.read_text(encoding="utf-8").splitlines()) <= 60 for path in FOLDER.glob("*.py"))
