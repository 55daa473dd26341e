"""Child processes of tests: each ends with its block, or fails the test after a time limit."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

__all__ = ["LIMIT_S", "started"]

#: Maximum duration of a child process in seconds. It is long, so that other load on the machine does not fail a test.
LIMIT_S = 600.0


@contextmanager
def started(words: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """Start a process, and wait for its end after the block.

    `subprocess.Popen` as a context waits without a limit, also after a failed assertion, and so does a read from
    its pipes. This one kills the process if the block raises an error, and after `LIMIT_S`; then the test fails.

    options : arguments of `subprocess.Popen`.
    """
    process = subprocess.Popen(words, **options)
    is_late = threading.Event()

    def end() -> None:
        is_late.set()
        process.kill()

    timer = threading.Timer(LIMIT_S, end)
    timer.daemon = True
    timer.start()
    try:
        with process:
            try:
                yield process
            except BaseException:
                process.kill()
                raise
    finally:
        timer.cancel()
        assert not is_late.is_set(), f"{words}: not ended after {LIMIT_S:g} s"
