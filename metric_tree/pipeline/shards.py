"""Rows between the steps of a build: the files of ingested rows in a work folder, read by shard, and repeated ids.

Each file of ingested rows has one batch per shard, so that a worker reads its shard of all files and nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from metric_base.arrays import FloatArray
from metric_tree.checks.unit_errors import MIN_REFERENCE_ROWS, Reference, sibling_reference
from metric_tree.fit.rows import extents_of
from metric_tree.pipeline.ingest import ROWS, SHARDS
from taxonomy.categories import Category

#: Maximum number of hashes that a worker compares at once, of one partition; with their places they are 200 MB.
MAX_PARTITION_ROWS = 5_000_000

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


def shard_rows(folder: Path, shard: int) -> pa.Table:
    """Return a shard of the ingested rows (`ROWS`) without the repeated ones."""
    batches = [
        batch for path in folder.glob("repeats-*.arrow") for batch in _batches(path, _PLACES, ["place"], [shard])
    ]
    places = np.sort(pa.Table.from_batches(batches, _PLACES)["place"].to_numpy())
    parts = []
    for number, path in enumerate(_ingested_files(folder)):
        (batch,) = _batches(path, ROWS, ROWS.names, [shard])
        first, last = np.searchsorted(places, np.array([number, number + 1], dtype=np.uint64) << np.uint64(_FILE_BITS))
        is_kept = np.ones(len(batch), dtype=bool)
        is_kept[places[first:last] & _ROW_MASK] = False
        parts.append(batch.filter(pa.array(is_kept)))
    return pa.Table.from_batches(parts, ROWS)


def shard_medians(folder: Path, shard: int) -> dict[str, tuple[int, FloatArray]]:
    """Return the number of rows and the medians (3,) of the ln extents of each node of a shard."""
    batches = [
        batch for path in _ingested_files(folder) for batch in _batches(path, ROWS, ["node_id", "extents_mm"], [shard])
    ]
    schema = pa.schema([ROWS.field("node_id"), ROWS.field("extents_mm")])
    table = pa.Table.from_batches(batches, schema)
    logs = np.log(extents_of(table))
    nodes, code = np.unique(table["node_id"].to_numpy(zero_copy_only=False).astype(str), return_inverse=True)
    medians = {}
    for index, node_id in enumerate(nodes.tolist()):
        chosen = logs[code == index]
        known = ~np.isnan(chosen).all(axis=0)
        median = np.full(3, np.nan)
        median[known] = np.nanmedian(chosen[:, known], axis=0)
        medians[node_id] = len(chosen), median
    return medians


def sibling_references(
    medians: Mapping[str, tuple[int, FloatArray]], categories: Sequence[Category]
) -> dict[str, Reference]:
    """Return reference sizes of the nodes with fewer than `MIN_REFERENCE_ROWS` rows, from the other children.

    Parameters
    ----------
    medians : mapping
        Number of rows and medians (3,) of ln extents of all nodes (`shard_medians`).
    categories : sequence of Category
        Categories of the taxonomy.
    """
    parents = {category.node_id: category.parent_id for category in categories}
    families: dict[str | None, list[FloatArray]] = {}
    for node_id, (count, median) in sorted(medians.items()):
        if count >= MIN_REFERENCE_ROWS:
            families.setdefault(parents[node_id], []).append(median)
    references = {parent: sibling_reference(np.array(family)) for parent, family in families.items()}
    few = (node_id for node_id, (count, _) in medians.items() if count < MIN_REFERENCE_ROWS)
    return {node_id: found for node_id in few if (found := references.get(parents[node_id])) is not None}


def _ingested_files(folder: Path) -> list[Path]:
    return sorted(folder.glob("ingest-*.arrow"))


def _batches(path: Path, schema: pa.Schema, names: Sequence[str], shards: Sequence[int]) -> list[pa.RecordBatch]:
    options = pa.ipc.IpcReadOptions(included_fields=[schema.get_field_index(name) for name in names])
    with pa.memory_map(str(path)) as file:
        reader = pa.ipc.open_file(file, options=options)
        return [reader.get_batch(shard) for shard in shards]
