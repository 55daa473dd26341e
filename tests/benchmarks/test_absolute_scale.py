"""The benchmark of absolute scale on predictions with known scores."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from benchmarks.absolute_scale import Prediction, main, read_predictions, table, write_figure
from metric_base.errors import InputError

TRUTHS = {"a": 2.0, "b": 0.5}


def rows_of(text: str) -> dict[str, list[str]]:
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()[2:]]
    return {line[0]: line[1:] for line in lines}


def test_scores(tmp_path: Path) -> None:
    file = tmp_path / "predictions.csv"
    file.write_text("scene,scale,low,high,seconds\na,2.2,1.8,2.4,3\nb,0.6,0.55,0.7,5\n", encoding="utf-8")
    rows = rows_of(table(list(read_predictions(f"mine={file}", list(TRUTHS), [])), TRUTHS))
    score = (math.log(2.4 / 1.8) + math.log(0.7 / 0.55) + 20 * math.log(0.55 / 0.5)) / 2
    error = (math.log(1.1) + math.log(1.2)) / 2
    assert rows == {"mine": ["2", "0", "15.0", f"{error:.3f}", "0.50", f"{score:.2f}", "4.0"]}


def test_a_missing_scene_is_a_refusal_and_tuned_scenes_are_apart(tmp_path: Path) -> None:
    file = tmp_path / "predictions.csv"
    file.write_text("scene,scale,low,high\na,2.0,,\n", encoding="utf-8")
    rows = rows_of(table(list(read_predictions(f"mine={file}", list(TRUTHS), ["mine=a"])), TRUTHS))
    assert rows["mine"] == ["1", "1", "–", "–", "–", "–", "–"]
    assert rows["mine (scenes seen)"] == ["1", "0", "0.0", "0.000", "–", "–", "–"]


@pytest.mark.parametrize("row", ["a,x,,", "a,-1,,", "a,2,3,4", "a,2,1,1.5", "a,inf,,"])
def test_invalid_predictions(row: str, tmp_path: Path) -> None:
    file = tmp_path / "predictions.csv"
    file.write_text(f"scene,scale,low,high\n{row}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"predictions.csv:2"):
        list(read_predictions(f"mine={file}", list(TRUTHS), []))


def test_figure(tmp_path: Path) -> None:
    write_figure(
        [Prediction("mine", "a", 2.2, 1.8, 2.4, 1.0), Prediction("x", "b", 0.5, None, None, None)],
        TRUTHS,
        tmp_path / "a.png",
    )
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_scenes_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    assert "demo_room\t" in capsys.readouterr().out
