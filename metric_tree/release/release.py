"""A release on disk (`metric-tree/1`): published once, whole or not at all; verified when opened."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from metric_base.errors import InputError
from metric_base.escaping import visible
from metric_tree.release.schema import ADDED_COLUMNS, FORMER_TYPES, SCHEMA, TABLES

MANIFEST = "manifest.json"

#: What a manifest must hold (docs/reference/formats.md).
MANIFEST_FIELDS: Mapping[str, type] = {
    "schema": str, "name": str, "version": str, "created": str, "sources": list, "files": dict, "counts": dict
}  # fmt: skip
_COUNTS = ("nodes", "n_fit", "n_rows")
#: What it may hold by node.
_BY_NODE: Mapping[str, type] = {"states": list, "heights": dict}
#: A source's id names files.
_SOURCE_ID = re.compile(r"\w[\w.-]*")
_KINDS: Mapping[type, str] = {str: "text", list: "an array", dict: "an object"}

#: Most rows of a table that is read: a hundred times what ships.
MAX_ROWS = 10_000_000
#: Columns without which a row is of nothing.
NEVER_NULL = frozenset({"node_id", "name", "level", "item_id", "source", "image_id", "family", "dims"})

#: Rows of one Parquet row group: small enough that the items of one node are read without the others.
ROW_GROUP = 20_000


class BadRelease(InputError):
    """A folder that is not a release, or one that this version does not read."""


@dataclass(frozen=True, slots=True, eq=False)
class Release:
    """A verified folder and its manifest."""

    directory: Path
    manifest: Mapping[str, Any]

    def table(
        self, name: str, node_ids: Collection[str] | None = None, columns: Sequence[str] | None = None
    ) -> pa.Table:
        """Table `nodes`, `items`, `priors` or `images`, or some columns of its rows of some nodes, read by row group.

        The bytes are held against the manifest's checksum when the table is first read, and again whenever the file's
        time or inode has changed. `pyarrow.parquet.read_table` would do, but loads pandas where that is installed: a
        second of a query's time.
        """
        table = self.unchecked_table(name, node_ids, columns)
        _see_columns(table, self.directory / f"{name}.parquet", columns)
        return table

    def unchecked_table(
        self, name: str, node_ids: Collection[str] | None = None, columns: Sequence[str] | None = None
    ) -> pa.Table:
        """The same, whatever its columns are."""
        path = self.directory / f"{name}.parquet"
        _see_checksum(path, self.manifest["files"][path.name].get("sha256"))
        try:
            with pq.ParquetFile(path) as file:
                if file.metadata.num_rows > MAX_ROWS:
                    raise BadRelease(f"{path}: rows: expected at most {MAX_ROWS:,}; found {file.metadata.num_rows:,}")
                # one group is read sooner than threads are started
                table = (
                    file.read(columns, use_threads=file.num_row_groups > 1)
                    if node_ids is None
                    else _rows_of(file, frozenset(node_ids), columns)
                )
                table.validate(full=True)  # texts that are no UTF-8, lists that overlap
                return table
        except BadRelease:
            raise
        except (OSError, pa.ArrowException, ValueError, KeyError, TypeError) as error:
            raise BadRelease(f"{path}: expected a Parquet table; found {_first_line(error)}") from None


def publish_release(
    directory: Path, tables: Mapping[str, pa.Table], manifest: Mapping[str, Any], extras: Path | None = None
) -> Release:
    """Write a release beside its final place, checksum it, then rename it there.

    Parameters
    ----------
    tables : by the names of `metric_tree.release.schema.TABLES`; each is cast to its schema.
    manifest : `name`, `version`, `created`, `sources`, `counts` and whatever else; `schema` and `files` are added.
    extras : a folder whose contents (images, texts) are linked into the release, or copied where the disk cannot;
        their checksums go into the manifest.

    Raises
    ------
    BadRelease
        Something is at `directory` already: a release is never changed once published.
    """
    if directory.exists():
        raise BadRelease(f"{directory}: already exists; expected a new path for a release")
    import shutil

    from metric_base.files import whole_folder  # with what a query needs not

    with whole_folder(directory) as work:
        files = {name: _write_table(work / name, tables[name].cast(schema)) for name, schema in TABLES.items()}
        if extras is not None:
            shutil.copytree(extras, work, dirs_exist_ok=True, copy_function=link_file)
        beside = sorted(path for path in work.rglob("*") if path.is_file() and path.name not in TABLES)
        sums = {path.relative_to(work).as_posix(): sha256(path) for path in beside}
        whole = {"schema": SCHEMA, **manifest, "files": files} | ({"extras": sums} if sums else {})
        (work / MANIFEST).write_text(json.dumps(whole, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return Release(directory, whole)


def open_release(directory: Path) -> Release:
    """The release in a folder, after its manifest, its tables' presence and their sizes are verified.

    A table's checksum is verified when it is first read (`Release.table`).

    Raises
    ------
    BadRelease
        No manifest, another schema, a missing field, a missing file or one of another size.
    """
    manifest = _manifest(directory / MANIFEST)
    for name in TABLES:
        recorded = manifest["files"].get(name)
        if not isinstance(recorded, dict) or "bytes" not in recorded:
            raise BadRelease(f"{directory / MANIFEST}: files: expected an entry for {name}; found {recorded!r}")
        path = directory / name
        actual = path.stat().st_size if path.is_file() else None
        if actual != recorded["bytes"]:
            raise BadRelease(f"{path}: expected {recorded['bytes']} bytes; found {actual or 'no file'}")
    return Release(directory, manifest)


def sha256(path: Path) -> str:
    """Hexadecimal SHA-256 of a file, read in pieces."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _see_columns(table: pa.Table, path: Path, columns: Sequence[str] | None) -> None:
    """BadRelease unless the table has these columns, or all, as its schema has them, with an id in every row."""
    for field in TABLES[path.name]:
        if columns is not None and field.name not in columns:
            continue
        if field.name not in table.column_names:
            if field.name in ADDED_COLUMNS:
                continue
            raise BadRelease(f"{path}: {field.name}: expected the column; found none")
        column = table.column(field.name)
        if not column.type.equals(field.type) and not column.type.equals(FORMER_TYPES.get(field.name, field.type)):
            raise BadRelease(f"{path}: {field.name}: expected {field.type}; found {column.type}")
        if field.name in NEVER_NULL and column.null_count:
            raise BadRelease(f"{path}: {field.name}: expected a value in every row; found {column.null_count} without")


