"""The process that runs pycolmap: started, followed and reported on."""

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
from pathlib import Path
from typing import Any

from estimator.capture.mapping.time_limit import OutOfTime, TimeLimit
from metric_base.progress import ProgressCallback, silent

__all__ = ["WorkerError", "start_worker", "wait_for_worker"]

#: What COLMAP, SQLite and the system say of a disk without room, and how little is too little for a log.
_FULL = re.compile(r"no space left|disk is full|disk i/o error|file too large|quota exceeded", re.IGNORECASE)
LEAST_FREE_BYTES = 1 << 16

#: The signal that ends a process whose processor time is used up.
OVER_TIME = int(getattr(signal, "SIGXCPU", 0)) or 10**6

COLMAP_WORKER = "estimator.capture.mapping.colmap_worker"


class WorkerError(RuntimeError):
    """A step of the reconstruction ended without a result; the message says how, and where its log is."""


def start_worker(
    step: str, request: dict[str, Any], scratch: Path, module: str = COLMAP_WORKER, limit: TimeLimit | None = None
) -> subprocess.Popen[str]:
    """Start a step of a module; its request and its log are in `scratch`; limit : of its processor time."""
    file = scratch / f"{step}.request.json"
    file.write_text(json.dumps(request), encoding="utf-8")
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    seconds = [] if limit is None or limit.worker_s is None else [str(limit.worker_s)]
    with (scratch / f"{step}.log").open("w") as log:
        return subprocess.Popen(
            [sys.executable, "-m", module, step, str(file), str(os.getpid()), *seconds],
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            env=environment,
        )


def wait_for_worker(
    process: subprocess.Popen[str],
    step: str,
    log: Path,
    progress: ProgressCallback = silent,
    total: int | None = None,
    limit: TimeLimit | None = None,
) -> Any:
    """The result of a step, with its progress passed on; total : of what it counts, unless it says so itself.

    Raises
    ------
    OutOfTime
        It was ended at the limit.
    WorkerError
        It ended without a result.
    OSError
        It did because the disk is full (ENOSPC).
    """
    result: Any = None
    timer = None if limit is None else threading.Timer(limit.wall_left_s, process.kill)
    if timer is not None:
        timer.daemon = True
        timer.start()
    assert process.stdout is not None  # asked for
    try:
        for line in process.stdout:
            row = _row(line)
            if "result" in row:
                result = row["result"]
            elif "done" in row:
                progress(step, row["done"], row.get("of", total))
        status = process.wait()
    finally:
        if timer is not None:
            timer.cancel()
        if process.poll() is None:
            process.kill()
            process.wait()
    if result is None and limit is not None and (not limit.left_s or status == -OVER_TIME):
        raise OutOfTime(step)
    if (status != 0 or result is None) and _disk_is_full(log):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(log.parent))
    if status != 0 or result is None:
        raise WorkerError(f"the reconstruction step {step!r} {_ending(status)}: {_last_line(log)}")
    return result


def _disk_is_full(log: Path) -> bool:
    """Whether a step ended for want of room: by its log, or because there is none for a log either."""
    text = log.read_text(encoding="utf-8", errors="replace") if log.is_file() else ""
    return bool(_FULL.search(text)) or shutil.disk_usage(log.parent).free < LEAST_FREE_BYTES


def _row(line: str) -> dict[str, Any]:
    """A line of progress; libraries may write to standard output, too."""
    try:
        row = json.loads(line)
    except ValueError:
        return {}
    return row if isinstance(row, dict) else {}


def _ending(status: int) -> str:
    if status < 0:
        return f"was ended by {signal.Signals(-status).name}"
    return f"ended with status {status}"


def _last_line(log: Path) -> str:
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines() if log.is_file() else []
    return lines[-1][:300] if lines else "no log"
