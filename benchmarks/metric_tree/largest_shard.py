"""Memory of a worker in step 2 of a build: `python -m benchmarks.metric_tree.largest_shard [--rows 20000 2000000]`.

A shard of synthetic ingested rows, 45 % of them of one node, in files of 5,000 rows, as the largest shard of a build of
five times as many rows (`benchmarks.metric_tree.growth`). One process determines its typical sizes and cleans its first
and its last unit, and prints its peak memory, and the processor time of the sizes and of a unit.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow as pa

from benchmarks.child import _peak_kib
from benchmarks.common import options_parser
from metric_tree.pipeline.clean import clean_unit
from metric_tree.pipeline.ingest import ROWS, SHARDS
from metric_tree.pipeline.shards import shard_sizes, units

#: Rows of the shard in a file of step 1.
FILE_ROWS = 5_000


def main() -> None:
    """Print a row for each number of rows."""
    parser = options_parser(__doc__)
    parser.add_argument("--rows", type=int, nargs="+", default=[20_000, 200_000, 2_000_000])
    parser.add_argument("--folder", type=Path, help="folder of one shard, which is cleaned in this process")
    options = parser.parse_args()
    if options.folder is not None:
        print(json.dumps(_measured(options)))
        return
    print("rows of the shard | units | peak MB | cpu s of the sizes | cpu s of a unit")
    for rows in options.rows:
        with tempfile.TemporaryDirectory(prefix="shard-") as folder:
            _write_shard(Path(folder), rows)
            words = [sys.executable, "-m", "benchmarks.metric_tree.largest_shard", "--folder", folder]
            done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=3600)
            print(" | ".join([f"{rows:,}", *map(str, json.loads(done.stdout))]), flush=True)


def _write_shard(folder: Path, n_rows: int) -> None:
    generator = np.random.default_rng(0)
    empty = pa.RecordBatch.from_pylist([], schema=ROWS)
    for number, first in enumerate(range(0, n_rows, FILE_ROWS)):
        kinds = np.where(generator.random(FILE_ROWS) < 0.45, 0, generator.integers(1, 6, FILE_ROWS)).tolist()
        sizes = -np.sort(-np.exp(generator.normal(6, 0.3, (FILE_ROWS, 3))).round(1), axis=1)
        places = range(first, first + FILE_ROWS)
        columns = {
            "item_id": [f"shop{place % 8}:{place}" for place in places],
            "hash": generator.integers(0, 2**63, FILE_ROWS, dtype=np.uint64),
            "node_id": [f"mt:kind{kind}" for kind in kinds],
            "pose": ["upright"] * FILE_ROWS,
            "source": [f"shop{place % 8}" for place in places],
            "source_id": [str(place) for place in places],
            "title": [f"thing of kind {kind}, model {place}" for kind, place in zip(kinds, places, strict=True)],
            "length_mm": sizes[:, 0],
            "width_mm": sizes[:, 1],
            "height_mm": sizes[:, 2],
            "extents_mm": sizes.tolist(),
            "kind": ["product"] * FILE_ROWS,
            "url": [f"https://example.org/{place}" for place in places],
            "flags": [[]] * FILE_ROWS,
        }
        arrays = [
            pa.array(columns[field.name], field.type) if field.name in columns else pa.nulls(FILE_ROWS, field.type)
            for field in ROWS
        ]
        path = folder / f"ingest-{number:07d}.arrow"
        with pa.ipc.new_file(path, ROWS, options=pa.ipc.IpcWriteOptions(compression="zstd")) as writer:
            for shard in range(SHARDS):
                writer.write_batch(empty if shard else pa.RecordBatch.from_arrays(arrays, schema=ROWS))


def _measured(options: argparse.Namespace) -> list[float]:
    """Return the number of units, the peak memory in MB, and the processor times of the sizes and of a unit."""
    started = time.process_time()
    sizes = shard_sizes(options.folder, 0)
    sized = time.process_time()
    divided = units(0, sizes)
    references = {node_id: node.reference for node_id, node in sizes.items()}
    for unit in (divided[0], divided[-1]):
        clean_unit(options.folder, unit, {}, references, frozenset())
    per_unit = (time.process_time() - sized) / 2
    return [len(divided), round(_peak_kib(os.getpid()) / 1024), round(sized - started, 2), round(per_unit, 2)]


if __name__ == "__main__":
    main()
