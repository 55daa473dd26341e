"""The truth next to a scene, for images only."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from estimator.outputs.ground_truth import SceneTruth, read_truth


def sizes_of(**sizes: float) -> dict[str, object]:
    return {name: {"value": value, "plus_minus": 0.01} for name, value in sizes.items()}


@pytest.mark.parametrize(
    ("sizes", "expected"),
    [
        ({"length": 2.0, "width": 1.0, "height": 0.5}, (2.0, 1.0, 0.5)),
        ({"edge": 0.15}, (0.15, 0.15, 0.15)),
        ({"diameter": 0.4}, (0.4, 0.4, 0.4)),
        ({"diameter": 0.1, "height": 0.3}, (0.1, 0.1, 0.3)),
        ({"length": 1.2, "depth": 0.8, "height": 0.7}, (1.2, 0.8, 0.7)),
        ({"width": 0.4, "depth": 0.44, "height": 1.0}, (0.44, 0.4, 1.0)),
        ({"length": 0.29, "width": 0.2, "thickness": 0.006}, (0.29, 0.2, 0.006)),
        ({"width": 0.24, "thickness": 0.03, "height": 0.32}, (0.24, 0.03, 0.32)),
        ({"height": 0.95}, (None, None, 0.95)),
        ({"length": 0.2}, (0.2, None, None)),
        ({"backrest_width": 0.4, "height": 0.9}, (None, None, 0.9)),
    ],
)
def test_words_of_people_become_dimensions(
    sizes: dict[str, float], expected: tuple[float | None, ...], tmp_path: Path
) -> None:
    document = {"metres_per_unit": 0.4, "objects": [{"track_id": 7, "truth_m": sizes_of(**sizes) | {"note": "seen"}}]}
    (tmp_path / "truth.json").write_text(json.dumps(document), encoding="utf-8")
    truth = read_truth(tmp_path)
    assert truth.scale == 0.4
    assert tuple(truth.sizes["7"].get(name) for name in ("length", "width", "height")) == expected


@pytest.mark.parametrize("text", [None, "", "{", "[]", "17", '{"objects": [1, {"track_id": 1}]}', '{"objects": null}'])
def test_no_truth_is_no_error(text: str | None, tmp_path: Path) -> None:
    if text is not None:
        (tmp_path / "truth.json").write_text(text, encoding="utf-8")
    assert read_truth(tmp_path) == SceneTruth()
