"""Facilities that only some operating systems have: limits of memory, locks, hard links, signal masks, EGL.

Each has a fallback. A limit that does not exist is reported once, as a warning of the logger of this module.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

#: Flags that open a file for reading without waiting for the writer of a pipe, and without conversion of line ends.
READ_FLAGS = os.O_RDONLY | sum(getattr(os, name, 0) for name in ("O_NONBLOCK", "O_CLOEXEC", "O_BINARY"))
#: Sizes of this process in pages.
_PROCESS_SIZE = Path("/proc/self/statm")


@lru_cache
def _report_missing(limit: str) -> None:
    """Report once per process that a limit does not exist."""
    import logging  # not on the path of a query

    logging.getLogger(__name__).warning("this operating system has no %s", limit)


def limit_memory(max_bytes: int) -> None:
    """Limit the memory of this process, until it ends."""
    try:
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (max_bytes if hard < 0 else min(max_bytes, hard), hard))
    except (ImportError, ValueError, OSError):  # Windows; macOS refuses limits below its own
        _report_missing("limit of memory for files of unknown origin")


@contextmanager
def growth_limit(max_bytes: int) -> Iterator[None]:
    """Limit the growth of this process within the block, in bytes."""
    try:
        import resource

        n_pages = int(_PROCESS_SIZE.read_text(encoding="ascii").split()[0])
    except (ImportError, OSError):
        _report_missing("limit of memory for files of unknown origin")
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    limits = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min([n_pages * resource.getpagesize() + max_bytes, *limits]), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def lock(descriptor: int) -> None:
    """Lock an open file until it is closed.

    Raises
    ------
    BlockingIOError
        Another process has locked it.
    """
    if sys.platform == "win32":
        import msvcrt

        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError as error:
            raise BlockingIOError(*error.args) from None
        return
    try:
        import fcntl
    except ImportError:
        _report_missing("lock of a folder against a second run")
    else:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def is_alive(process: int) -> bool:
    """Return whether a process exists; True if the system cannot tell without a signal to it."""
    if sys.platform == "win32":  # signal 0 is Ctrl-C there
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True  # another user's
    return True


def n_cores() -> int:
    """Return the number of cores that this process may use, as a Slurm task, where the system states it."""
    return len(os.sched_getaffinity(0)) if sys.platform.startswith("linux") else os.cpu_count() or 1


def link_or_copy(source: str | Path, target: str | Path) -> None:
    """Hard-link a file that never changes, or copy it if the system or the file system has no links."""
    try:
        os.link(source, target)
    except (OSError, AttributeError):
        import shutil

        shutil.copy2(source, target)


@contextmanager
def interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C for processes that start within the block, where the system can."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def gl_settings() -> dict[str, Any]:
    """Return the settings of an OpenGL context without a window: EGL on Linux, the system's own elsewhere."""
    return {"backend": "egl"} if sys.platform.startswith("linux") else {}