def _see_checksum(path: Path, recorded: object) -> None:
    try:
        state = path.stat()
        actual = _checksum(path, state.st_ino, state.st_mtime_ns, state.st_size)
    except OSError as error:
        raise BadRelease(f"{path}: expected a Parquet table; found {_first_line(error)}") from None
    if actual != recorded:
        raise BadRelease(
            f"{path}: sha256: expected {recorded} as in the manifest; found {actual}: the file was altered"
        )


@lru_cache(maxsize=256)
def _checksum(path: Path, _inode: int, _mtime_ns: int, _size: int) -> str:
    """SHA-256 of a file, computed once for each state of it."""
    return sha256(path)


def _manifest(path: Path) -> dict[str, Any]:
    try:
        manifest: Any = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise BadRelease(f"{path}: expected the manifest of a release; found no file") from None
    except (OSError, ValueError, RecursionError) as error:
        raise BadRelease(f"{path}: expected a JSON manifest; found {_first_line(error)}") from None
    schema = manifest.get("schema") if isinstance(manifest, dict) else None
    if schema != SCHEMA:
        raise BadRelease(f"{path}: schema: expected {SCHEMA}, the one this version reads; found {schema!r}")
    _see_fields(manifest, path)
    return dict(manifest)


def _see_fields(manifest: Mapping[str, Any], path: Path) -> None:
    for field, kind in MANIFEST_FIELDS.items():
        if field not in manifest:
            raise BadRelease(f"{path}: {field}: expected a value; found none")
        if not isinstance(manifest[field], kind):
            raise BadRelease(f"{path}: {field}: expected {_KINDS[kind]}; found {type(manifest[field]).__name__}")
    if not all(isinstance(one, dict) and _is_source_id(one.get("id")) for one in manifest["sources"]):
        raise BadRelease(f"{path}: sources: expected objects with an id of letters, digits, _, - and .; found others")
    for field in _COUNTS:
        if not isinstance(count := manifest["counts"].get(field), int):
            raise BadRelease(f"{path}: counts.{field}: expected a whole number; found {visible(str(count))}")
    for field, kind in _BY_NODE.items():
        if not _is_by_node(manifest.get(field, {}), kind):
            raise BadRelease(f"{path}: {field}: expected {_KINDS[kind]} for each node; found others")


