"""A release on disk (`metric-tree/1`): published once, completely or not at all, and verified when it is opened."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from metric_base.errors import InputError
from metric_base.escaping import visible
from metric_base.operating_system import link_or_copy
from metric_tree.release.schema import ADDED_COLUMNS, FORMER_TYPES, SCHEMA, TABLES

MANIFEST = "manifest.json"

#: Required fields of a manifest (docs/reference/formats.md).
MANIFEST_FIELDS: Mapping[str, type] = {
    "schema": str, "name": str, "version": str, "created": str, "sources": list, "files": dict, "counts": dict
}  # fmt: skip
_COUNTS = ("nodes", "n_fit", "n_rows")
#: Optional fields of a manifest, with a list of records or one record by node.
_BY_NODE: Mapping[str, type] = {"states": list, "heights": dict}
#: Id of a source, which is also the name of files.
_SOURCE_ID = re.compile(r"\w[\w.-]*")
_TYPE_NAMES: Mapping[type, str] = {str: "text", list: "an array", dict: "an object"}

#: Maximum number of rows of a table: a hundred times the largest shipped table.
MAX_ROWS = 10_000_000
#: Columns with a value in every row.
NEVER_NULL = frozenset({"node_id", "name", "level", "item_id", "source", "image_id", "family", "dims"})

#: Rows of a Parquet row group: few enough that the items of a node are read without most of the others.
ROW_GROUP = 20_000


class BadRelease(InputError):
    """A folder is not a release, or not one that this version reads."""


@dataclass(frozen=True, slots=True, eq=False)
class Release:
    """A verified folder and its manifest."""

    directory: Path
    manifest: Mapping[str, Any]

    def table(
        self, name: str, node_ids: Collection[str] | None = None, columns: Sequence[str] | None = None
    ) -> pa.Table:
        """Read the table `nodes`, `items`, `priors` or `images`, or some columns of the rows of some nodes.

        The checksum of the file is compared with the manifest when the table is first read, and again after the time
        or inode of the file has changed. `pyarrow.parquet.read_table` is not used, because it loads pandas if that is
        installed, which takes a second.

        Raises
        ------
        BadRelease
            The checksum differs, the file is not a Parquet table of the schema, or a required value is missing.
        """
        table = self.unchecked_table(name, node_ids, columns)
        path = self.directory / f"{name}.parquet"
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
                without = f"{column.null_count} without"
                raise BadRelease(f"{path}: {field.name}: expected a value in every row; found {without}")
        return table

    def unchecked_table(
        self, name: str, node_ids: Collection[str] | None = None, columns: Sequence[str] | None = None
    ) -> pa.Table:
        """Read a table as `table`, without comparing its columns with the schema."""
        path = self.directory / f"{name}.parquet"
        recorded = self.manifest["files"][path.name].get("sha256")
        try:
            state = path.stat()
            checksum = _checksum(path, state.st_ino, state.st_mtime_ns, state.st_size)
            if checksum != recorded:
                altered = f"expected {recorded} as in the manifest; found {checksum}: the file was altered"
                raise BadRelease(f"{path}: sha256: {altered}")
            with pq.ParquetFile(path) as file:
                if file.metadata.num_rows > MAX_ROWS:
                    raise BadRelease(f"{path}: rows: expected at most {MAX_ROWS:,}; found {file.metadata.num_rows:,}")
                if node_ids is None:  # a single group is read faster without threads
                    table = file.read(columns, use_threads=file.num_row_groups > 1)
                else:
                    table = rows_of_nodes(path, file, frozenset(node_ids), columns)
                table.validate(full=True)  # invalid UTF-8, overlapping lists
                return table
        except BadRelease:
            raise
        except (OSError, pa.ArrowException, ValueError, KeyError, TypeError) as error:
            raise BadRelease(f"{path}: expected a Parquet table; found {_first_line(error)}") from None


def rows_of_nodes(
    path: Path, file: pq.ParquetFile, node_ids: frozenset[str], columns: Sequence[str] | None
) -> pa.Table:
    """Read the rows of some nodes from the row groups whose range of ids includes one of them.

    The ids are read as a dictionary, which is faster than a list of strings by a factor of 10. `pyarrow.compute` is
    not used, because its import takes longer than the reading.
    """
    schema = file.schema_arrow
    if schema.field("node_id").type != pa.string():
        return schema.empty_table()  # `Release.table` reports the type
    parts = []
    with pq.ParquetFile(path, metadata=file.metadata, read_dictionary=["node_id"]) as coded:
        for index in range(file.num_row_groups):
            group = file.metadata.row_group(index)
            columns_of_group = map(group.column, range(group.num_columns))
            stated = next(one for one in columns_of_group if one.path_in_schema == "node_id").statistics
            if stated is None or not stated.has_min_max or any(stated.min <= one <= stated.max for one in node_ids):
                ids = coded.read_row_group(index, columns=["node_id"])["node_id"].combine_chunks()
                codes = [code for code, one in enumerate(ids.dictionary.to_pylist()) if one in node_ids]
                is_wanted = np.isin(np.from_dlpack(ids.indices), codes)
                ends = np.flatnonzero(np.diff(is_wanted, prepend=False, append=False))
                if len(ends):
                    rows = file.read_row_group(index, columns)
                    parts += [rows.slice(first, end - first) for first, end in ends.reshape(-1, 2).tolist()]
    schema = schema if columns is None else pa.schema([schema.field(name) for name in columns])
    return pa.concat_tables(parts) if parts else schema.empty_table()


def publish_release(
    directory: Path, tables: Mapping[str, pa.Table], manifest: Mapping[str, Any], extras: Path | None = None
) -> Release:
    """Write a release next to its final path with checksums, then rename it.

    Parameters
    ----------
    directory : Path
        Final path.
    tables : mapping of str to Table
        Tables by file name (`metric_tree.release.schema.TABLES`), which are cast to their schemas.
    manifest : mapping
        `name`, `version`, `created`, `sources`, `counts` and optional fields; `schema` and `files` are added.
    extras : Path, optional
        Folder with images and texts that are hard-linked into the release (or copied); their checksums are added to
        the manifest.

    Raises
    ------
    BadRelease
        `directory` exists: a published release is never changed.
    """
    if directory.exists():
        raise BadRelease(f"{directory}: already exists; expected a new path for a release")
    import shutil

    from metric_base.files import whole_folder  # not needed by queries

    with whole_folder(directory) as work:
        files = {}
        for name, schema in TABLES.items():
            path, table = work / name, tables[name].cast(schema)
            pq.write_table(table, path, compression="zstd", row_group_size=ROW_GROUP)
            files[name] = {"sha256": sha256(path), "rows": table.num_rows, "bytes": path.stat().st_size}
        if extras is not None:
            shutil.copytree(extras, work, dirs_exist_ok=True, copy_function=link_or_copy)
        others = sorted(path for path in work.rglob("*") if path.is_file() and path.name not in TABLES)
        checksums = {path.relative_to(work).as_posix(): sha256(path) for path in others}
        complete = {"schema": SCHEMA, **manifest, "files": files} | ({"extras": checksums} if checksums else {})
        (work / MANIFEST).write_text(json.dumps(complete, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return Release(directory, complete)


def open_release(directory: Path) -> Release:
    """Open the release in a folder, and verify its manifest and the sizes of its tables.

    The checksum of a table is verified when it is first read (`Release.table`).

    Raises
    ------
    BadRelease
        The manifest is missing, has another schema or lacks a field, or a file is missing or of another size.
    """
    path = directory / MANIFEST
    try:
        manifest: Any = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise BadRelease(f"{path}: expected the manifest of a release; found no file") from None
    except (OSError, ValueError, RecursionError) as error:
        raise BadRelease(f"{path}: expected a JSON manifest; found {_first_line(error)}") from None
    schema = manifest.get("schema") if isinstance(manifest, dict) else None
    if schema != SCHEMA:
        raise BadRelease(f"{path}: schema: expected {SCHEMA}, the one this version reads; found {schema!r}")
    check_manifest(manifest, path)
    for name in TABLES:
        recorded = manifest["files"].get(name)
        if not isinstance(recorded, dict) or "bytes" not in recorded:
            raise BadRelease(f"{path}: files: expected an entry for {name}; found {recorded!r}")
        table = directory / name
        actual = table.stat().st_size if table.is_file() else None
        if actual != recorded["bytes"]:
            raise BadRelease(f"{table}: expected {recorded['bytes']} bytes; found {actual or 'no file'}")
    return Release(directory, dict(manifest))


def check_manifest(manifest: Mapping[str, Any], path: Path) -> None:
    """Check the fields of a manifest.

    Raises
    ------
    BadRelease
        A required field is missing, or a field is not of its type.
    """
    for field, kind in MANIFEST_FIELDS.items():
        if field not in manifest:
            raise BadRelease(f"{path}: {field}: expected a value; found none")
        if not isinstance(manifest[field], kind):
            raise BadRelease(f"{path}: {field}: expected {_TYPE_NAMES[kind]}; found {type(manifest[field]).__name__}")
    ids = [one.get("id") if isinstance(one, dict) else None for one in manifest["sources"]]
    if not all(isinstance(one, str) and _SOURCE_ID.fullmatch(one) for one in ids):
        raise BadRelease(f"{path}: sources: expected objects with an id of letters, digits, _, - and .; found others")
    for field in _COUNTS:
        if not isinstance(count := manifest["counts"].get(field), int):
            raise BadRelease(f"{path}: counts.{field}: expected a whole number; found {visible(str(count))}")
    for field, kind in _BY_NODE.items():
        by_node = manifest.get(field, {})
        values: list[Any] = list(by_node.values()) if isinstance(by_node, dict) else [None]
        is_valid = all(isinstance(value, kind) for value in values)
        if not is_valid or not all(isinstance(one, dict) for one in (chain(*values) if kind is list else values)):
            raise BadRelease(f"{path}: {field}: expected {_TYPE_NAMES[kind]} for each node; found others")


def check_nodes(ids: Sequence[str], parents: Sequence[str | None], directory: Path) -> None:
    """Check that ids and parents, by row of the table of nodes, are a tree.

    Raises
    ------
    BadRelease
        There is no node, two nodes have one id, an id has control characters, or a parent is missing or a descendant.
    """
    rows = {node_id: row for row, node_id in enumerate(ids)}
    table = f"{directory}/nodes.parquet"
    if not ids or not "".join(ids).isprintable():
        raise BadRelease(f"{table}: node_id: expected printable ids; found {'others' if ids else 'no node'}")
    if len(rows) < len(ids):
        raise BadRelease(f"{table}: node_id: expected ids that differ; found {len(ids) - len(rows)} twice")
    if missing := next((one for one in parents if one is not None and one not in rows), None):
        raise BadRelease(f"{table}: parent_id: expected the id of a node; found '{visible(missing)}'")
    n = len(parents)  # also the row above the root
    above = np.array([*(n if parent is None else rows[parent] for parent in parents), n])  # (n + 1,) rows
    for _ in range(n.bit_length()):  # the number of levels doubles; only a row of a cycle does not reach row n
        above = above[above]
    cyclic = above[above < n]
    if len(cyclic):
        raise BadRelease(f"{table}: {visible(ids[int(cyclic[0])])}: parent_id: expected a tree; found a circle")


def sha256(path: Path) -> str:
    """Return the hexadecimal SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@lru_cache(maxsize=256)
def _checksum(path: Path, _inode: int, _mtime_ns: int, _size: int) -> str:
    """Return the SHA-256 of a file, computed once for each state of the file."""
    return sha256(path)


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
