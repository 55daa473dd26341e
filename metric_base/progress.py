"""Progress as a callback: whoever works reports how far a step is, and a caller shows it or not. The time of steps."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")

#: What is called with the name of a step, how much of it is done and, once known, of how much.
ProgressCallback = Callable[[str, int, int | None], None]
#: What is called with a sentence about how the work is done, while it is done.
NoticeCallback = Callable[[str], None]


def with_progress(
    items: Iterable[Item], step: str, progress: ProgressCallback, total: int | None = None
) -> Iterator[Item]:
    """The items, each reported when its consumer asks for the next; total : where `items` has no length.

    >>> list(with_progress("ab", "letters", lambda *report: print(report)))
    ('letters', 0, 2)
    ('letters', 1, 2)
    ('letters', 2, 2)
    ['a', 'b']
    """
    if total is None and isinstance(items, Sized):
        total = len(items)
    progress(step, 0, total)
    for done, item in enumerate(items, 1):
        yield item
        progress(step, done, total)


def silent(_step: str, _done: int, _total: int | None) -> None:
    """Progress that nobody looks at."""


def no_notice(_sentence: str) -> None:
    """Notices that nobody reads."""


@contextmanager
def stopwatch(seconds: dict[str, float], step: str) -> Iterator[None]:
    """Add the time that the block takes to `seconds`, under the name of the step."""
    start = time.perf_counter()
    yield
    seconds[step] = seconds.get(step, 0.0) + time.perf_counter() - start
