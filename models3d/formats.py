"""Files of 3-D models of every format, each read in a process of its own with bounds; tables of boxes."""

from __future__ import annotations

import csv
import multiprocessing
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeout
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np

from metric_base.errors import InputError, Unquoted
from metric_base.input_files import read_text
from models3d.asset import Asset, AssetBody, NameText, Up

GLTF_SUFFIXES = (".gltf", ".glb")
ROBOT_SUFFIXES = (".urdf", ".sdf", ".xml", ".mjcf")
#: What trimesh reads here; none of them states a unit or what is up.
MESH = (".obj", ".stl", ".ply", ".off")
USD = (".usd", ".usda", ".usdc", ".usdz")
#: The files that are read, by their ending.
SUFFIXES = (*GLTF_SUFFIXES, *USD, *MESH, ".dae", *ROBOT_SUFFIXES)
#: Seconds and bytes of memory that reading one file may take: the largest sound one, of 512 MiB, takes half of these.
MAX_SECONDS, MAX_MEMORY = 120.0, 6 << 30

#: Columns of a table of boxes.
COLUMNS = ("name", "x", "y", "z")
#: Largest table as text.
MAX_TABLE_BYTES = 1 << 28


def find_models(paths: Iterable[Path]) -> Iterator[Path]:
    """The files of models: files as they are named, and of folders all below them, in order of name."""
    for path in paths:
        if path.is_dir():
            yield from (file for file in sorted(path.rglob("*")) if file.suffix.lower() in SUFFIXES and file.is_file())
        else:
            yield path


def read_asset(path: Path) -> Asset:
    """What a file states, with the words of its own name and of its folder's, in this process.

    Raises
    ------
    InputError
        It is of no known format, damaged, too large, or names files outside its folder.
    """
    asset = _read(path)
    words = (NameText("file name", path.stem), NameText("folder", path.parent.name))
    return Asset(asset.file, asset.format, asset.unit_m, asset.up, asset.bodies, (*asset.words, *words))


def read_assets(paths: Iterable[Path]) -> Iterator[tuple[Path, Asset | InputError]]:
    """What each file states, or why it cannot be read; a file that ends its process ends no other's."""
    pool: ProcessPoolExecutor | None = None
    try:
        for path in paths:
            pool = pool or _pool()
            try:
                yield path, pool.submit(read_asset, path).result(MAX_SECONDS)
            except InputError as error:
                yield path, error
            except (BrokenProcessPool, FutureTimeout, MemoryError) as error:
                how = f"more than {MAX_SECONDS:g} s" if isinstance(error, FutureTimeout) else "one that ends its reader"
                _stop(pool)
                pool = None
                yield path, InputError(f"{path}: file: expected a model that can be read, found {how}")
    finally:
        if pool is not None:
            _stop(pool)


def _read(path: Path) -> Asset:
    suffix = path.suffix.lower()
    if not path.is_file():
        raise InputError(f"{path}: file: expected a 3-D model, found {'a folder' if path.is_dir() else 'no such file'}")
    if suffix in GLTF_SUFFIXES:
        from models3d.gltf.boxes import read_gltf

        return read_gltf(path)
    if suffix in USD:
        from models3d.usd.reader import read_usd

        return read_usd(path)
    if suffix in ROBOT_SUFFIXES:
        from models3d.robots import read_robot

        return read_robot(path, _read)
    if suffix in MESH or suffix == ".dae":
        from models3d.meshes import read_collada, read_mesh

        return read_collada(path) if suffix == ".dae" else read_mesh(path)
    raise InputError(f"{path}: file: expected one of {', '.join(SUFFIXES)}, found {suffix or 'no ending'}")


def _pool() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _limit_memory)


def _limit_memory() -> None:
    import resource

    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY if hard < 0 else min(MAX_MEMORY, hard), hard))


def _stop(pool: ProcessPoolExecutor) -> None:
    for process in list((pool._processes or {}).values()):
        process.kill()
    pool.shutdown(wait=False, cancel_futures=True)


def read_boxes(path: Path, up: Up | None = None) -> Iterator[Asset]:
    """An asset for each row of a CSV or Parquet table with the columns name, x, y, z (metres) and perhaps category, up.

    Raises
    ------
    InputError
        The table has other columns, or a size is no positive number.
    """
    for number, row in enumerate(_rows(path), start=2):
        place = Path(f"{path}:{number}")
        try:
            sizes = np.array([float(row[axis]) for axis in COLUMNS[1:]])
        except (TypeError, ValueError):
            sizes = np.array([np.nan] * 3)
        if not (np.isfinite(sizes).all() and (sizes >= 0).all() and sizes.max() > 0):
            texts = ", ".join(str(row[axis]) for axis in COLUMNS[1:])
            raise InputError.at(place, "x, y, z", "sizes in metres, at least one above 0", Unquoted(texts))
        stated: Up | None = row["up"] if row.get("up") in ("x", "y", "z") else up  # type: ignore[assignment]
        text = str(row.get("category") or row["name"])
        body = AssetBody(str(row["name"]), np.zeros(3), sizes, (NameText("title", text),))
        yield Asset(place, "box", 1.0, stated, (body,))


def _rows(path: Path) -> Iterator[dict[str, str]]:
    if path.suffix.lower() == ".parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            table = pq.read_table(path)
        except (pa.ArrowInvalid, OSError) as error:
            raise InputError.at(path, "file", "a Parquet table", Unquoted(type(error).__name__)) from None
        _check_columns(path, table.column_names)
        yield from table.to_pylist()
        return
    rows = csv.DictReader(read_text(path, MAX_TABLE_BYTES).splitlines())
    _check_columns(path, list(rows.fieldnames or []))
    yield from rows


def _check_columns(path: Path, names: list[str]) -> None:
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        raise InputError.at(path, "columns", ", ".join(COLUMNS), Unquoted(", ".join(names) or "none"))
