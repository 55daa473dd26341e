"""A file or folder that one process at a time holds; the system lets go of it when the process ends, killed too."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["hold", "sole_holder"]


@contextmanager
def sole_holder(path: Path) -> Iterator[None]:
    """Holds a file, which is made if it is not there, while the block runs.

    Raises
    ------
    BlockingIOError
        Another process holds it.
    """
    with path.open("a", encoding="ascii") as file:
        _lock(file.fileno())
        yield


def hold(folder: Path) -> int | None:
    """A descriptor that holds a folder until it is closed or the process ends; None if another process holds it."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError:  # gone meanwhile; Windows opens no folder, and keeps its leftovers
        return None
    try:
        _lock(descriptor)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _lock(descriptor: int) -> None:
    if sys.platform == "win32":
        import msvcrt

        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError as error:
            raise BlockingIOError(*error.args) from None
    else:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
