"""Run a command in a child process and measure its processor time and peak memory."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

__all__ = ["ChildRun", "ours", "run_child"]

#: Interval in seconds at which a running process is polled.
POLL_S = 0.02
#: Modules with the `main` function of the programs.
PROGRAMS = {
    "metric-tree": "metric_cli.subcommands",
    "estimate-scale": "metric_cli.estimate_scale.estimate",
    "insert-object": "metric_cli.insert_object.insert",
}


@dataclass(frozen=True, slots=True)
class ChildRun:
    """Result of a command that ended or was killed at its time limit (`timed_out`).

    cpu_s : processor seconds of the process and of the children that it waited for.
    peak_mib : peak resident memory of the process, without its children.
    """

    status: int
    timed_out: bool
    cpu_s: float
    wall_s: float
    peak_mib: float
    output: str
    errors: str


def ours(program: str, *words: object) -> list[str]:
    """Return the command line of one of our three programs in this interpreter."""
    code = f"import sys; from {PROGRAMS[program]} import main; sys.exit(main(sys.argv[1:]))"
    return [sys.executable, "-c", code, *map(str, words)]


def run_child(
    words: Sequence[str], limit_s: float = float("inf"), environment: Mapping[str, str] | None = None
) -> ChildRun:
    """Run a command, and kill its process group with SIGKILL after `limit_s` seconds.

    environment : variables in addition to the environment of this process.
    """
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        started, peak_kib = time.monotonic(), 0
        process = subprocess.Popen(
            words, stdout=out, stderr=err, env=os.environ | dict(environment or {}), start_new_session=True
        )
        ended = timed_out = False
        while not ended:
            peak_kib = max(peak_kib, _peak_kib(process.pid))
            if not timed_out and time.monotonic() - started > limit_s:
                timed_out = True
                os.killpg(process.pid, signal.SIGKILL)
            pid, status, usage = os.wait4(process.pid, 0 if timed_out else os.WNOHANG)
            ended = pid != 0
            time.sleep(0 if ended else POLL_S)
        process.returncode = os.waitstatus_to_exitcode(status)
        wall_s, texts = time.monotonic() - started, []
        for file in (out, err):
            file.seek(0)
            texts.append(file.read().decode("utf-8", "replace"))
    return ChildRun(
        process.returncode, timed_out, usage.ru_utime + usage.ru_stime, wall_s, peak_kib / 1024, texts[0], texts[1]
    )


def _peak_kib(pid: int) -> int:
    """Return the peak memory of a running process. The value of `wait4` includes the memory of the parent."""
    try:
        status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    except OSError:  # the process has ended
        return 0
    return next((int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")), 0)
