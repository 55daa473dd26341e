"""Lines that `insert-object` prints for its objects."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from insertion.request import InsertionRequest, ObjectRequest, PixelPosition
from insertion.result import FrameReport, InsertionResult
from insertion.scene.scale import MetricScale
from metric_cli.insert_object.insert import command_line, run


@pytest.mark.parametrize(
    ("low", "ending"),
    [
        (None, "0.5 metres per unit, stated without an interval; in 2 of 3 frames"),
        (0.4, "the error of the scale, and of the height in the image, is -20% to +20%; in 2 of 3 frames"),
    ],
)
def test_an_object_has_its_size_scale_and_number_of_frames(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], low: float | None, ending: str
) -> None:
    frames = tuple(FrameReport(f"{k}.png", None, box, 1.0) for k, box in enumerate([(0, 0, 9, 9), None, (1, 1, 2, 2)]))
    scale = MetricScale(0.5, low, None if low is None else 0.6, "option")
    size_m = {"length": 1.0, "width": 0.5, "height": 0.25}
    result = InsertionResult("a.glb", scale, size_m, np.zeros(3), np.ones(3), 0.0, "plane 0", frames, {}, ("dark",))
    inserted = SimpleNamespace(warnings=("blurred",), objects=(result,))
    monkeypatch.setattr("insertion.insert.insert", lambda *_: inserted)
    monkeypatch.setattr("insertion.insertion_scene.open_scene", lambda _: None)
    request = cast(InsertionRequest, SimpleNamespace(scene=None, out=Path("out")))
    assert run(Namespace(json=False, preview=None, place=None), request, ()) == 0
    out, err = capsys.readouterr()
    assert out.startswith("a.glb: 1 x 0.5 x 0.25 m (length, width, height) on plane 0; 0.5 metres per unit")
    assert out.endswith(f"{ending}\n")
    assert err.splitlines() == ["insert-object: warning: blurred", "insert-object: warning: dark"]


def test_the_command_with_the_chosen_position_has_no_other_position() -> None:
    request = ObjectRequest(Path("a.glb"), at=PixelPosition("3", 1.0, 2.0), facing=90.0)
    argv = ["scene", "--place", "8000", "--model", "a.glb", "--on=couch", "--xy", "1,2"]
    line = "insert-object scene --model a.glb --at frame=3,x=1.0,y=2.0 --facing 90"
    assert command_line([request], argv, has_out=True) == line
    assert command_line([request], ["scene", "--place", "--model", "a.glb"], has_out=False) == f"{line} --out OUT.mp4"
