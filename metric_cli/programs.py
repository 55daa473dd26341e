"""The console scripts. A command is imported inside them, so that Ctrl-C is one line from the start on.

A request to terminate as an exception, so that temporary files are removed.

How many threads the products of matrices take, decided before NumPy is loaded.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from types import FrameType

#: The exit status after Ctrl-C.
INTERRUPTED = 130
#: Where a user says how many threads NumPy's BLAS takes.
THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


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


def metric_tree() -> int:
    """The console script `metric-tree`."""
    return _start("metric_cli.subcommands", "metric-tree")


def estimate_scale() -> int:
    """The console script `estimate-scale`."""
    return _start("metric_cli.estimate_scale.estimate", "estimate-scale")


def insert_object() -> int:
    """The console script `insert-object`."""
    return _start("metric_cli.insert_object.insert", "insert-object")


def _start(module: str, program: str) -> int:
    """Import a command and run it: the import takes half a second, in which Ctrl-C is one line, too."""
    try:
        status: int = import_module(module).main()
    except KeyboardInterrupt:
        with suppress(OSError):  # nobody reads it
            sys.stderr.write(f"{program}: interrupted\n")
        return INTERRUPTED
    return status


def use_one_thread() -> None:
    """One, where the user says nothing: products are small here, and threads that wait for them cost more than they do.

    A sum over several threads also ends in other last bits, and then a release that is built again differs.
    """
    if not any(name in os.environ for name in THREAD_VARIABLES):
        os.environ[THREAD_VARIABLES[0]] = "1"
