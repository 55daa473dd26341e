"""A request to terminate as an exception, so that temporary files are removed."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["INTERRUPTED", "Terminated", "orderly_termination"]

#: The exit status after Ctrl-C.
INTERRUPTED = 130


class Terminated(BaseException):
    """The system or a person asked the program to terminate (SIGTERM)."""


@contextmanager
def orderly_termination() -> Iterator[None]:
    """Within the block SIGTERM raises `Terminated`; a handler that someone else set stays."""
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _terminate(_number: int, _frame: FrameType | None) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # one is enough; the way out takes a moment
    raise Terminated
