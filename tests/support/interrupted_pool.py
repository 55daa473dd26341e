"""A process pool whose process group is interrupted during its work, as by Ctrl-C in a terminal."""

from __future__ import annotations

import os
import signal
import time

from metric_base.executors import executor_of
from metric_cli.errors import exit_status


def run() -> int:
    """Start work that takes 10 minutes, and interrupt the process group."""
    with executor_of(2, None) as pool:
        assert pool is not None
        pool.submit(os.getpid).result(60)
        pool.submit(time.sleep, 600)
        os.killpg(0, signal.SIGINT)
        time.sleep(600)
    return 0


if __name__ == "__main__":
    raise SystemExit(exit_status("x", run))
