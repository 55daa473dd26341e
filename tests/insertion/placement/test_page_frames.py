"""Frames of the placement page, and answers to requests that it cannot serve."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from insertion.footage.footage import Frame
from insertion.placement_page import PlacementPage
from insertion.request import ObjectRequest
from metric_base.errors import InputError
from tests.insertion.placement.test_placement_thresholds import view


class Footage(list[Any]):
    """Frames with images."""

    def __init__(self, n: int, posed: range) -> None:
        self.frames = [Frame(k, f"{k}.png", None, view() if k in posed else None, None) for k in range(n)]
        super().__init__((frame, np.full((4, 4, 3), frame.index, np.uint8)) for frame in self.frames)


def page(n: int, posed: range) -> PlacementPage:
    scene: Any = SimpleNamespace(footage=Footage(n, posed))
    return PlacementPage(scene, [ObjectRequest(Path("a.glb"))], None, lambda _: "")


def numbers(made: PlacementPage) -> list[int]:
    _, body = made.answer("start") or ("", b"")
    return [frame["number"] for frame in json.loads(body)["frames"]]


@pytest.mark.parametrize(("n", "n_shown"), [(11, 11), (12, 12), (13, 12), (100, 12)])
def test_a_page_has_at_most_12_frames_from_the_first_to_the_last(n: int, n_shown: int) -> None:
    shown = numbers(page(n, range(n)))
    assert len(shown) == n_shown
    assert (shown[0], shown[-1]) == (0, n - 1)


def test_a_page_has_frames_with_a_pose_only() -> None:
    assert numbers(page(6, range(2, 4))) == [2, 3]
    with pytest.raises(InputError, match="--place: expected a frame with a known pose; found none"):
        page(6, range(0))


def test_only_addresses_of_the_page_are_answered() -> None:
    made = page(3, range(3))
    kinds = {path: (made.answer(path) or ("nothing",))[0] for path in ("", "frame/2", "frame/3", "frame/x", "box/0/1")}
    assert kinds == {
        "": "text/html; charset=utf-8", "frame/2": "image/jpeg", "frame/3": "nothing", "frame/x": "nothing",
        "box/0/1": "nothing",
    }  # fmt: skip
    assert made.receive("start", b"{}") is None
    for body in (b"7", b"{}", b"[", b'{"object": 0, "frame": 9, "x": 1, "y": 1, "facing": 0}'):
        status, answer = made.receive("done", body) or (0, {})
        assert (status, [*answer]) == (400, ["error"])
    assert made.chosen is None
