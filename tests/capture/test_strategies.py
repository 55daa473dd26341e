"""Strategies that are worth their time: the quick one for large images, the pooled one after few placed frames."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from capture.mapping.features import MAIN, POOLED, QUICK
from capture.mapping.mapper import ModelReport
from capture.mapping.refusals import refusal
from capture.mapping.search import ModelSearch
from capture.mapping.worker import TimeLimit
from capture.work_folder import WorkFolder
from tests.support.captures import right_model


def search(
    side: int = 2000, n_frames: int = 20, is_video: bool = False, features_s: float = 1.0, matches_s: float = 1.0
) -> ModelSearch:
    """A search of frames with a longer side, after a main strategy of these processor times."""
    work = WorkFolder(Path("work"))
    work.processor_s |= {f"features{MAIN.suffix}": features_s, f"matches{MAIN.suffix}": matches_s}
    times = [0.0] * n_frames if is_video else None
    frames: Any = SimpleNamespace(file_size=(side, side // 2), chosen=[None] * n_frames, times_s=times)
    lens: Any = None
    return ModelSearch(work, "", frames, lens, TimeLimit(0.0), None, lambda *_: None)


@pytest.mark.parametrize(
    ("side", "is_video", "n_frames", "is_tried"),
    [
        (1499, False, 20, False),
        (1500, False, 20, True),
        (599, True, 20, False),
        (600, True, 20, True),
        (1500, False, 5, False),
        (1500, False, 6, True),
    ],
)
def test_the_quick_strategy_is_for_large_images(side: int, is_video: bool, n_frames: int, is_tried: bool) -> None:
    """MIN_QUICK_SIDE of images, MIN_QUICK_VIDEO_SIDE of frames of a video, and MIN_FRAMES."""
    assert search(side, n_frames, is_video).is_worthwhile(QUICK, []) == is_tried


@pytest.mark.parametrize(
    ("reports", "is_tried"),
    [
        ([], True),
        ([ModelReport(model=right_model())], False),
        ([ModelReport(model=right_model(19))], True),
        ([ModelReport(model=right_model(pattern=0.13))], True),
        ([ModelReport(model=right_model(), failure=refusal("drift", "seen"))], True),
    ],
)
def test_the_main_strategy_follows_a_model_that_is_not_certain(reports: list[ModelReport], is_tried: bool) -> None:
    assert search().is_worthwhile(MAIN, reports) == is_tried


@pytest.mark.parametrize(
    ("n_placed", "n_frames", "code", "is_tried"),
    [
        (15, 20, None, True),
        (16, 20, None, False),  # MIN_WHOLE_RATIO of 80 %
        (3, 6, None, True),
        (3, 5, None, False),
        (3, 20, "no_texture", True),
        (3, 20, "static_camera", False),
        (3, 20, "pure_rotation", False),
    ],
)
def test_the_pooled_strategy_follows_a_model_with_few_frames(
    n_placed: int, n_frames: int, code: str | None, is_tried: bool
) -> None:
    report = ModelReport(model=right_model(n_placed), failure=None if code is None else refusal(code, "seen"))
    assert search(n_frames=n_frames).is_worthwhile(POOLED, [report]) == is_tried
    assert not search(n_frames=n_frames).is_worthwhile(POOLED, [])


@pytest.mark.parametrize(
    ("features_s", "matches_s", "is_tried"),
    [
        (23.9, 0.0, True),
        (24.1, 0.0, False),
        (0.0, 59.9, True),
        (0.0, 60.1, False),
        (12.0, 29.9, True),
        (12.0, 30.1, False),
    ],
)
@pytest.mark.parametrize("factor", [1, 2])
def test_the_pooled_strategy_takes_two_minutes_at_most(
    features_s: float, matches_s: float, is_tried: bool, factor: int
) -> None:
    """MAX_POOLED_S: 5 times the features and twice the matches of the main strategy, by the ratio of the pixels."""
    made = search(factor * POOLED.max_side, features_s=factor**2 * features_s, matches_s=factor**2 * matches_s)
    assert made.is_worthwhile(POOLED, [ModelReport(model=right_model(3))]) == is_tried
