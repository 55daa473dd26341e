"""Processor time of a call in a process that other tests have used."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable

__all__ = ["processor_seconds"]


def processor_seconds(call: Callable[[], object], limit: float, runs: int = 3) -> float:
    """Return the processor time (s) of the first of up to `runs` calls that takes less than `limit`, or the least one.

    The garbage collector is paused: a collection of everything that earlier tests of the process left in memory takes
    a second or more and can fall into any call. On a shared machine single calls still take twice their usual time,
    therefore a call is repeated before it counts as slow.
    """
    is_collecting = gc.isenabled()
    gc.disable()
    try:
        seconds = [_seconds(call)]
        while min(seconds) >= limit and len(seconds) < runs:
            seconds.append(_seconds(call))
        return min(seconds)
    finally:
        if is_collecting:
            gc.enable()


def _seconds(call: Callable[[], object]) -> float:
    start = time.process_time()  # independent of other load on the machine
    call()
    return time.process_time() - start
