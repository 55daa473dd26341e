"""Read 3-D model files of all formats, each in a separate process with limits of time and memory; tables of boxes."""

from __future__ import annotations

import csv
import multiprocessing
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.errors import InputError, Unquoted, damage_as_field_error, expect, in_file
from metric_base.executors import end_with_parent
from metric_base.input_files import read_text
from metric_base.operating_system import limit_memory
from models3d.asset import MAX_COORDINATE_M, Asset, AssetBody, NameText, Up

GLTF_SUFFIXES = (".gltf", ".glb")
ROBOT_SUFFIXES = (".urdf", ".sdf", ".xml", ".mjcf")
#: Formats that are read by trimesh. None of them defines a unit or an up axis.
MESH_SUFFIXES = (".obj", ".stl", ".ply", ".off")
USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
#: Suffixes of all formats.
SUFFIXES = (*GLTF_SUFFIXES, *USD_SUFFIXES, *MESH_SUFFIXES, ".dae", *ROBOT_SUFFIXES)
#: Maximum time for reading one file, in seconds. A valid file of the maximum size, 512 MiB, takes half of it.
MAX_SECONDS = 120.0
#: Maximum memory for reading one file, in bytes. A valid file of the maximum size takes half of it.
MAX_MEMORY = 6 << 30

#: Required columns of a table of boxes.
COLUMNS = ("name", "x", "y", "z")
#: Maximum size of a CSV table, in bytes.
MAX_TABLE_BYTES = 1 << 28
#: Number of rows of a Parquet table that are in memory at the same time.
N_BATCH_ROWS = 10_000


def find_models(paths: Iterable[Path]) -> Iterator[Path]:
    """Yield these files, and the model files in these folders and below them, sorted by path."""
    for path in paths:
        if path.is_dir():
            yield from (file for file in sorted(path.rglob("*")) if file.suffix.lower() in SUFFIXES and file.is_file())
        else:
            yield path


def read_asset(path: Path) -> Asset:
    """Read the content of a model file in this process, without limits of time and memory.

    Parameters
    ----------
    path : Path
        File with one of the suffixes `SUFFIXES`.

    Returns
    -------
    Asset
        Its texts include the names of the file and of its folder.

    Raises
    ------
    InputError
        The format is unknown, or the file is damaged, too large, has no shape, or refers to files outside its folder.
    """
    asset = _read(path)
    return replace(asset, texts=(*asset.texts, NameText("file name", path.stem), NameText("folder", path.parent.name)))


def read_assets(
    paths: Iterable[Path], read: Callable[[Path], Asset] | None = None
) -> Iterator[tuple[Path, Asset | InputError]]:
    """Read model files in a separate process, with the limits `MAX_SECONDS` and `MAX_MEMORY` for each file.

    Parameters
    ----------
    paths : iterable of Path
    read : callable, optional
        Function that reads one file, by default `read_asset`; it must be importable.

    Yields
    ------
    path : Path
    result : Asset or InputError
        The content, or the reason why the file cannot be read. A file that crashes the process, or causes any other
        error in it, does not affect the files after it.
    """
    pool: ProcessPoolExecutor | None = None
    try:
        for path in paths:
            pool = pool or ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _start_reader, (MAX_MEMORY,))
            try:
                yield path, pool.submit(read or read_asset, path).result(MAX_SECONDS)
            except InputError as error:
                yield path, error
            except Exception as error:  # noqa: BLE001 - a crash, MemoryError, or an error of a reader
                is_slow = isinstance(error, FutureTimeout)
                found = f"more than {MAX_SECONDS:g} s" if is_slow else "a file that ends its reader"
                _stop(pool)
                pool = None
                yield path, InputError(f"{path}: file: expected a model that can be read, found {found}")
    finally:
        if pool is not None:
            _stop(pool)


def _read(path: Path) -> Asset:
    """Read a file with the reader of its format; robots call this function for their meshes."""
    suffix = path.suffix.lower()
    if not path.is_file():
        raise InputError(f"{path}: file: expected a 3-D model, found {'a folder' if path.is_dir() else 'no such file'}")
    read: Callable[[Path], Asset]
    if suffix in GLTF_SUFFIXES:
        from models3d.gltf.boxes import read_gltf as read
    elif suffix in USD_SUFFIXES:
        from models3d.usd.reader import read_usd as read
    elif suffix in ROBOT_SUFFIXES:
        from models3d.robots import read_robot

        read = partial(read_robot, read_mesh=_read)
    elif suffix == ".dae":
        from models3d.meshes import read_collada as read
    elif suffix in MESH_SUFFIXES:
        from models3d.meshes import read_mesh as read
    else:
        raise InputError(f"{path}: file: expected one of {', '.join(SUFFIXES)}, found {suffix or 'no suffix'}")
    asset = read(path)
    if not asset.bodies:
        raise InputError(f"{path}: content: expected at least one shape, found none")
    return asset


def _start_reader(max_bytes: int) -> None:
    end_with_parent()
    limit_memory(max_bytes)


def _stop(pool: ProcessPoolExecutor) -> None:
    """Kill the process of a pool, which may still be reading."""
    for process in list((pool._processes or {}).values()):
        process.kill()
    pool.shutdown(cancel_futures=True)  # waits: otherwise its thread and the end of the program close the same pipe


def read_boxes(path: Path, up: Up | None = None) -> Iterator[Asset | InputError]:
    """Yield an asset for each row of a table of boxes, or the error of a row.

    Parameters
    ----------
    path : Path
        CSV or Parquet table with the columns `name`, `x`, `y`, `z` (metres) and optionally `category` and `up`.
    up : {"x", "y", "z"}, optional
        Axis that points up in rows without `up`.

    Raises
    ------
    InputError
        The table cannot be read, or a column is missing.
    """
    for line, row in enumerate(_records(path), start=2):
        position = Path(f"{path}:{line}")
        try:
            sizes = np.array([float(row[axis]) for axis in COLUMNS[1:]])
        except (TypeError, ValueError):
            sizes = np.array([np.nan] * 3)
        if not ((sizes >= 0).all() and 0 < sizes.max() <= MAX_COORDINATE_M):
            found = ", ".join(str(row[axis]) for axis in COLUMNS[1:])
            yield InputError.at(position, "x, y, z", "sizes in metres, at least one above 0", Unquoted(found))
            continue
        row_up: Up | None = row["up"] if row.get("up") in ("x", "y", "z") else up
        title = NameText("title", str(row.get("category") or row["name"]))
        yield Asset(position, "box", 1.0, row_up, (AssetBody(str(row["name"]), np.zeros(3), sizes, (title,)),))


def _records(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the rows of a table of boxes, a Parquet table in batches."""
    rows: Iterable[dict[str, Any]]
    damage = damage_as_field_error("a table of boxes", (csv.Error, OSError, ValueError), str, field="file")
    with in_file(path), damage:  # errors of Arrow are ValueError
        if path.suffix.lower() == ".parquet":
            import pyarrow.parquet as pq

            file = pq.ParquetFile(path)
            names = file.schema_arrow.names
            columns = [name for name in names if name in (*COLUMNS, "category", "up")]
            batches = file.iter_batches(N_BATCH_ROWS, columns=columns)
            rows = (row for batch in batches for row in batch.to_pylist())
        else:
            reader = csv.DictReader(read_text(path, MAX_TABLE_BYTES).splitlines())
            names, rows = list(reader.fieldnames or []), reader
        has_columns = set(COLUMNS) <= set(names)
        expect(has_columns, "columns", ", ".join(COLUMNS), Unquoted(", ".join(names) or "none"))
        yield from rows
