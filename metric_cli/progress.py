"""Progress on standard error: bars with the remaining time on a terminal, otherwise a line every ten seconds."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from metric_base.progress import ProgressCallback, with_progress

Item = TypeVar("Item")
#: Minimum time between two lines of progress in seconds.
LOG_INTERVAL_S = 10.0


def track(items: Iterable[Item], step: str, total: int | None = None) -> Iterator[Item]:
    """Yield the items and show a progress bar; `total` is their number if `items` has no length."""
    with progress_bars() as progress:
        yield from with_progress(items, step, progress, total)


def progress_lines(write: Callable[[str], object], clock: Callable[[], float] = time.monotonic) -> ProgressCallback:
    """Return a callback that writes progress as lines, at most one per LOG_INTERVAL_S seconds."""
    first = last = clock()

    def progress(step: str, done: int, total: int | None) -> None:
        nonlocal last
        if clock() - last >= LOG_INTERVAL_S:
            last = clock()
            count = str(done) if total is None else f"{done} of {total}"
            left = f", {(last - first) * (total - done) / done:.0f} s left" if total and done else ""
            write(f"{step}: {count} ({last - first:.0f} s{left})\n")

    return progress


@contextmanager
def progress_bars() -> Iterator[ProgressCallback]:
    """Provide a callback that shows a progress bar for each step; the bars disappear at the end."""
    if not sys.stderr.isatty():
        yield progress_lines(sys.stderr.write)
        return
    from rich import progress as rich_bars
    from rich.console import Console

    done = (rich_bars.BarColumn(), rich_bars.MofNCompleteColumn(), rich_bars.TimeElapsedColumn())
    columns = (*done, rich_bars.TextColumn("left:"), rich_bars.TimeRemainingColumn())
    description = rich_bars.TextColumn("{task.description}")
    with rich_bars.Progress(description, *columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, rich_bars.TaskID] = {}

        def progress(step: str, done: int, total: int | None) -> None:
            if step not in tasks:
                tasks[step] = bars.add_task(step, total=total)
            bars.update(tasks[step], completed=done, total=total)  # None: unchanged

        yield progress
