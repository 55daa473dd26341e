"""Work folder of a build: the results of each step, from which an interrupted build continues.

The ingested rows are one Arrow file per block, with one batch per shard.
"""

from __future__ import annotations

import hashlib
import pickle
import shutil
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_base.folders import code_folder, taxonomy_directory
from metric_tree.checks.unit_errors import MIN_REFERENCE_ROWS, Reference, sibling_reference
from metric_tree.fit.rows import extents_of
from metric_tree.pipeline.ingest import ROWS, SHARDS
from taxonomy.categories import Category

_KEY = "fingerprint"
#: Maximum number of submitted calls: enough to keep a small cluster busy, few enough for the memory.
MAX_WAITING_CALLS = 16
#: Number of hashes that are compared at once; with their rows they are 320 MB.
MAX_PARTITION_ROWS = 20_000_000
_P = ParamSpec("_P")
_R = TypeVar("_R")


def repeated_rows(paths: Sequence[Path], max_partition_rows: int = MAX_PARTITION_ROWS) -> list[list[NDArray[np.bool_]]]:
    """Return, by file and shard, whether the id of each row (n,) occurs in an earlier row.

    The ids are compared by their hashes, one partition of the hashes after another, so that the memory is one byte per
    row and 16 bytes per row of a partition.
    """
    sizes = [len(batch) for path in paths for batch in _batches(path, ["hash"], range(SHARDS))]
    starts = np.concatenate([[0], np.cumsum(sizes, dtype=np.intp)])
    is_repeated = np.zeros(starts[-1], dtype=bool)
    n_partitions = -(-len(is_repeated) // max_partition_rows)
    for partition in range(n_partitions):
        hashes, rows = [np.empty(0, dtype=np.uint64)], [np.empty(0, dtype=np.intp)]
        batches = (batch for path in paths for batch in _batches(path, ["hash"], range(SHARDS)))
        for start, batch in zip(starts[:-1], batches, strict=True):
            values = batch.column(0).to_numpy()
            inside = np.flatnonzero(values % n_partitions == partition)
            hashes.append(values[inside])
            rows.append(start + inside)
        first = np.unique(np.concatenate(hashes), return_index=True)[1]
        is_repeated[np.delete(np.concatenate(rows), first)] = True
    parts = np.split(is_repeated, starts[1:-1])
    return [parts[file * SHARDS : (file + 1) * SHARDS] for file in range(len(paths))]


def shard_rows(paths: Sequence[Path], shard: int, repeated: Sequence[Sequence[NDArray[np.bool_]]]) -> bytes:
    """Return a shard of all files without the repeated rows, given as (n,) for each file and shard; an Arrow file."""
    sink = pa.BufferOutputStream()
    with pa.ipc.new_file(sink, ROWS) as writer:
        for path, is_repeated in zip(paths, repeated, strict=True):
            (batch,) = _batches(path, ROWS.names, [shard])
            writer.write_batch(batch.filter(pa.array(~is_repeated[shard])))
    return bytes(sink.getvalue())


def sibling_references(paths: Sequence[Path], categories: Sequence[Category]) -> dict[str, Reference]:
    """Return reference sizes of the nodes with fewer than `MIN_REFERENCE_ROWS` rows, from the other children."""
    medians: dict[str, FloatArray] = {}  # (3,) of ln extents
    counts: dict[str, int] = {}
    for shard in range(SHARDS):
        batches = [batch for path in paths for batch in _batches(path, ["node_id", "extents_mm"], [shard])]
        table = pa.Table.from_batches(batches)
        logs = np.log(extents_of(table))
        nodes, code = np.unique(table["node_id"].to_numpy(zero_copy_only=False).astype(str), return_inverse=True)
        for index, node_id in enumerate(nodes.tolist()):
            chosen = logs[code == index]
            known = ~np.isnan(chosen).all(axis=0)
            medians[node_id] = np.full(3, np.nan)
            medians[node_id][known] = np.nanmedian(chosen[:, known], axis=0)
            counts[node_id] = len(chosen)
    parents = {category.node_id: category.parent_id for category in categories}
    families: dict[str | None, list[str]] = {}
    for node_id in sorted(medians):
        if counts[node_id] >= MIN_REFERENCE_ROWS:
            families.setdefault(parents[node_id], []).append(node_id)
    references = {
        parent: sibling_reference(np.array([medians[node_id] for node_id in family]))
        for parent, family in families.items()
    }
    few = (node_id for node_id in medians if counts[node_id] < MIN_REFERENCE_ROWS)
    return {node_id: found for node_id in few if (found := references.get(parents[node_id])) is not None}


def _batches(path: Path, names: Sequence[str], shards: Sequence[int]) -> list[pa.RecordBatch]:
    options = pa.ipc.IpcReadOptions(included_fields=[ROWS.get_field_index(name) for name in names])
    with pa.memory_map(str(path)) as file:
        reader = pa.ipc.open_file(file, options=options)
        return [reader.get_batch(shard) for shard in shards]


class SerialExecutor(Executor):
    """An executor that runs each call immediately in this process."""

    def submit(self, fn: Callable[_P, _R], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_R]:
        """Return the finished future of a call; an error is raised here, with the traceback of the caller."""
        future: Future[_R] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


@dataclass(frozen=True, slots=True)
class BuildFolder:
    """A folder of finished steps, valid for one fingerprint of inputs, options and code."""

    directory: Path

    @classmethod
    @contextmanager
    def open(cls, directory: Path, key: str) -> Iterator[BuildFolder]:
        """Open the folder; work of another build is removed. The folder is removed if the block succeeds.

        Raises
        ------
        InputError
            The folder contains files that are not work of a build.
        """
        note = directory / _KEY
        if directory.exists() and (not note.is_file() or note.read_text(encoding="ascii") != key):
            if not note.is_file() and any(directory.iterdir()):
                raise InputError(f"{directory}: expected a build's work or nothing; found other files")
            _remove(directory)
        directory.mkdir(parents=True, exist_ok=True)
        note.write_text(key, encoding="ascii")
        try:
            yield cls(directory)
        except InputError:  # with another input it is another build
            _remove(directory)
            raise
        _remove(directory)

    def map(
        self,
        step: str,
        function: Callable[..., _R],
        calls: Iterable[Sequence[Any]],
        executor: Executor,
        spilled: Callable[[_R, Path], _R] | None = None,
    ) -> Iterator[_R]:
        """Yield `function(*call)` for each call, in order; results of an earlier run are read from disk.

        Parameters
        ----------
        step : str
            Name of the step, the first part of the file names.
        function : callable
            Function at the top of a module.
        calls : iterable of sequences
            Arguments of each call.
        executor : Executor
            Executor of the calls.
        spilled : callable, optional
            Function of a result and the stem of a path. It writes large parts of the result to files and returns the
            remainder, which is pickled.
        """
        waiting: deque[tuple[Path, Future[_R] | None]] = deque()
        for number, call in enumerate(calls):
            path = self.directory / f"{step}-{number:05d}.pickle"
            waiting.append((path, None if path.exists() else executor.submit(function, *call)))
            while waiting and (len(waiting) > MAX_WAITING_CALLS or (first := waiting[0][1]) is None or first.done()):
                yield _result(*waiting.popleft(), spilled)
        while waiting:
            yield _result(*waiting.popleft(), spilled)


def fingerprint(files: Iterable[Path], options: str) -> str:
    """Return the SHA-256 of the files, the options, the code of the packages and the tables of the taxonomy."""
    code = (
        path
        for package in ("metric_base", "crawler", "taxonomy", "metric_tree")
        for path in (code_folder() / package).rglob("*.py")
    )
    tables = (path for path in taxonomy_directory().rglob("*") if path.is_file())
    digest = hashlib.sha256(options.encode())
    for path in [*sorted(code), *sorted(tables), *files]:
        with path.open("rb") as file:
            digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()


def _remove(directory: Path) -> None:
    """Remove a work folder; the fingerprint last, so that a killed removal can be continued."""
    for entry in directory.iterdir():
        if entry.name != _KEY:
            shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
    shutil.rmtree(directory)


def _result(path: Path, future: Future[_R] | None, spilled: Callable[[_R, Path], _R] | None) -> _R:
    """Return the result of a call, stored at `path` if the call was submitted in this run."""
    if future is None:
        with path.open("rb") as file:
            stored: _R = pickle.load(file)  # noqa: S301 - written by the same build, see the fingerprint
        return stored
    result = future.result()
    if spilled is not None:
        result = spilled(result, path.with_suffix(""))
    half = path.with_suffix(".half")
    half.write_bytes(pickle.dumps(result))
    half.rename(path)
    return result
