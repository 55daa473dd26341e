"""Local and Dask executors for work on shards."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context
from typing import Any, TypeVar

from metric_base.errors import InputError
from metric_base.operating_system import interrupts_blocked

_R = TypeVar("_R")
#: How long a Dask scheduler may take to answer, in seconds.
SCHEDULER_TIMEOUT = 10


class _Pool(ProcessPoolExecutor):
    """Processes that leave an interrupt to their parent, which ends them.

    The mask is inherited from before their first line: an initializer would come after seconds of imports.
    """

    def submit(self, fn: Callable[..., _R], /, *args: Any, **kwargs: Any) -> Future[_R]:
        """As of the base; a worker that it starts has the interrupt blocked."""
        with interrupts_blocked():
            return super().submit(fn, *args, **kwargs)


@contextmanager
def executor_of(workers: int, scheduler: str | None) -> Iterator[Executor | None]:
    """Where the steps of a build run: a Dask scheduler, processes, or None for this process."""
    if scheduler is not None:
        from distributed import Client

        try:
            client = Client(scheduler, timeout=SCHEDULER_TIMEOUT)
        except (OSError, TimeoutError, ValueError) as error:
            raise InputError(f"--scheduler: expected a Dask scheduler at {scheduler}; found {error}") from None
        with client:
            yield client.get_executor()
    elif workers > 1:
        # spawned, not forked: Arrow's threads do not survive a fork
        pool = _Pool(workers, mp_context=get_context("spawn"))
        try:
            yield pool
        except KeyboardInterrupt:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # ignore a second interrupt, which `timeout` sends
            for worker in active_children():  # their results would be discarded
                worker.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)
    else:
        yield None
