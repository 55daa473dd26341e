"""The ingested rows of a build on disk: one Arrow file per block, whose batch i is shard i."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from metric_base.arrays import FloatArray
from metric_tree.checks.unit_errors import MIN_REFERENCE_ROWS, Reference, sibling_reference
from metric_tree.pipeline.clean import extents_of
from metric_tree.pipeline.ingest import ROWS, SHARDS
from taxonomy.categories import Category

__all__ = ["Repeated", "RowFiles", "sibling_references"]


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
