"""Progress on standard error: bars with the time left on a terminal, nothing elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from metric_base.progress import ProgressCallback, silent, with_progress

__all__ = ["progress_bars", "with_bar"]

Item = TypeVar("Item")


def with_bar(items: Iterable[Item], step: str, total: int | None = None) -> Iterator[Item]:
    """The items, with a bar while they are consumed; total : how many there are, where `items` has no length."""
    with progress_bars() as shown:
        yield from with_progress(items, step, shown, total)


@contextmanager
def progress_bars() -> Iterator[ProgressCallback]:
    """A bar for each step that is named, in the order in which they come; they go when all is done."""
    if not sys.stderr.isatty():
        yield silent
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
