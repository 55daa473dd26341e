"""Console scripts, which import their commands late; SIGTERM as an exception; number of threads of NumPy."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from types import FrameType

#: Exit status after Ctrl-C.
INTERRUPTED = 130
#: Environment variables that set the number of threads of the BLAS of NumPy.
THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class Terminated(BaseException):
    """The program received SIGTERM."""


@contextmanager
def orderly_termination() -> Iterator[None]:
    """Raise `Terminated` on SIGTERM within the block, so that temporary files are removed; keep any other handler."""
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def terminate(_number: int, _frame: FrameType | None) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a second signal must not interrupt the clean-up
        raise Terminated

    signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def metric_tree() -> int:
    """Run the console script `metric-tree`."""
    return _start("metric_cli.subcommands", "metric-tree")


def estimate_scale() -> int:
    """Run the console script `estimate-scale`."""
    return _start("metric_cli.estimate_scale.estimate", "estimate-scale")


def insert_object() -> int:
    """Run the console script `insert-object`."""
    return _start("metric_cli.insert_object.insert", "insert-object")


def _start(module: str, program: str) -> int:
    """Import and run a command. Ctrl-C during the import, which takes half a second, also ends with one line."""
    try:
        status: int = import_module(module).main()
    except KeyboardInterrupt:
        with suppress(OSError):  # standard error is closed
            sys.stderr.write(f"{program}: interrupted\n")
        return INTERRUPTED
    return status


def use_one_thread() -> None:
    """Use one thread unless the user specifies a number: for small matrices, threads cost more time than they save.

    A sum over several threads also differs in the last bits, and with it a release that is built again.
    """
    if not any(name in os.environ for name in THREAD_VARIABLES):
        os.environ[THREAD_VARIABLES[0]] = "1"
