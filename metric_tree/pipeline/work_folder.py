"""Work folder of a build: the results of each step, from which an interrupted build continues.

A worker writes its results to the folder itself, and its completion mark last, so that only counts pass through the
process that submits the calls.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import shutil
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from metric_base.errors import InputError
from metric_base.files import write_whole
from metric_base.folders import code_folder, taxonomy_directory
from metric_base.remote import StoreError, file_identity, is_remote

_KEY = "fingerprint"
#: Maximum number of submitted calls: two for each process of a cluster of 128.
MAX_WAITING_CALLS = 256
_P = ParamSpec("_P")
_R = TypeVar("_R")


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
    def open(cls, directory: Path, key: str, *, is_shared: bool = False) -> Iterator[BuildFolder]:
        """Open the folder; work of another build is removed. The folder is removed if the block succeeds.

        With `is_shared`, other processes of the same build use the folder, which is never removed.

        Raises
        ------
        InputError
            The folder contains files that are not work of a build, or a shared folder contains work of another build.
        """
        directory.mkdir(parents=True, exist_ok=True)
        note = directory / _KEY
        has_others = any(not entry.name.startswith(".") for entry in directory.iterdir())
        if has_others and not note.is_file():  # in this order, because a process writes its note first
            raise InputError(f"{directory}: expected a build's work or nothing; found other files")
        if note.is_file() and note.read_text(encoding="ascii") != key:
            if is_shared:
                raise InputError(f"{directory}: expected work of this build; found that of another one: remove it")
            _remove(directory)
            directory.mkdir()
        write_whole(note, key)
        try:
            yield cls(directory)
        except InputError as error:  # with another input it is another build
            if not is_shared and not isinstance(error, StoreError):
                _remove(directory)
            raise
        if not is_shared:
            _remove(directory)

    def map(
        self,
        step: str,
        function: Callable[..., _R],
        calls: Iterable[Sequence[Any]],
        executor: Executor,
        spilled: Mapping[str, str] | None = None,
        names: Sequence[str] | None = None,
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
        spilled : mapping of str to str, optional
            Fields of a result with bytes, which the worker writes to files, and the suffixes of these files. The fields
            of the yielded results are empty.
        names : sequence of str, optional
            Names of the calls within the step; default their numbers.
        """
        waiting: deque[tuple[Path, Future[_R] | None]] = deque()
        for number, call in enumerate(calls):
            mark = self.directory / f"{step}-{names[number] if names else f'{number:07d}'}.pickle"
            is_done = mark.exists()
            future = None if is_done else executor.submit(_stored_result, mark, function, call, dict(spilled or {}))
            waiting.append((mark, future))
            while waiting and (len(waiting) > MAX_WAITING_CALLS or (first := waiting[0][1]) is None or first.done()):
                yield _result(*waiting.popleft())
        while waiting:
            yield _result(*waiting.popleft())


def fingerprint(files: Iterable[Path], options: str) -> str:
    """Return the SHA-256 of the files, the options, the code and tables of the packages, and the taxonomy."""
    code = (
        path
        for package in ("metric_base", "crawler", "taxonomy", "metric_tree")
        for path in (code_folder() / package).rglob("*")
        if path.suffix in {".csv", ".py", ".txt"}
    )
    tables = (path for path in taxonomy_directory().rglob("*") if path.is_file())
    digest = hashlib.sha256(options.encode())
    for path in [*sorted(code), *sorted(tables), *files]:
        if is_remote(path):
            digest.update(file_identity(path).encode())
            continue
        with path.open("rb") as file:
            digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()


def _remove(directory: Path) -> None:
    """Remove a work folder; the fingerprint last, so that a killed removal can be continued."""
    for entry in directory.iterdir():
        if entry.name != _KEY:
            shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
    shutil.rmtree(directory)


def _stored_result(mark: Path, function: Callable[..., Any], call: Sequence[Any], spilled: Mapping[str, str]) -> Any:
    """Return the result of a call in a worker, after it is written; a second worker of the same call harms nothing."""
    result = function(*call)
    contents = {suffix: getattr(result, name) for name, suffix in spilled.items()}
    if spilled:
        result = replace(result, **dict.fromkeys(spilled, b""))
    for suffix, content in {**contents, mark.suffix: pickle.dumps(result)}.items():  # the mark last
        part = mark.with_name(f".{mark.stem}{suffix}.{os.urandom(8).hex()}")
        part.write_bytes(content)
        part.replace(mark.with_suffix(suffix))
    return result


def _result(mark: Path, future: Future[_R] | None) -> _R:
    """Return the result of a call that this run has submitted, otherwise the stored one."""
    if future is not None:
        return future.result()
    with mark.open("rb") as file:
        stored: _R = pickle.load(file)  # noqa: S301 - written by the same build, see the fingerprint
    return stored
