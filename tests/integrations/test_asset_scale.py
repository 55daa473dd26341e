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


@pytest.mark.parametrize("ends", [(0, 0.15), (0.15, 0), (0, 0), (-1, 0.2)])
def test_embodiedgen_ranges_that_begin_at_zero(ends: tuple[float, float]) -> None:
    attributes = {"category": "cup", "min_height": ends[0], "max_height": ends[1]}
    found = run_path(str(FOLDER / "embodiedgen.py"))["metric_height"](attributes, [0.8, 1.0, 0.8])
    assert 0.05 < found["real_height"] < 0.2


@pytest.mark.parametrize(
    ("annotation", "extents", "expected"),
    [
        ({"category": "office chair", "height": 100}, [0.6, 1.0, 0.6], (85, 120)),
        ({"category": "mug", "height": 10}, [2.4, 2.0, 1.7], (8, 12)),
        ({"category": "mug", "height": 1000}, [2.4, 2.0, 1.7], (6, 14)),  # the model's height is in mm
        ({"category": "mug", "height": None}, [2.4, 2.0, 1.7], (6, 14)),
        ({"category": "zxqvt", "height": 31}, [1, 1, 1], (30.9, 31.1)),
    ],
)
def test_objathor(annotation: dict[str, object], extents: list[float], expected: tuple[float, float]) -> None:
    found = run_path(str(FOLDER / "objathor_height.py"))["metric_annotation"](annotation, extents)
    assert expected[0] < found["height"] < expected[1]
    assert found["height_reason"]
    if "height_range" in found:
        assert found["height_range"][0] < found["height"] < found["height_range"][1]
        assert found["height_probability"] == 0.9


def test_objaverse() -> None:
    """Uids and categories in the form of the LVIS annotations; extents of GLB files in metres, cm and normalised."""
    object_scales = run_path(str(FOLDER / "objaverse_scale.py"))["object_scales"]
    categories = {"chair": ["a", "b", "unread"], "zxqvt": ["c"], "mug": ["d"]}
    extents = {"a": [0.52, 0.9, 0.5], "b": [52, 90, 50], "c": [1, 1, 1], "d": [1.2, 1.0, 0.85]}
    found = {one.uid: one for one in object_scales(categories, extents)}
    assert list(found) == ["a", "b", "d"]
    assert (found["a"].factor, found["a"].verdict) == (1.0, "right")
    assert found["b"].factor == 0.01
    assert found["b"].probability > 0.9
    assert 0.06 < found["d"].factor < 0.14
    (again,) = object_scales({"mug": ["d"]}, extents, {"d": (0.09, 0.05)})
    assert again.low < 0.09 < again.high
    assert again.high / again.low < found["d"].high / found["d"].low


@pytest.mark.parametrize(("unit", "factor"), [(1, 1.0), (10, 0.1), (100, 0.01), (1000, 0.001)])
def test_scenesmith(unit: float, factor: float) -> None:
    choice = run_path(str(FOLDER / "scenesmith.py"))["realistic_factor"](
        "refrigerator", [0.7 * unit, 0.7 * unit, 1.75 * unit]
    )
    assert choice.factor == factor
    assert choice.probability > 0.9
    assert "refrigerator" in choice.reason


def test_examples_are_short() -> None:
    assert all(len(path.read_text(encoding="utf-8").splitlines()) <= 100 for path in FOLDER.glob("*.py"))
