"""Limit of processor time per page, so that a slow page does not delay a crawl."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

#: Maximum processor time of a page in seconds: twenty times that of the slowest product page seen.
PAGE_SECONDS = 2.0

#: Time until the next interruption in seconds, because a library may suppress one.
REPEAT_SECONDS = 0.2


class SlowPage(Exception):
    """A page exceeded its limit of processor time."""


@contextmanager
def processor_budget(seconds: float = PAGE_SECONDS) -> Iterator[None]:
    """Raise `SlowPage` inside the block after `seconds` of processor time.

    A timer of the operating system interrupts the main thread between two steps of Python, and during the search of a
    regular expression. In other threads, and on systems without this timer, there is no limit.
    """
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return

    def interrupt(*_: object) -> None:
        raise SlowPage(f"expected a page that is read in {PAGE_SECONDS:g} s of processor time, found a slower one")

    before = signal.signal(signal.SIGPROF, interrupt)
    try:
        signal.setitimer(signal.ITIMER_PROF, seconds, REPEAT_SECONDS)
        yield
    finally:
        is_armed = True
        while is_armed:
            with suppress(SlowPage):  # the timer may interrupt its own removal
                signal.setitimer(signal.ITIMER_PROF, 0.0)
                is_armed = False
        signal.signal(signal.SIGPROF, before)
