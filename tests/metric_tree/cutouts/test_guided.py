"""Cut-outs by a guide: the edge of the marked object, and guides that a reviewer rejected."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from metric_base.errors import InputError
from metric_tree.cutouts.backend import Guide, Settings
from metric_tree.cutouts.guided import grabcut_state, guided_foreground, guides
from metric_tree.cutouts.release_cutouts import cut

ID = "a" * 64


def heap() -> tuple[np.ndarray, np.ndarray]:
    """An image of three discs that touch, with grain, and the mask of the middle one."""
    picture = np.full((200, 300, 3), (60, 90, 60), np.uint8)
    mask = np.zeros((200, 300), np.uint8)
    for x, colour in ((90, (200, 120, 30)), (210, (190, 40, 40)), (150, (230, 200, 60))):
        cv2.circle(picture, (x, 100), 42, colour, -1)
    cv2.circle(mask, (150, 100), 42, 1, -1)
    noise = np.random.default_rng(0).normal(0, 4, picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8), mask > 0


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    return float((one & other).sum() / (one | other).sum())


@pytest.mark.parametrize(
    "way",
    [
        {"polygon": [(112, 82), (135, 58), (172, 62), (192, 95), (180, 135), (140, 142), (110, 118)]},
        {"box": (106, 56, 90, 90), "object": (((140, 100), (160, 100)),)},
    ],
    ids=["polygon", "box"],
)
def test_the_edge_is_the_objects_and_not_the_guides(way: dict[str, object]) -> None:
    picture, mask = heap()
    guide = Guide(picture=ID, reviewer="Ada", **way)  # type: ignore[arg-type]
    found = guided_foreground(picture, guide)
    assert (found.method, found.refused) == ("guided", None)
    assert overlap(found.alpha > 127, mask) > 0.93
    assert np.array_equal(found.alpha, guided_foreground(picture, guide).alpha)


def test_a_cut_that_its_reviewer_finds_poor_is_set_aside_and_an_orange_among_oranges_is_not() -> None:
    picture, _ = heap()
    png = cv2.imencode(".png", picture[..., ::-1])[1].tobytes()
    polygon = ((110.0, 80.0), (190.0, 80.0), (190.0, 120.0), (110.0, 120.0))
    good = Guide(picture=ID, polygon=polygon, reviewer="Ada")
    poor = Guide(picture=ID, polygon=polygon, reviewer="Ada", verdict="poor", why="fingers")
    assert cut(ID, png, Settings("plain", drawn=(good,))).method == "guided"
    assert cut(ID, png, Settings("plain", drawn=(good,))).set_aside is None
    assert cut(ID, png, Settings("plain", drawn=(poor,))).set_aside == "poor"
    undrawn = Guide(picture=ID, reviewer="Ada", verdict="poor", why="a heap")
    assert cut(ID, png, Settings("plain", drawn=(undrawn,))).set_aside == "poor"
    outside = Guide(picture=ID, box=(900, 900, 5, 5), reviewer="Ada")
    assert cut(ID, png, Settings("plain", drawn=(outside,))).set_aside == "empty"


@pytest.mark.parametrize(
    ("change", "named"),
    [({"picture": "b"}, "picture"), ({"polygon": [[1, 1]]}, "polygon"), ({"verdict": "poor"}, "why"), ({"x": 1}, "x")],
)
def test_a_wrong_line_is_named(change: dict[str, object], named: str, tmp_path: Path) -> None:
    line = {"picture": ID, "polygon": [[0, 0], [9, 0], [9, 9]], "reviewer": "Ada"}
    (file := tmp_path / "guides.jsonl").write_text(json.dumps(line) + "\n" + json.dumps(line | change) + "\n")
    with pytest.raises(InputError, match=named) as raised:
        guides(file)
    assert ":2" in str(raised.value)


@pytest.mark.parametrize(("distance", "label"), [(9, cv2.GC_PR_BGD), (10, cv2.GC_BGD)])
def test_the_edge_of_an_object_is_within_9_percent_of_its_shorter_side(distance: int, label: int) -> None:
    guide = Guide(picture=ID, box=(100, 100, 200, 100), reviewer="a")
    assert grabcut_state(guide, (400, 400))[150, 100 - distance] == label


def test_pixels_farther_than_the_tolerance_inside_a_polygon_are_certain() -> None:
    corners = ((100, 100), (300, 100), (300, 200), (100, 200))
    state = grabcut_state(Guide(picture=ID, polygon=corners, reviewer="a"), (400, 400))
    assert state[150, 108] == cv2.GC_PR_FGD
    assert state[150, 110] == cv2.GC_FGD
