"""Progress on standard error: bars with the time left on a terminal, a line every ten seconds elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from metric_base.progress import ProgressCallback, with_progress

Item = TypeVar("Item")
#: Seconds between two lines where nobody looks at a terminal.
LINE_S = 10.0


def with_bar(items: Iterable[Item], step: str, total: int | None = None) -> Iterator[Item]:
    """The items, with a bar while they are consumed; total : how many there are, where `items` has no length."""
    with progress_bars() as shown:
        yield from with_progress(items, step, shown, total)


def progress_lines(write: Callable[[str], object], clock: Callable[[], float] = time.monotonic) -> ProgressCallback:
    """Progress as lines, the first one LINE_S seconds after the start and then no more often than that."""
    last = clock()

    def shown(step: str, done: int, total: int | None) -> None:
        nonlocal last
        if clock() - last >= LINE_S:
            last = clock()
            write(f"{step}: {done}\n" if total is None else f"{step}: {done} of {total}\n")

    return shown


@contextmanager
def progress_bars() -> Iterator[ProgressCallback]:
    """A bar for each step that is named, in the order in which they come; they go when all is done."""
    if not sys.stderr.isatty():
        yield progress_lines(sys.stderr.write)
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TaskID,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    left = (TextColumn("left:"), TimeRemainingColumn())
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), *left)
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, TaskID] = {}

        def shown(step: str, done: int, total: int | None) -> None:
            if step not in tasks:
                tasks[step] = bars.add_task(step, total=total)
            bars.update(tasks[step], completed=done, total=total)  # None leaves it as it was

        yield shown
