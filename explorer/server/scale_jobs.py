"""Scales of measured objects, estimated in separate processes so that a slow request does not block reads."""

from __future__ import annotations

import asyncio
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import msgspec

from explorer.schemas import ScaleRequest
from metric_base.errors import InputError
from metric_base.executors import end_with_parent
from metric_tree.context import where_of
from metric_tree.tree import Tree, open_tree

#: Maximum duration of a job in seconds.
MAX_JOB_S = 20.0

#: Number of processes.
N_PROCESSES = 2
#: Maximum number of jobs that wait or run; more are refused at once, because they would end after `MAX_JOB_S`.
MAX_JOBS = 10
#: Request whose estimate loads the release and the modules of the estimator.
_SMALL_REQUEST = b'{"objects": [{"category": "chair", "dimensions": {"height": 0.45}}]}'


class ServiceUnavailable(Exception):
    """Too many jobs wait, or this one takes too long."""


def scale_record(request: ScaleRequest, tree: Tree) -> dict[str, Any]:
    """Return the posterior of measured objects and known lengths, as `metric-tree/scale/1`.

    Raises
    ------
    InputError
        A field of an object or of the context is invalid.
    """
    from estimator.pipeline import estimate_objects
    from estimator.reconstructions.objects_file import parse_objects
    from estimator.records.options import EstimateOptions
    from estimator.records.result import ScaleEvidence

    objects = parse_objects(Path("request"), {"schema": request.schema, "objects": request.objects})
    where = where_of(request.where) if request.where is not None else None
    evidence = [
        ScaleEvidence("known_length", str(index), length.metres / length.units, length.sigma, doubt=0.0)
        for index, length in enumerate(request.known_lengths, 1)
    ]
    options = EstimateOptions(level=request.level, evidence=tuple(evidence), where=where)
    record = estimate_objects(objects, tree, options).to_json()
    record.pop("seconds", None)  # the same request has the same bytes
    return record


class ScaleJobs:
    """Processes that estimate scales, started by `preload` or by the first request."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._pool: ProcessPoolExecutor | None = None
        self._jobs = 0

    async def result(self, body: bytes) -> bytes:
        """Return the JSON of the result of a request.

        Raises
        ------
        InputError
            The request is invalid.
        ServiceUnavailable
            Too many jobs wait, or this one takes longer than `MAX_JOB_S`.
        """
        if self._jobs >= MAX_JOBS:
            raise ServiceUnavailable("too many scale requests at once; try again in a few seconds")
        self._jobs += 1
        try:
            job = asyncio.get_running_loop().run_in_executor(self._processes(), _scale, self._directory, body)
            return await asyncio.wait_for(asyncio.shield(job), MAX_JOB_S)
        except TimeoutError:
            raise ServiceUnavailable(f"the estimate took longer than {MAX_JOB_S:g} s; send fewer objects") from None
        except BrokenProcessPool:
            self.stop()
            raise ServiceUnavailable("the worker process ended unexpectedly; try again") from None
        finally:
            self._jobs -= 1

    def preload(self) -> None:
        """Start the processes, so that the first request finds the estimator and the release in memory."""
        for _ in range(N_PROCESSES):
            self._processes().submit(_scale, self._directory, _SMALL_REQUEST)

    def _processes(self) -> ProcessPoolExecutor:
        if self._pool is None:
            self._pool = ProcessPoolExecutor(N_PROCESSES, get_context("spawn"), end_with_parent)
        return self._pool

    def stop(self) -> None:
        """End the processes and abandon the running jobs."""
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = None


#: Opens each release once per process.
_open = cache(open_tree)


def _scale(directory: Path, body: bytes) -> bytes:
    try:
        request = msgspec.json.decode(body, type=ScaleRequest)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise InputError(f"body: expected metric-tree/objects/1 as JSON; {error}") from None
    return msgspec.json.encode(scale_record(request, _open(directory)))  # NaN becomes null
