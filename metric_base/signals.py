"""Requests to stop: termination as an exception, so that temporary files are removed; Ctrl-C from the start on."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from types import FrameType

__all__ = ["Terminated", "estimate_scale", "insert_object", "keep_termination", "metric_tree", "orderly_termination"]

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


def keep_termination() -> None:
    """Take SIGTERM back after the import of a library that put a handler of its own in place (pycolmap's glog does)."""
    ours = threading.current_thread() is threading.main_thread()
    if ours and signal.getsignal(signal.SIGTERM) is _terminate:
        signal.signal(signal.SIGTERM, _terminate)


def _terminate(_number: int, _frame: FrameType | None) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # one is enough; the way out takes a moment
    raise Terminated


def metric_tree() -> int:
    """The console script `metric-tree`."""
    return _start("metric_tree.commands", "metric-tree")


def estimate_scale() -> int:
    """The console script `estimate-scale`."""
    return _start("estimator.command", "estimate-scale")


def insert_object() -> int:
    """The console script `insert-object`."""
    return _start("insertion.command", "insert-object")


def _start(module: str, program: str) -> int:
    """Import a command and run it: the import takes half a second, in which Ctrl-C is one line, too."""
    try:
        status: int = import_module(module).main()
    except KeyboardInterrupt:
        with suppress(OSError):  # nobody reads it
            sys.stderr.write(f"{program}: interrupted\n")
        return INTERRUPTED
    return status
