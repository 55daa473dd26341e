"""The time that a capture may take, and what it is spent on."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from capture.mapping import worker as time_limit
from capture.mapping.refusals import CaptureFailure
from capture.mapping.worker import (
    MAX_TIME_S,
    OutOfTime,
    TimeLimit,
    limit_of,
    processor_s,
    start_worker,
    wait_for_worker,
)
from capture.pipeline import capture_video
from metric_base.errors import InputError

VIDEO = Path("data/scenes/demo_video/video.mp4")


def test_a_worker_is_ended_at_its_limit(tmp_path: Path) -> None:
    process = start_worker("features", {"cameras": []}, tmp_path)
    with pytest.raises(OutOfTime):
        wait_for_worker(process, "features", tmp_path / "features.log", limit=TimeLimit(time.monotonic()))
    assert process.poll() is not None


@pytest.mark.skipif(sys.platform == "win32", reason="a process has no limit of processor time there")
def test_a_worker_is_ended_when_its_processor_time_is_used_up(tmp_path: Path) -> None:
    limit = TimeLimit(processor_s() + 0.5, of_processor=True)
    process = start_worker("busy", {}, tmp_path, "tests.support.busy_worker", limit)
    before = processor_s()
    with pytest.raises(OutOfTime):
        wait_for_worker(process, "busy", tmp_path / "busy.log", limit=TimeLimit(before + 600, of_processor=True))
    assert processor_s() - before > 0.5
    assert process.poll() is not None


def test_a_capture_ends_in_time_and_says_what_was_left(tmp_path: Path) -> None:
    with pytest.raises(CaptureFailure) as refusal:
        capture_video(VIDEO, tmp_path / "w", frames=40, max_time_s=1)
    assert refusal.value.failure.code == "out_of_time"
    assert "left for lack of time, see --max-time: quick SIFT; SIFT" in refusal.value.failure.message
    assert not (tmp_path / "w" / "sparse").exists()
    with pytest.raises(InputError, match="--max-time"):
        capture_video(VIDEO, tmp_path / "w", max_time_s=0)


def test_the_limit_grows_with_the_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time_limit, "time", SimpleNamespace(monotonic=lambda: 1000.0))
    monkeypatch.setattr(time_limit, "processor_s", lambda: 50.0)
    by_default, stated = limit_of(10), limit_of(1000, 30)
    assert (by_default.of_processor, stated.of_processor) == (True, False)
    assert (by_default.left_s, limit_of(1000).left_s, stated.left_s) == (MAX_TIME_S, 6000, 30)
    assert (by_default.within(5).left_s, stated.within(5).left_s) == (5, 5)
    assert by_default.within(5).wall_left_s > stated.within(5).wall_left_s == 5
    assert (by_default.within(5).worker_s, stated.worker_s) == (6, None)
