"""The work folder of a build: what each step returned, so that an interrupted build takes up where it was.

The ingested rows of a build on disk: one Arrow file per block, whose batch i is shard i.
"""

from __future__ import annotations

import hashlib
import pickle
import shutil
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
from metric_base.files import sole_holder
from metric_base.folders import code_folder, taxonomy_directory
from metric_tree.checks.unit_errors import MIN_REFERENCE_ROWS, Reference, sibling_reference
from metric_tree.fit.rows import extents_of
from metric_tree.pipeline.ingest import ROWS, SHARDS
from taxonomy.categories import Category

_KEY = "fingerprint"
#: Calls that wait for a worker or for their turn: enough to keep a small cluster busy, few enough to hold in memory.
MAX_WAITING_CALLS = 16
_P = ParamSpec("_P")
_R = TypeVar("_R")


@dataclass(frozen=True, slots=True, eq=False)
class Repeated:
    """Positions, in the order file, shard, row, of rows whose item id stood before; `starts` (files, shards)."""

    extra: NDArray[np.intp]
    starts: NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class RowFiles:
    """Arrow files of `metric_tree.pipeline.ingest.ROWS` with `SHARDS` batches each."""

    paths: tuple[Path, ...]

    def repeats(self) -> Repeated:
        """The rows that bear an id for the second time; eight bytes a row in memory."""
        hashes: list[NDArray[np.uint64]] = []
        for path in self.paths:
            batches = _batches(path, ("hash",), range(SHARDS))
            hashes += [batch.column(0).to_numpy() for batch in batches]
        counts = np.array([len(part) for part in hashes], dtype=np.intp)
        starts = (np.cumsum(counts) - counts).reshape(len(self.paths), SHARDS)
        everything = np.concatenate(hashes) if hashes else np.empty(0, dtype=np.uint64)
        _, first = np.unique(everything, return_index=True)
        return Repeated(np.setdiff1d(np.arange(len(everything)), first), starts)

    def shard(self, number: int, repeated: Repeated) -> bytes:
        """Shard `number` of all files, without the repeated rows, as an Arrow file."""
        sink = pa.BufferOutputStream()
        with pa.ipc.new_file(sink, ROWS) as writer:
            for file, path in enumerate(self.paths):
                (batch,) = _batches(path, tuple(ROWS.names), [number])
                start = repeated.starts[file, number]
                kept = ~np.isin(np.arange(start, start + batch.num_rows), repeated.extra)
                writer.write_batch(batch.filter(pa.array(kept)))
        return bytes(sink.getvalue())

    def columns(self, number: int, names: Sequence[str]) -> pa.Table:
        """Some columns of a shard."""
        return pa.Table.from_batches([b for path in self.paths for b in _batches(path, tuple(names), [number])])


def sibling_references(rows: RowFiles, categories: Sequence[Category]) -> dict[str, Reference]:
    """Where the extents of each thin node's siblings lie, for nodes that are no reference themselves."""
    medians, counts = _medians(rows)
    parents = {category.node_id: category.parent_id for category in categories}
    families: dict[str | None, list[str]] = {}
    for node_id in sorted(medians):
        if counts[node_id] >= MIN_REFERENCE_ROWS:
            families.setdefault(parents[node_id], []).append(node_id)
    known = {
        parent: sibling_reference(np.array([medians[node_id] for node_id in family]))
        for parent, family in families.items()
    }
    thin = (node_id for node_id in medians if counts[node_id] < MIN_REFERENCE_ROWS)
    return {node_id: against for node_id in thin if (against := known.get(parents[node_id])) is not None}


def _medians(rows: RowFiles) -> tuple[dict[str, FloatArray], Mapping[str, int]]:
    """Median ln extents (3,) and rows of each node."""
    medians: dict[str, FloatArray] = {}
    counts: dict[str, int] = {}
    for number in range(SHARDS):
        table = rows.columns(number, ("node_id", "extents_mm"))
        logs = np.log(extents_of(table))
        nodes, code = np.unique(table["node_id"].to_numpy(zero_copy_only=False).astype(str), return_inverse=True)
        for own, node_id in enumerate(nodes.tolist()):
            chosen = logs[code == own]
            known = ~np.isnan(chosen).all(axis=0)
            medians[node_id] = np.full(3, np.nan)
            medians[node_id][known] = np.nanmedian(chosen[:, known], axis=0)
            counts[node_id] = len(chosen)
    return medians, counts


def _batches(path: Path, names: tuple[str, ...], numbers: Sequence[int]) -> list[pa.RecordBatch]:
    wanted = [ROWS.get_field_index(name) for name in names]
    options = pa.ipc.IpcReadOptions(included_fields=wanted)
    with pa.memory_map(str(path)) as file:
        reader = pa.ipc.open_file(file, options=options)
        return [reader.get_batch(number) for number in numbers]


class SerialExecutor(Executor):
    """An executor that runs each call at once in this process."""

    def submit(self, fn: Callable[_P, _R], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_R]:
        """The finished future of a call; an error is raised here, where it is easy to see."""
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
        """The folder, emptied where it belongs to another build; removed when the block ends well.

        Raises
        ------
        InputError
            The folder holds something that is no build's work.
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
        except InputError:  # another input is another build
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
        """`function(*call)` for each call, in order, those that were done before read from disk.

        Parameters
        ----------
        spilled : puts heavy parts of a result into files of the given stem and returns the rest, which is pickled
        """
        waiting: deque[tuple[Path, Future[_R] | None]] = deque()
        for number, call in enumerate(calls):
            path = self.directory / f"{step}-{number:05d}.pickle"
            waiting.append((path, None if path.exists() else executor.submit(function, *call)))
            while waiting and (len(waiting) > MAX_WAITING_CALLS or _is_done(waiting[0][1])):
                yield _result(*waiting.popleft(), spilled)
        while waiting:
            yield _result(*waiting.popleft(), spilled)


@contextmanager
def sole_writer(out: Path) -> Iterator[None]:
    """Holds an output for one process while the block runs; the system lets go of it when the process ends, killed too.

    Raises
    ------
    InputError
        Another process writes the same output.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    note = out.parent / f".{out.name}.lock"
    try:
        with sole_holder(note):
            try:
                yield
            finally:
                note.unlink(missing_ok=True)
    except BlockingIOError:
        raise InputError(
            f"{out}: another run is writing this output; wait until it ends, or choose another --out"
        ) from None


def fingerprint(files: Iterable[Path], options: str) -> str:
    """SHA-256 over the files' bytes, the options, the code of the packages and the tables of the taxonomy."""
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
    """Remove a work folder, its note last: what a kill leaves is still known as a build's work."""
    for entry in directory.iterdir():
        if entry.name != _KEY:
            shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
    shutil.rmtree(directory)


def _is_done(future: Future[Any] | None) -> bool:
    return future is None or future.done()


def _result(path: Path, future: Future[_R] | None, spilled: Callable[[_R, Path], _R] | None) -> _R:
    if future is None:
        with path.open("rb") as file:
            kept: _R = pickle.load(file)  # noqa: S301 - written by this very build, see the fingerprint
        return kept
    result = future.result()
    if spilled is not None:
        result = spilled(result, path.with_suffix(""))
    half = path.with_suffix(".half")
    half.write_bytes(pickle.dumps(result))
    half.rename(path)
    return result
