"""Batches of scenes: list, keys, records of completion, and table of results; the commands with `--batch` share them.

The records of a run with `--out RESULTS.parquet` are in `RESULTS.parquet.records/I-of-N.jsonl`. A scene has a record
when it starts, with the outputs that do not exist yet, and its row when its outputs are complete. The next run repeats
scenes without a result, after it has removed these outputs. Files of records are only appended to.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from metric_base.errors import InputError, Unquoted, damage_as_field_error, in_file
from metric_base.executors import isolated_results
from metric_base.files import INPUT_SUFFIXES, sole_writer, whole_file
from metric_base.input_files import read_text
from metric_base.parsing import csv_rows
from metric_base.progress import NoticeCallback, ProgressCallback, no_notice, silent, with_progress
from metric_base.records import json_lines
from metric_base.remote import file_identity, is_remote

SCHEMA = "metric-tree/batch/1"
#: Columns of the table of results and their types in Arrow.
COLUMNS = {
    "scene": "string", "status": "string", "scale": "float64", "low": "float64", "high": "float64",
    "seconds": "float64", "error": "string", "exit_status": "int64", "key": "string", "result": "string",
}  # fmt: skip
#: Exit statuses of scenes with a result, which later runs do not repeat.
COMPLETE = (0, 3)
#: Exit status of a scene whose process died.
DIED = 1
#: Number of rows that are in memory when the table is written; a result has up to 1 MB.
N_TABLE_ROWS = 100


@dataclass(frozen=True, slots=True)
class BatchScene:
    """One row of a list.

    Attributes
    ----------
    name : str
        Input of the scene as in the list.
    words : tuple of str
        Arguments of its command.
    key : str
        SHA-256 of input, arguments, release and size and time of the input files.
    outputs : tuple of Path
        Absolute paths of the files and folders that the command writes.
    """

    name: str
    words: tuple[str, ...]
    key: str
    outputs: tuple[Path, ...]


@dataclass(frozen=True, slots=True)
class Completion:
    """Position and status of a row in the records: file, offset in bytes, exit status, and status of the result."""

    file: Path
    offset: int
    exit_status: int
    status: str


def read_list(path: Path, name_column: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the place (`file:line`) and the values by column of each row of a list.

    Parameters
    ----------
    path : Path
        CSV, Parquet or JSON Lines (`.jsonl`); a file with another suffix has one name per line.
    name_column : str
        Column of these names.

    Raises
    ------
    InputError
        The list cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix == ".jsonl":
        yield from json_lines(path, dict[str, Any])
    elif suffix == ".csv":
        for line, row in csv_rows(path)[1]:
            if None in row:
                found = Unquoted(f"{len(row[None])} more")
                raise InputError.at(f"{path}:{line}", "cells", "a cell for each column", found)
            yield f"{path}:{line}", row
    elif suffix == ".parquet":
        import pyarrow.parquet as pq

        with in_file(path), damage_as_field_error("a Parquet table", (OSError, ValueError), str, field="file"):
            rows = (row for batch in pq.ParquetFile(path).iter_batches() for row in batch.to_pylist())
            yield from ((f"{path}:{number}", row) for number, row in enumerate(rows, start=1))
    else:
        names = enumerate(read_text(path).split("\n"), start=1)
        yield from ((f"{path}:{line}", {name_column: name.strip()}) for line, name in names if name.strip())


def scene_key(words: Sequence[str], release: str, folder: Path, outputs: Iterable[Path]) -> str:
    """Return the SHA-256 of arguments, release, and the paths, sizes and times of the input files that they name.

    Parameters
    ----------
    words : sequence of str
        Arguments; those that name a file or folder relative to `folder` are inputs, except for `outputs`. Files in
        folders are inputs if their suffix is in `INPUT_SUFFIXES`.
    release : str
        Identity of the release.
    """
    digest = hashlib.sha256(json.dumps([*words, release]).encode())
    for word in words:
        path = folder / word.rpartition("=")[2]
        if is_remote(Path(word.rpartition("=")[2])):
            digest.update(file_identity(Path(word.rpartition("=")[2])).encode())
        if path in outputs or not os.path.lexists(path):
            continue
        below = sorted(Path(place) / name for place, _, names in os.walk(path) for name in names)
        for file in [file for file in below if file.suffix.lower() in INPUT_SUFFIXES] if path.is_dir() else [path]:
            state = file.stat() if file.exists() else file.lstat()  # a link without a target
            digest.update(f"{os.path.relpath(file, folder)}\0{state.st_size}\0{state.st_mtime_ns}\0".encode())
    return digest.hexdigest()


def completed_records(
    path: Path, schema: str, fields: Sequence[str], option: str, program: str, *, is_own: bool
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield offset and content of each complete line of a file of records, which need not exist.

    Parameters
    ----------
    path : Path
    schema : str
        Value of `schema` in each record.
    fields : sequence of str
        Fields of each record that are texts.
    option, program : str
        Option that names the file, and the program that writes it, for messages.
    is_own : bool
        Remove an incomplete last line, which a killed run has left; False if another process may be writing it.

    Raises
    ------
    InputError
        The file has other content.
    """
    if not path.exists():
        return
    offset, line = 0, b""
    with path.open("rb") as file:
        for number, line in enumerate(file, start=1):
            if not line.endswith(b"\n"):
                break
            if line.strip():
                try:
                    record = json.loads(line)
                    is_record = record["schema"] == schema and all(isinstance(record[name], str) for name in fields)
                except (ValueError, LookupError, TypeError, RecursionError):
                    is_record = False
                if not is_record:
                    raise InputError(f"{path}:{number}: {option}: expected a result of {program}; found another line")
                yield offset, record
            offset += len(line)
    if offset == 0 and line.strip() and f'"{schema}"'.encode() not in line:
        raise InputError(f"{path}: {option}: expected results of {program}, or no file yet; found another file")
    if is_own and line and not line.endswith(b"\n"):
        os.truncate(path, offset)


