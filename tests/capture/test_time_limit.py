"""The time limit of a capture, and its use by the stages."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from capture.mapping import worker as time_limit
from capture.mapping.refusals import CaptureFailure
from capture.mapping.worker import (
    OutOfTime,
    TimeLimit,
    limit_of,
    processor_s,
    run_worker,
)
from capture.pipeline import capture_video
from metric_base.errors import InputError

VIDEO = Path("data/scenes/demo_video/video.mp4")
#: Module of a worker that never ends.
BUSY = "tests.support.busy_worker"


def test_a_worker_is_ended_at_its_limit(tmp_path: Path) -> None:
    before = time.monotonic()
    with pytest.raises(OutOfTime):
        run_worker("busy", {}, tmp_path, limit=TimeLimit(before + 0.2), module=BUSY)
    assert time.monotonic() - before < 60


@pytest.mark.skipif(sys.platform == "win32", reason="a process has no limit of processor time there")
def test_a_worker_is_ended_when_its_processor_time_is_used_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time_limit, "MAX_WALL_RATIO", 1000.0)  # on a loaded machine half a second takes long
    before = processor_s()
    with pytest.raises(OutOfTime):
        run_worker("busy", {}, tmp_path, limit=TimeLimit(before + 0.5, of_processor=True), module=BUSY)
    assert processor_s() - before > 0.5


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
    assert (by_default.left_s, limit_of(1000).left_s, stated.left_s) == (900, 6000, 30)
    assert by_default.wall_left_s > 900
    assert stated.wall_left_s == 30
