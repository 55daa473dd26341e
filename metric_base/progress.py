"""Progress as a callback: whoever works reports how far a step is, and a caller shows it or not. The time of steps."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")

#: Callback with the name of a step, the completed amount, and the total if it is known.
ProgressCallback = Callable[[str, int, int | None], None]
#: Callback with a sentence about the work in progress.
NoticeCallback = Callable[[str], None]


def with_progress(
    items: Iterable[Item], step: str, progress: ProgressCallback, total: int | None = None
) -> Iterator[Item]:
    """Yield the items, and report each when the next is requested; total : number of items without a length.

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
    """Ignore progress."""


def no_notice(_sentence: str) -> None:
    """Ignore notices."""


@contextmanager
def stopwatch(seconds: dict[str, float], step: str) -> Iterator[None]:
    """Add the time that the block takes to `seconds`, under the name of the step."""
    start = time.perf_counter()
    yield
    seconds[step] = seconds.get(step, 0.0) + time.perf_counter() - start
