"""A request to terminate as an exception, so that every temporary file and folder is removed on the way out."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["Terminated", "keep_termination", "orderly_termination"]


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


def keep_termination() -> None:
    """Take SIGTERM back after the import of a library that put a handler of its own in place (pycolmap's glog does)."""
    ours = threading.current_thread() is threading.main_thread()
    if ours and signal.getsignal(signal.SIGTERM) is _terminate:
        signal.signal(signal.SIGTERM, _terminate)


def _terminate(_number: int, _frame: FrameType | None) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # one is enough; the way out takes a moment
    raise Terminated
