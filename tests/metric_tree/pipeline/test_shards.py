"""Blocks of raw files as ranges of bytes, and rows that repeat an earlier one over the shards of several files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from crawler.items import BadRawItem
from metric_tree.pipeline import ingest
from metric_tree.pipeline.ingest import ROWS, SHARDS, blocks, items_of
from metric_tree.pipeline.shards import repeated_rows, shard_rows
from metric_tree.pipeline.work_folder import BuildFolder, SerialExecutor
from tests.synthetic.raw_fixture import synthetic_items, written


@pytest.mark.parametrize("block_bytes", [1, 97, 400, 5000, 10**9])
@pytest.mark.parametrize("end", ["", "\n", "\n\n"])
def test_blocks_of_any_size_have_each_line_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block_bytes: int, end: str
) -> None:
    items = synthetic_items(4)
    path = tmp_path / "raw.jsonl"
    path.write_text("\n".join(item.line() for item in items) + end)
    monkeypatch.setattr(ingest, "BLOCK_BYTES", block_bytes)
    assert [item for block in blocks(path, "raw") for item in items_of(block)] == items


@pytest.mark.parametrize("block_bytes", [1, 97, 400, 5000])
def test_an_error_in_a_later_block_states_the_line_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block_bytes: int
) -> None:
    path = written(tmp_path / "raw.jsonl", synthetic_items(4))
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:9], "", "no item", *lines[9:]]))
    monkeypatch.setattr(ingest, "BLOCK_BYTES", block_bytes)
    with pytest.raises(BadRawItem, match=r"^mine:11: line: expected a JSON object"):
        [item for block in blocks(path, "mine") for item in items_of(block)]


def write_rows(folder: Path, number: int, shards: list[list[int]]) -> None:
    """Write an ingested block whose rows have these hashes; the remaining shards are empty."""
    with pa.ipc.new_file(folder / f"ingest-{number:07d}.arrow", ROWS) as writer:
        for hashes in [*shards, *([[]] * (SHARDS - len(shards)))]:
            rows = [{"item_id": str(value), "hash": value} for value in hashes]
            writer.write_batch(pa.RecordBatch.from_pylist(rows, schema=ROWS))


def remaining(folder: Path, n_partitions: int) -> tuple[int, list[list[int]]]:
    """Return the number of repeated rows, and the hashes of the remaining rows of each shard."""
    calls = [(folder, partition, n_partitions) for partition in range(n_partitions)]
    found = list(BuildFolder(folder).map("repeats", repeated_rows, calls, SerialExecutor(), {"places": ".arrow"}))
    shards = [shard_rows(folder, shard)["hash"].to_pylist() for shard in range(SHARDS)]
    return sum(result.count for result in found), shards


@pytest.mark.parametrize("n_partitions", [1, 2, 7])
def test_the_first_row_of_an_id_is_kept_in_any_number_of_partitions(tmp_path: Path, n_partitions: int) -> None:
    large = 2**64 - 1
    write_rows(tmp_path, 0, [[7, large, 7], [8]])
    write_rows(tmp_path, 1, [[9], [], [8, large, 10, 10]])
    count, shards = remaining(tmp_path, n_partitions)
    assert count == 4
    assert shards[:3] == [[7, large, 9], [8], [10]]


def test_partitions_of_many_rows_find_the_repeats_of_all_rows(tmp_path: Path) -> None:
    hashes = np.random.default_rng(3).integers(0, 3000, (4, 1000), dtype=np.uint64)
    for number, row in enumerate(hashes):
        write_rows(tmp_path, number, [row.tolist()])
    count, shards = remaining(tmp_path, 5)
    assert shards[0] == list(dict.fromkeys(hashes.ravel().tolist()))
    assert count == hashes.size - len(shards[0])


def test_no_file_has_no_rows(tmp_path: Path) -> None:
    assert remaining(tmp_path, 1) == (0, [[] for _ in range(SHARDS)])
