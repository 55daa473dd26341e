"""The scale of measured objects, computed in processes of its own, so that a slow request never blocks a read."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import msgspec

from explorer.schemas import ScaleRequest
from metric_base.errors import InputError
from metric_tree.context import where_of
from metric_tree.tree import Tree, open_tree

#: Objects and known lengths of one request: 500 objects take a second or so.
MOST_OBJECTS, MOST_LENGTHS = 500, 100

#: Seconds that an answer may take.
LIMIT_S = 20.0

#: Jobs that run at once, and that wait or run: more are refused at once rather than answered late.
RUNNING, MOST_JOBS = 2, 10

#: One standard deviation of the natural log of a known length whose error is not stated, as of `--known-length`.
LENGTH_SIGMA = 0.01


class Busy(Exception):
    """Too many jobs wait, or this one took too long."""


def scale_record(request: ScaleRequest, tree: Tree) -> dict[str, Any]:
    """The posterior of measured objects and known lengths, as `metric-tree/scale/1`.

    Raises
    ------
    InputError
        The request has too many objects, or a field of one is invalid.
    """
    from estimator.pipeline import estimate_objects
    from estimator.reconstructions.objects_file import parse_objects
    from estimator.records.options import EstimateOptions

    if not 1 <= len(request.objects) <= MOST_OBJECTS:
        raise InputError(f"objects: expected 1 to {MOST_OBJECTS}; found {len(request.objects)}")
    if not 0 < request.level < 1:
        raise InputError(f"level: expected a number between 0 and 1; found {request.level:g}")
    objects = parse_objects(Path("request"), {"schema": request.schema, "objects": request.objects})
    where = where_of(request.where) if request.where is not None else None
    options = EstimateOptions(level=request.level, evidence=_lengths(request.known_lengths), where=where)
    record = estimate_objects(objects, tree, options).to_json()
    record.pop("seconds", None)  # the same request has the same bytes
    return record


def _lengths(lengths: Sequence[dict[str, float]]) -> tuple[Any, ...]:
    from estimator.records.result import ScaleEvidence

    if len(lengths) > MOST_LENGTHS:
        raise InputError(f"known_lengths: expected at most {MOST_LENGTHS}; found {len(lengths)}")
    rows = []
    for number, length in enumerate(lengths, 1):
        units, metres = length.get("units", 0.0), length.get("metres", 0.0)
        sigma = length.get("sigma", LENGTH_SIGMA)
        if not (1e-12 < units < 1e12 and 1e-12 < metres < 1e12 and 1e-6 < sigma < 10) or set(length) - {
            "units",
            "metres",
            "sigma",
        }:
            expected = "units and metres above 0, and sigma of their ratio's natural log from 1e-6 to 10"
            raise InputError(f"known_lengths[{number - 1}]: expected {expected}; found {length}")
        rows.append(ScaleEvidence("known_length", str(number), metres / units, sigma, doubt=0.0))
    return tuple(rows)


class ScaleJobs:
    """Processes that compute scales; started by `warm`, or by the first request."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._pool: ProcessPoolExecutor | None = None
        self._jobs = 0

    async def answer(self, body: bytes) -> bytes:
        """The JSON of a request's answer.

        Raises
        ------
        InputError
            The request is invalid.
        Busy
            Too many jobs wait, or this one took longer than `LIMIT_S`.
        """
        if self._jobs >= MOST_JOBS:
            raise Busy("too many scale requests at once; try again in a few seconds")
        self._jobs += 1
        try:
            job = asyncio.get_running_loop().run_in_executor(self._processes(), _scale, body)
            return await asyncio.wait_for(asyncio.shield(job), LIMIT_S)
        except TimeoutError:
            raise Busy(f"the answer took longer than {LIMIT_S:g} s; ask with fewer objects") from None
        except BrokenProcessPool:
            self.stop()
            raise Busy("the computing process ended; try again") from None
        finally:
            self._jobs -= 1

    def warm(self) -> None:
        """Start the processes; the first request then finds the estimator and the release in memory."""
        for _ in range(RUNNING):
            self._processes().submit(_rehearse)

    def _processes(self) -> ProcessPoolExecutor:
        if self._pool is None:
            self._pool = ProcessPoolExecutor(RUNNING, get_context("spawn"), _start, (self._directory,))
        return self._pool

    def stop(self) -> None:
        """End the processes; a job that runs is given up."""
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = None


_trees: dict[str, Tree] = {}


def _start(directory: Path) -> None:
    _trees["tree"] = open_tree(directory)


def _rehearse() -> None:
    """A small scale: what it loads stays loaded."""
    scale_record(ScaleRequest(objects=[{"category": "chair", "dimensions": {"height": 0.45}}]), _trees["tree"])


def _scale(body: bytes) -> bytes:
    try:
        request = msgspec.json.decode(body, type=ScaleRequest)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise InputError(f"body: expected metric-tree/objects/1 as JSON; {error}") from None
    return msgspec.json.encode(_finite(scale_record(request, _trees["tree"])))


def _finite(value: Any) -> Any:
    """JSON has no infinity: such a number is null."""
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
