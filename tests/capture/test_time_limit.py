"""The time limit of a capture, and its use by the stages."""

from __future__ import annotations

import errno
import signal
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import TextIO

import pytest

from capture.mapping import worker as time_limit
from capture.mapping.refusals import CaptureFailure
from capture.mapping.worker import (
    OutOfTime,
    TimeLimit,
    WorkerError,
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


class _Process:
    """A worker that prints lines, and ends with a status after it wrote a log."""

    def __init__(self, lines: list[str], status: int) -> None:
        self.stdout, self._status = iter(lines), status

    def wait(self) -> int:
        return self._status

    poll = wait

    def kill(self) -> None:
        pass


@pytest.mark.parametrize(
    ("log", "free", "expected"),
    [
        ("no space left on device", 1 << 30, OSError),
        ("The database disk is FULL", 1 << 30, OSError),
        ("killed", (1 << 16) - 1, OSError),
        ("killed", 1 << 16, WorkerError),
    ],
)
def test_a_step_that_fails_on_a_full_disk_names_the_disk(
    log: str, free: int, expected: type[Exception], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MIN_FREE_BYTES of 65,536."""

    def start(*_: object, stderr: TextIO, **__: object) -> _Process:
        stderr.write(log)
        return _Process(["{}"], 1)

    monkeypatch.setattr(time_limit.subprocess, "Popen", start)
    monkeypatch.setattr(time_limit.shutil, "disk_usage", lambda _: SimpleNamespace(free=free))
    with pytest.raises(expected) as raised:
        run_worker("features", {}, tmp_path)
    if isinstance(raised.value, OSError):
        assert raised.value.errno == errno.ENOSPC
    else:
        assert str(raised.value) == "the reconstruction step 'features' ended with status 1: killed"


@pytest.mark.parametrize(
    ("lines", "status", "words"),
    [
        ([], 0, "ended with status 0: no log"),  # without a result
        (['{"result": 1}'], 2, "ended with status 2"),
        ([], -9, "was ended by SIGKILL"),
    ],
)
def test_a_step_ends_with_a_result_and_status_0(
    lines: list[str], status: int, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(time_limit.subprocess, "Popen", lambda *_, **__: _Process(lines, status))
    with pytest.raises(WorkerError, match=words):
        run_worker("features", {}, tmp_path)


def test_the_output_of_a_step_is_progress_and_a_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = ["a library", "[1]", '{"done": 1, "of": 3}', '{"other": 1}', '{"result": {"a": 1}}']
    monkeypatch.setattr(time_limit.subprocess, "Popen", lambda *_, **__: _Process(lines, 0))
    seen: list[tuple[str, int, int]] = []
    found = run_worker("features", {"x": 2}, tmp_path, progress=lambda *row: seen.append(row))  # type: ignore[arg-type]
    assert found == {"a": 1}
    assert seen == [("features", 1, 3)]
    assert (tmp_path / "features.request.json").read_text() == '{"x": 2}'


@pytest.mark.parametrize(
    ("left_s", "status", "is_late"), [(0.0, 1, True), (10.0, -int(signal.SIGXCPU), True), (10.0, 1, False)]
)
def test_a_step_without_a_result_at_its_limit_is_out_of_time(
    left_s: float, status: int, is_late: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(time_limit.subprocess, "Popen", lambda *_, **__: _Process([], status))
    limit = TimeLimit(time.monotonic() + left_s)
    with pytest.raises(OutOfTime if is_late else WorkerError):
        run_worker("features", {}, tmp_path, limit=limit)
