"""Limit of processor time per page, so that a slow page does not delay a crawl."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

#: Maximum processor time of a page in seconds: twenty times that of the slowest product page seen.
PAGE_SECONDS = 2.0

#: Seconds until the next interruption if a library has suppressed the last one.
_AGAIN = 0.2


class SlowPage(Exception):
    """A page took more processor time than it may."""


@contextmanager
def processor_budget(seconds: float = PAGE_SECONDS) -> Iterator[None]:
    """Raise `SlowPage` inside the block once it has used so much processor time.

    The system's timer interrupts the main thread between two steps of Python, and inside a search by a regular
    expression. Elsewhere (another thread, a system without such a timer) nothing is bounded.
    """
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return
    before = signal.signal(signal.SIGPROF, _interrupt)
    try:
        signal.setitimer(signal.ITIMER_PROF, seconds, _AGAIN)
        yield
    finally:
        _disarm()
        signal.signal(signal.SIGPROF, before)


def _interrupt(*_: object) -> None:
    raise SlowPage(f"expected a page that is read in {PAGE_SECONDS:g} s of processor time, found a slower one")


def _disarm() -> None:
    """Stop the timer, whatever interrupts that."""
    while True:
        try:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
        except SlowPage:
            continue
        return
