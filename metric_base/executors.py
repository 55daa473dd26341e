"""Local and Dask executors for work on shards, and processes that isolate work that may fail or leak."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process
from typing import Any, TypeVar

from metric_base.errors import InputError
from metric_base.operating_system import interrupts_blocked

_R = TypeVar("_R")
_Item = TypeVar("_Item")
#: Number of items after which a process of `isolated_results` is replaced, so that leaks of libraries stay small.
MAX_ITEMS_PER_PROCESS = 100
#: Time for a process to remove its temporary files after SIGTERM in seconds; then it is killed.
TERMINATION_S = 5.0
#: Maximum time for the response of a Dask scheduler, in seconds.
SCHEDULER_TIMEOUT = 10


class _Pool(ProcessPoolExecutor):
    """Processes that ignore an interrupt, because their parent ends them.

    They inherit the signal mask at their start; an initializer would run after seconds of imports.
    """

    def submit(self, fn: Callable[..., _R], /, *args: Any, **kwargs: Any) -> Future[_R]:
        """Submit a call as the base class does; a worker that this starts has the interrupt blocked."""
        with interrupts_blocked():
            return super().submit(fn, *args, **kwargs)


class _DaskExecutor(Executor):
    """Tasks on a Dask cluster.

    `Client.get_executor` is not used: a result that the client fetches when the scheduler ends never becomes done.
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    def submit(self, fn: Callable[..., _R], /, *args: Any, **kwargs: Any) -> Any:
        """Return the future of Dask, which has `done` and `result`."""
        return self._client.submit(fn, *args, pure=False, **kwargs)


@contextmanager
def executor_of(workers: int, scheduler: str | None) -> Iterator[Executor | None]:
    """Provide the executor of the steps of a build: that of a Dask scheduler, processes, or None for this process."""
    if scheduler is not None:
        from distributed import Client
        from distributed.comm import CommClosedError

        try:
            client = Client(scheduler, timeout=SCHEDULER_TIMEOUT)
        except (OSError, TimeoutError, ValueError) as error:
            raise InputError(f"--scheduler: expected a Dask scheduler at {scheduler}; found {error}") from None
        with client:
            try:
                yield _DaskExecutor(client)
            except (CancelledError, CommClosedError):
                lost = f"--scheduler: the connection to {scheduler} was lost; the same command continues the work"
                raise InputError(lost) from None
    elif workers > 1:
        # spawned, not forked: Arrow's threads do not survive a fork
        pool = _Pool(workers, mp_context=get_context("spawn"), initializer=end_with_parent)
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


def isolated_results(
    function: Callable[[_Item], _R], items: Iterable[_Item], n_processes: int
) -> Generator[tuple[_Item, _R | None], None, None]:
    """Yield each item with `function(item)`, in the order of completion; None if the process of the item died.

    Each process works on one item at a time, has no terminal, ends with its parent also if that is killed, and is
    replaced after `MAX_ITEMS_PER_PROCESS` items. Items are requested when a process is free. Close the generator to
    end the processes.
    """
    remaining, n_done = iter(items), dict.fromkeys(range(n_processes), 0)
    processes: dict[int, _Pool | None] = dict.fromkeys(range(n_processes))
    running: dict[Future[_R], tuple[_Item, int]] = {}
    is_complete = False
    try:
        while True:
            busy = {slot for _, slot in running.values()}
            for slot in [slot for slot in processes if slot not in busy]:
                for item in remaining:
                    pool = processes[slot] = processes[slot] or _Pool(1, get_context("spawn"), _isolate)
                    running[pool.submit(function, item)] = item, slot
                    break
            if not running:
                is_complete = True
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                item, slot = running.pop(future)
                n_done[slot] += 1
                died = isinstance(future.exception(), BrokenProcessPool)
                if (used := processes[slot]) is not None and (died or n_done[slot] % MAX_ITEMS_PER_PROCESS == 0):
                    used.shutdown()
                    processes[slot] = None
                yield item, None if died else future.result()
    finally:
        for used in filter(None, processes.values()):
            workers = [] if is_complete else list((used._processes or {}).values())
            for worker in workers:
                worker.terminate()
            for worker in workers:
                worker.join(TERMINATION_S)
                worker.kill()
            used.shutdown(cancel_futures=True)


def _isolate() -> None:
    """Detach this process from the terminal, and end it when its parent ends."""
    end_with_parent()
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in range(3):  # also for libraries that write to the descriptors
        os.dup2(nowhere, descriptor)
    os.close(nowhere)


def end_with_parent() -> None:
    """End this process when its parent ends: a killed parent leaves the workers of a pool waiting for ever."""

    def wait_for_parent() -> None:
        parent = parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=wait_for_parent, daemon=True).start()
