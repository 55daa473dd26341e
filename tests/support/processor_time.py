"""Processor time of a call in a process that other tests have used."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable

__all__ = ["processor_seconds"]


def processor_seconds(call: Callable[[], object], runs: int = 3) -> float:
    """Return the least processor time (s) of up to `runs` calls.

    The garbage collector is paused: a collection of everything that earlier tests of the process left in memory takes
    a second or more and can fall into any call. On a shared machine single calls still take twice their usual time,
    therefore the least of several calls counts.
    """
    is_collecting = gc.isenabled()
    gc.disable()
    try:
        return min(_seconds(call) for _ in range(runs))
    finally:
        if is_collecting:
            gc.enable()


def _seconds(call: Callable[[], object]) -> float:
    start = time.process_time()  # independent of other load on the machine
    call()
    return time.process_time() - start
