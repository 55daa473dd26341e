"""Rows between the steps of a build: the files of ingested rows in a work folder, read by shard, and repeated ids.

Each file of ingested rows has one batch per shard, so that a worker reads its shard of all files and nothing else. A
worker has at most one file's rows of a shard in memory, a sample of each node, or a unit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_tree.checks.duplicates import extent_codes
from metric_tree.checks.unit_errors import MIN_REFERENCE_ROWS, Reference, class_reference, sibling_reference
from metric_tree.fit.rows import STATEMENTS, extents_of
from metric_tree.pipeline.ingest import ROWS, SHARDS
from taxonomy.categories import Category

#: Maximum number of hashes that a worker compares at once, of one partition; with their places they are 40 MB.
MAX_PARTITION_ROWS = 1_000_000

#: Number of rows of a node from which its typical sizes are determined, those with the lowest hashes. The median of
#: 20,000 rows has an error of 1/110 of their standard deviation.
MAX_SAMPLE_ROWS = 20_000

#: Maximum number of rows of a unit, which are about 50 MB.
MAX_UNIT_ROWS = 50_000

#: Places of repeated rows: the number of the file, 8 bits for the shard, and 32 bits for the row of its batch.
_PLACES = pa.schema([("place", pa.uint64())])
_FILE_BITS, _SHARD_BITS, _ROW_MASK = 40, 32, 0xFFFFFFFF


@dataclass(frozen=True, slots=True)
class RepeatedRows:
    """Rows whose id occurs in an earlier row, for one partition of the ids."""

    places: bytes  #: Arrow file of places; batch i is shard i.
    count: int


def repeated_rows(folder: Path, partition: int, n_partitions: int) -> RepeatedRows:
    """Find the rows whose id occurs in an earlier row, among the ids whose hash modulo `n_partitions` is `partition`.

    Parameters
    ----------
    folder : Path
        Work folder with the ingested rows.
    partition, n_partitions : int
        Partition from 0, and number of partitions.
    """
    hashes, places = [np.empty(0, dtype=np.uint64)], [np.empty(0, dtype=np.uint64)]
    for number, path in enumerate(_ingested_files(folder)):
        for shard, batch in enumerate(_batches(path, ROWS, ["hash"], range(SHARDS))):
            values = batch.column(0).to_numpy()
            rows = np.flatnonzero(values % n_partitions == partition)
            hashes.append(values[rows])
            places.append(rows.astype(np.uint64) + np.uint64((number << _FILE_BITS) + (shard << _SHARD_BITS)))
    first = np.unique(np.concatenate(hashes), return_index=True)[1]
    repeated = np.delete(np.concatenate(places), first)
    shards = (repeated >> _SHARD_BITS) % (1 << (_FILE_BITS - _SHARD_BITS))
    sink = pa.BufferOutputStream()
    with pa.ipc.new_file(sink, _PLACES) as writer:
        for shard in range(SHARDS):
            writer.write_batch(pa.record_batch([repeated[shards == shard]], schema=_PLACES))
    return RepeatedRows(bytes(sink.getvalue()), len(repeated))


def shard_batches(folder: Path, shard: int, names: Sequence[str]) -> Iterator[tuple[pa.RecordBatch, NDArray[np.bool_]]]:
    """Yield the ingested rows of a shard by file: columns of `ROWS`, and (n,) whether a row is the first of its id."""
    repeats = (
        batch for path in folder.glob("repeats-*.arrow") for batch in _batches(path, _PLACES, ["place"], [shard])
    )
    places = np.sort(pa.Table.from_batches(repeats, _PLACES)["place"].to_numpy())
    for number, path in enumerate(_ingested_files(folder)):
        (batch,) = _batches(path, ROWS, names, [shard])
        first, last = np.searchsorted(places, np.array([number, number + 1], dtype=np.uint64) << np.uint64(_FILE_BITS))
        is_first = np.ones(len(batch), dtype=bool)
        is_first[places[first:last] & _ROW_MASK] = False
        yield batch, is_first


@dataclass(frozen=True, slots=True, eq=False)
class NodeSizes:
    """Numbers of rows of a node, and sizes from a sample of at most `MAX_SAMPLE_ROWS` of them."""

    n_rows: int  #: With repeated ids.
    n_ids: int
    median: FloatArray  #: (3,) of ln extents.
    reference: Reference | None  #: Of the sizes of real objects; None if there are too few.


def shard_sizes(folder: Path, shard: int) -> dict[str, NodeSizes]:
    """Return the number and the typical sizes of the rows of each node of a shard, which is not in memory at once."""
    n_rows, n_ids = Counter[str](), Counter[str]()
    sample: list[pa.Table] = []
    max_sampled = 2 * MAX_SAMPLE_ROWS
    for batch, is_first in shard_batches(folder, shard, ["hash", "node_id", "extents_mm", "kind"]):
        rows = pa.Table.from_batches([batch]).append_column("is_first", pa.array(is_first))
        n_rows.update(rows["node_id"].to_pylist())
        n_ids.update(rows["node_id"].filter(rows["is_first"]).to_pylist())
        sample.append(rows)
        if sum(map(len, sample)) > max_sampled:
            sample = [_lowest_hashes(pa.concat_tables(sample))]
            max_sampled = 2 * (MAX_SAMPLE_ROWS + len(sample[0]))
    sizes: dict[str, NodeSizes] = {}
    if not n_rows:
        return sizes
    table = _lowest_hashes(pa.concat_tables(sample)).sort_by("node_id")
    is_real = table["is_first"].to_numpy() & ~pc.is_in(table["kind"], pa.array(sorted(STATEMENTS))).to_numpy()
    extents = extents_of(table)
    for index in rows_by_node(table):
        node_id, logs = table["node_id"][int(index[0])].as_py(), np.log(extents[index])
        known = ~np.isnan(logs).all(axis=0)
        median = np.full(3, np.nan)
        median[known] = np.nanmedian(logs[:, known], axis=0)
        reference = class_reference(extents[index[is_real[index]]])
        sizes[node_id] = NodeSizes(n_rows[node_id], n_ids[node_id], median, reference)
    return sizes


def _lowest_hashes(table: pa.Table) -> pa.Table:
    """Return the `MAX_SAMPLE_ROWS` rows with the lowest hashes of each node, in the order of the table."""
    return table.filter(pa.array(hash_ranks(table["node_id"], table["hash"]) < MAX_SAMPLE_ROWS))


def hash_ranks(groups: pa.ChunkedArray, hashes: pa.ChunkedArray) -> NDArray[np.intp]:
    """Return the rank (n,) of each row among the rows of its group, by its hash, then its position."""
    code = pc.dictionary_encode(groups.combine_chunks()).indices.to_numpy()
    order = np.lexsort((hashes.to_numpy(), code))
    _, starts, counts = np.unique(code[order], return_index=True, return_counts=True)
    ranks = np.empty(len(code), dtype=np.intp)
    ranks[order] = np.arange(len(code)) - np.repeat(starts, counts)
    return ranks


def rows_by_node(table: pa.Table) -> list[NDArray[np.intp]]:
    """Return the row indices (k,) of each node of a table that is sorted by node."""
    codes = pc.dictionary_encode(table["node_id"].combine_chunks()).indices.to_numpy()
    starts = np.flatnonzero(np.diff(codes, prepend=-1))
    return np.split(np.arange(len(codes)), starts[1:]) if len(codes) else []


@dataclass(frozen=True, slots=True)
class Unit:
    """Rows that a worker cleans at once: the rows of some nodes of a shard, or a part of the rows of a large node."""

    shard: int
    nodes: tuple[str, ...]
    part: int = 0  #: From 0; rows with equal extents, which may be duplicates, are in the same part.
    n_parts: int = 1


def units(shard: int, sizes: Mapping[str, NodeSizes]) -> list[Unit]:
    """Divide a shard into units of about `MAX_UNIT_ROWS` rows; the division depends on nothing but the rows."""
    found: list[Unit] = []
    room = 0
    for node_id, node in sorted(sizes.items()):
        if node.n_rows <= room:
            found[-1] = replace(found[-1], nodes=(*found[-1].nodes, node_id))
            room -= node.n_rows
        else:
            n_parts = -(-node.n_rows // MAX_UNIT_ROWS)
            found += [Unit(shard, (node_id,), part, n_parts) for part in range(n_parts)]
            room = MAX_UNIT_ROWS - node.n_rows
    return found


def unit_rows(folder: Path, unit: Unit) -> pa.Table:
    """Return the ingested rows (`ROWS`) of a unit without repeated ids, sorted by node and item."""
    nodes, parts = pa.array(unit.nodes, pa.string()), [ROWS.empty_table()]
    for batch, is_first in shard_batches(folder, unit.shard, ROWS.names):
        rows = pa.Table.from_batches([batch]).filter(pc.and_(pc.is_in(batch["node_id"], nodes), pa.array(is_first)))
        if unit.n_parts > 1:
            rows = rows.filter(pa.array(extent_codes(extents_of(rows)) % unit.n_parts == unit.part))
        parts.append(rows)
    table = pa.concat_tables(parts)
    return table.take(pc.sort_indices(table, [("node_id", "ascending"), ("item_id", "ascending")]))


def sibling_references(sizes: Mapping[str, NodeSizes], categories: Sequence[Category]) -> dict[str, Reference]:
    """Return reference sizes of the nodes with fewer than `MIN_REFERENCE_ROWS` rows, from the other children.

    Parameters
    ----------
    sizes : mapping
        Sizes of all nodes (`shard_sizes`).
    categories : sequence of Category
        Categories of the taxonomy.
    """
    parents = {category.node_id: category.parent_id for category in categories}
    families: dict[str | None, list[FloatArray]] = {}
    for node_id, node in sorted(sizes.items()):
        if node.n_rows >= MIN_REFERENCE_ROWS:
            families.setdefault(parents[node_id], []).append(node.median)
    references = {parent: sibling_reference(np.array(family)) for parent, family in families.items()}
    few = (node_id for node_id, node in sizes.items() if node.n_rows < MIN_REFERENCE_ROWS)
    return {node_id: found for node_id in few if (found := references.get(parents[node_id])) is not None}


def _ingested_files(folder: Path) -> list[Path]:
    return sorted(folder.glob("ingest-*.arrow"))


def _batches(path: Path, schema: pa.Schema, names: Sequence[str], shards: Sequence[int]) -> list[pa.RecordBatch]:
    options = pa.ipc.IpcReadOptions(included_fields=[schema.get_field_index(name) for name in names])
    with pa.memory_map(str(path)) as file:
        reader = pa.ipc.open_file(file, options=options)
        return [reader.get_batch(shard) for shard in shards]