def append_records(path: Path, lines: Iterable[str]) -> None:
    """Append lines to a file of records in one call of the system."""
    with path.open("ab") as file:
        file.write("".join(f"{line}\n" for line in lines).encode())


def run_batch(
    scenes: Sequence[BatchScene],
    function: Callable[[BatchScene], dict[str, Any]],
    out: Path,
    part: tuple[int, int] = (1, 1),
    n_processes: int = 1,
    progress: ProgressCallback = silent,
    notice: NoticeCallback = no_notice,
) -> tuple[Counter[tuple[int, str]], bool]:
    """Run the scenes of a part that have no result yet, and write the table when every scene of the list has a row.

    Parameters
    ----------
    scenes : sequence of BatchScene
        All scenes of the list.
    function : callable
        Function at the top of a module that returns the row of a scene, without its `key`.
    out : Path
        Table of results.
    part : (int, int)
        Number of this part from 1, and number of parts.
    n_processes : int
        Number of processes.
    progress, notice : callable, optional
        Callbacks for the number of scenes, and for sentences about failed and skipped scenes.

    Returns
    -------
    counts : Counter
        Number of scenes of this part by exit status and status, from all records.
    is_written : bool
        Whether the table is written; otherwise scenes of other parts have no row yet.

    Raises
    ------
    InputError
        Another process runs this part, or a file of records has other content.
    """
    folder = out.with_name(f"{out.name}.records")
    folder.mkdir(exist_ok=True)
    own = folder / f"{part[0]}-of-{part[1]}.jsonl"
    with sole_writer(own):
        rows, started = _completions(folder, own)
        mine = {scene.key: scene for scene in scenes[part[0] - 1 :: part[1]]}
        pending = [s for s in mine.values() if s.key not in rows or rows[s.key].exit_status not in COMPLETE]
        if len(pending) < len(mine):
            notice(f"{len(mine) - len(pending)} of {len(mine)} scenes have a result of an earlier run")

        def starting() -> Iterator[BatchScene]:
            """Yield the scenes that remain, each after its first record."""
            for scene in pending:
                for path in started.get(scene.key, ()):  # of a run without a result
                    shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink(missing_ok=True)
                outputs = [str(path) for path in scene.outputs if not os.path.lexists(path)]
                append_records(own, [json.dumps({"schema": SCHEMA, "key": scene.key, "outputs": outputs})])
                yield scene

        with closing(isolated_results(function, starting(), n_processes)) as results:
            for scene, result in with_progress(results, "scenes", progress, len(pending)):
                died = "the process of the scene ended without a result (killed, or lack of memory)"
                row = result or {"scene": scene.name, "exit_status": DIED, "error": died}
                append_records(own, [json.dumps({"schema": SCHEMA, "key": scene.key, **row})])
                if row["exit_status"] not in COMPLETE:
                    error = str(row["error"])
                    notice(error if error.startswith(scene.name) else f"{scene.name}: {error}")
        rows, _ = _completions(folder, own)
        is_written = all(scene.key in rows for scene in scenes)
        if is_written:
            _write_table([rows[scene.key] for scene in scenes], out)
        return Counter((rows[key].exit_status, rows[key].status) for key in mine), is_written


def _completions(folder: Path, own: Path) -> tuple[dict[str, Completion], dict[str, list[Path]]]:
    """Return the row of each key in all files, and the outputs that the last run of each scene of file `own` made.

    Of several rows of a key, the last one with a result counts, otherwise the last one.
    """
    rows: dict[str, Completion] = {}
    started: dict[str, list[Path]] = {}
    for file in sorted(folder.glob("*-of-*.jsonl")):
        for offset, record in completed_records(file, SCHEMA, ["key"], "--out", "--batch", is_own=file == own):
            key = record["key"]
            if "outputs" in record:
                if file == own:
                    started[key] = [Path(path) for path in record["outputs"]]
                continue
            status = record["exit_status"]
            if key not in rows or status in COMPLETE or rows[key].exit_status not in COMPLETE:
                rows[key] = Completion(file, offset, status, record.get("status") or "failed")
    return rows, started


def _write_table(completions: Iterable[Completion], out: Path) -> None:
    """Write the rows at these positions of the records, in this order, as Parquet."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = pa.schema(list(COLUMNS.items()), metadata={"schema": SCHEMA})
    remaining = iter(completions)
    with whole_file(out, "--out", SCHEMA) as work, pq.ParquetWriter(work, schema, compression="zstd") as writer:
        while chunk := list(itertools.islice(remaining, N_TABLE_ROWS)):
            rows = []
            for completion in chunk:
                with completion.file.open("rb") as file:
                    file.seek(completion.offset)
                    rows.append(json.loads(file.readline()))
            writer.write_table(pa.Table.from_pylist(rows, schema=schema))