def _is_by_node(value: object, kind: type) -> bool:
    """Return True if a value has a record for each node, or a list of records."""
    if not isinstance(value, dict) or not all(isinstance(one, kind) for one in value.values()):
        return False
    records = chain.from_iterable(value.values()) if kind is list else value.values()
    return all(isinstance(one, dict) for one in records)


def _is_source_id(value: object) -> bool:
    return isinstance(value, str) and _SOURCE_ID.fullmatch(value) is not None


def _write_table(path: Path, table: pa.Table) -> dict[str, Any]:
    pq.write_table(table, path, compression="zstd", row_group_size=ROW_GROUP)
    return {"sha256": sha256(path), "rows": table.num_rows, "bytes": path.stat().st_size}


def _rows_of(file: pq.ParquetFile, node_ids: frozenset[str], columns: Sequence[str] | None) -> pa.Table:
    """The rows of some nodes, without `pyarrow.compute`, whose import takes longer than the reading."""
    parts = []
    for number in range(file.num_row_groups):
        if _may_hold(file.metadata.row_group(number), node_ids):
            ids = file.read_row_group(number, columns=["node_id"])["node_id"].to_pylist()
            ends = [place for place in range(1, len(ids)) if (ids[place] in node_ids) != (ids[place - 1] in node_ids)]
            runs = [one for one in pairwise([0, *ends, len(ids)]) if ids and ids[one[0]] in node_ids]
            if runs:
                group = file.read_row_group(number, columns)
                parts += [group.slice(first, end - first) for first, end in runs]
    schema = file.schema_arrow
    schema = schema if columns is None else pa.schema([schema.field(name) for name in columns])
    return pa.concat_tables(parts) if parts else schema.empty_table()


def _may_hold(group: pq.RowGroupMetaData, node_ids: Collection[str]) -> bool:
    """Return True if a row group may have a row of these nodes, by the least and the greatest id that it states."""
    column = next(one for k in range(group.num_columns) if (one := group.column(k)).path_in_schema == "node_id")
    stated = column.statistics
    return stated is None or not stated.has_min_max or any(stated.min <= one <= stated.max for one in node_ids)


def link_file(source: str | Path, target: str | Path) -> None:
    """A second name of a file that never changes; a copy where the disk has none, or where it is on another."""
    try:
        os.link(source, target)
    except OSError:
        import shutil

        shutil.copy2(source, target)


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def check_nodes(ids: Sequence[str], parents: Sequence[str | None], directory: Path) -> None:
    """Refuse a table of nodes, ids and parents by row, that is no tree.

    Raises
    ------
    BadRelease
        There are none, two have one id, an id has control characters, or a parent is missing or below its child.
    """
    places = {node_id: place for place, node_id in enumerate(ids)}
    where = f"{directory}/nodes.parquet"
    if not ids or not "".join(ids).isprintable():
        raise BadRelease(f"{where}: node_id: expected printable ids; found {'others' if ids else 'no node'}")
    if len(places) < len(ids):
        raise BadRelease(f"{where}: node_id: expected ids that differ; found {len(ids) - len(places)} twice")
    if missing := next((one for one in parents if one is not None and one not in places), None):
        raise BadRelease(f"{where}: parent_id: expected the id of a node; found '{visible(missing)}'")
    if (row := _in_circle(parents, places)) is not None:
        raise BadRelease(f"{where}: {visible(ids[row])}: parent_id: expected a tree; found a circle")


def _in_circle(parents: Sequence[str | None], places: Mapping[str, int]) -> int | None:
    """The row of a node that is above itself: what walks such a tree does not end. None if there is none.

    parents : ids by row; places : row by id.
    """
    none = len(parents)
    above = np.array([*(none if one is None else places[one] for one in parents), none])  # (n + 1,) rows
    for _ in range(none.bit_length()):  # twice as far up each time: at last beyond the root, but in a circle
        above = above[above]
    stuck = above[above < none]
    return int(stuck[0]) if len(stuck) else None
