"""Progress on standard error: bars with the time left on a terminal, nothing elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager
from typing import TypeVar

__all__ = ["ProgressCallback", "progress", "progress_bar", "progress_bars"]

Item = TypeVar("Item")

#: What is called with the name of a step, how much of it is done and, once known, of how much.
ProgressCallback = Callable[[str, int, int | None], None]


def progress(items: Iterable[Item], step: str, total: int | None = None) -> Iterator[Item]:
    """The items, with a bar while they are consumed; total : how many there are, where `items` has no length."""
    if total is None and isinstance(items, Sized):
        total = len(items)
    with progress_bars() as shown:
        shown(step, 0, total)
        for done, item in enumerate(items, 1):
            yield item
            shown(step, done, total)


@contextmanager
def progress_bar(step: str, total: int | None = None) -> Iterator[Callable[[int, int | None], None]]:
    """One bar; what it yields is called with how much is done and, once known, of how much."""
    with progress_bars() as shown:
        shown(step, 0, total)
        yield lambda done, of: shown(step, done, of)


@contextmanager
def progress_bars() -> Iterator[ProgressCallback]:
    """A bar for each step that is named, in the order in which they come; they go when all is done."""
    if not sys.stderr.isatty():
        yield _silent
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


def _silent(_step: str, _done: int, _total: int | None) -> None:
    """Nothing is shown where nobody looks."""
