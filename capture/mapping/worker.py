"""Run one step of the reconstruction in a worker process, within a time limit.

pycolmap runs in a separate process, because an abort in C++ ends the whole process. The worker prints JSON lines:
`{"done": 3, "of": 40}` for progress, and one line `{"result": ...}` at the end (see `colmap_worker`).
"""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from metric_base.progress import ProgressCallback, silent

#: Default processor time for a model or a refusal, in seconds: the searches that succeeded on real images took at most
#: 6 minutes. Processor time is limited rather than wall time, so that the result does not depend on the load.
MAX_TIME_S = 900.0
#: Default processor time per frame, if that is more: the first search takes 1 to 3 s per frame.
SECONDS_PER_FRAME = 6.0
#: Maximum wall time as a multiple of the processor time that is left: a worker that hangs uses no processor time.
MAX_WALL_RATIO = 10.0
#: Minimum free disk space in bytes; below it, a failed step is reported as a full disk.
MIN_FREE_BYTES = 1 << 16
#: Messages of COLMAP, SQLite and the system that indicate a full disk.
_DISK_FULL = re.compile(r"no space left|disk is full|disk i/o error|file too large|quota exceeded", re.IGNORECASE)
#: Signal that ends a process at its limit of processor time; an impossible number where the system has none.
_OVER_TIME = int(getattr(signal, "SIGXCPU", 0)) or 10**6

COLMAP_WORKER = "capture.mapping.colmap_worker"


class OutOfTime(Exception):
    """A step was ended at its time limit."""


class WorkerError(RuntimeError):
    """A step ended without a result; the message contains its exit status and the last line of its log."""


def processor_s() -> float:
    """Return the processor time of this process and of its finished children, in seconds."""
    return sum(os.times()[:4])


@dataclass(frozen=True, slots=True)
class TimeLimit:
    """A deadline in wall time or in processor time."""

    until_s: float  #: Seconds on the monotonic clock, or on the clock of `processor_s` if `of_processor`.
    of_processor: bool = False

    def now_s(self) -> float:
        """Return the current time on the clock of the limit, in seconds."""
        return processor_s() if self.of_processor else time.monotonic()

    @property
    def left_s(self) -> float:
        """Seconds until the deadline, at least 0."""
        return max(self.until_s - self.now_s(), 0.0)

    @property
    def wall_left_s(self) -> float:
        """Wall time in seconds after which a step is ended in any case."""
        return self.left_s * (MAX_WALL_RATIO if self.of_processor else 1.0)


def limit_of(n_frames: int, max_time_s: float | None = None) -> TimeLimit:
    """Return the limit for a number of frames: `max_time_s` of wall time, or the default processor time."""
    if max_time_s is not None:
        return TimeLimit(time.monotonic() + max_time_s)
    return TimeLimit(processor_s() + max(MAX_TIME_S, SECONDS_PER_FRAME * n_frames), of_processor=True)


def run_worker(
    step: str,
    request: dict[str, Any],
    folder: Path,
    *,
    progress: ProgressCallback = silent,
    limit: TimeLimit | None = None,
    module: str = COLMAP_WORKER,
) -> Any:
    """Run a step in a worker process and return its result.

    Parameters
    ----------
    step : str
        Name of the step in `module`.
    request : dict
        Arguments of the step, as JSON.
    folder : Path
        Existing folder for the request and the log.
    progress : callable
        Called with the step, the number of items done and their total.
    limit : TimeLimit, optional
    module : str
        Module that is run with `python -m`.

    Raises
    ------
    OutOfTime
        The step was ended at the limit.
    WorkerError
        The step ended without a result.
    OSError
        The disk is full (`ENOSPC`).
    """
    file, log = folder / f"{step}.request.json", folder / f"{step}.log"
    file.write_text(json.dumps(request), encoding="utf-8")
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", module, step, str(file), str(os.getpid())]
    if limit is not None and limit.of_processor:
        command.append(str(int(limit.left_s) + 1))
    with log.open("w") as errors:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment)
    timer = threading.Timer(0.0 if limit is None else limit.wall_left_s, process.kill)
    timer.daemon = True
    if limit is not None:
        timer.start()
    result: Any = None
    assert process.stdout is not None  # a pipe
    try:
        for line in process.stdout:
            try:
                row = json.loads(line)
            except ValueError:  # libraries print to standard output, too
                continue
            if isinstance(row, dict) and "result" in row:
                result = row["result"]
            elif isinstance(row, dict) and "done" in row:
                progress(step, row["done"], row["of"])
        status = process.wait()
    finally:
        timer.cancel()
        if process.poll() is None:
            process.kill()
            process.wait()
    if result is None and limit is not None and (not limit.left_s or status == -_OVER_TIME):
        raise OutOfTime(step)
    if status != 0 or result is None:
        raise _worker_error(step, status, log)
    return result


def _worker_error(step: str, status: int, log: Path) -> OSError | WorkerError:
    """Return the error of a step without a result: a full disk, or its status with the last line of its log."""
    text = log.read_text(encoding="utf-8", errors="replace") if log.is_file() else ""
    if _DISK_FULL.search(text) or shutil.disk_usage(log.parent).free < MIN_FREE_BYTES:
        return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(log.parent))
    ending = f"ended with status {status}" if status >= 0 else f"was ended by {signal.Signals(-status).name}"
    last_line = text.splitlines()[-1][:300] if text.splitlines() else "no log"
    return WorkerError(f"the reconstruction step {step!r} {ending}: {last_line}")
