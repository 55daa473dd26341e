"""Blocks of raw files as ranges of bytes, and rows that repeat an earlier one over the shards of several files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from crawler.items import BadRawItem
from metric_tree.pipeline import ingest, shards
from metric_tree.pipeline.ingest import ROWS, SHARDS, blocks, items_of
from metric_tree.pipeline.shards import NodeSizes, repeated_rows, shard_batches, shard_sizes, unit_rows, units
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


def write_rows(folder: Path, number: int, hashes_of: list[list[int]]) -> None:
    """Write an ingested block whose rows have these hashes; the remaining shards are empty."""
    with pa.ipc.new_file(folder / f"ingest-{number:07d}.arrow", ROWS) as writer:
        for hashes in [*hashes_of, *([[]] * (SHARDS - len(hashes_of)))]:
            rows = [{"item_id": str(value), "hash": value} for value in hashes]
            writer.write_batch(pa.RecordBatch.from_pylist(rows, schema=ROWS))


def remaining(folder: Path, n_partitions: int) -> tuple[int, list[list[int]]]:
    """Return the number of repeated rows, and the hashes of the remaining rows of each shard."""
    calls = [(folder, partition, n_partitions) for partition in range(n_partitions)]
    found = list(BuildFolder(folder).map("repeats", repeated_rows, calls, SerialExecutor(), {"places": ".arrow"}))
    rows = [
        [
            value
            for batch, is_first in shard_batches(folder, shard, ["hash"])
            for value in batch["hash"].filter(pa.array(is_first)).to_pylist()
        ]
        for shard in range(SHARDS)
    ]
    return sum(result.count for result in found), rows


@pytest.mark.parametrize("n_partitions", [1, 2, 7])
def test_the_first_row_of_an_id_is_kept_in_any_number_of_partitions(tmp_path: Path, n_partitions: int) -> None:
    large = 2**64 - 1
    write_rows(tmp_path, 0, [[7, large, 7], [8]])
    write_rows(tmp_path, 1, [[9], [], [8, large, 10, 10]])
    count, hashes = remaining(tmp_path, n_partitions)
    assert count == 4
    assert hashes[:3] == [[7, large, 9], [8], [10]]


def test_partitions_of_many_rows_find_the_repeats_of_all_rows(tmp_path: Path) -> None:
    hashes = np.random.default_rng(3).integers(0, 3000, (4, 1000), dtype=np.uint64)
    for number, row in enumerate(hashes):
        write_rows(tmp_path, number, [row.tolist()])
    count, found = remaining(tmp_path, 5)
    assert found[0] == list(dict.fromkeys(hashes.ravel().tolist()))
    assert count == hashes.size - len(found[0])


def test_no_file_has_no_rows(tmp_path: Path) -> None:
    assert remaining(tmp_path, 1) == (0, [[] for _ in range(SHARDS)])


def write_sizes(folder: Path, n_files: int = 3) -> list[dict[str, object]]:
    """Write rows of two nodes in shard 0, some of them with the id of an earlier row; return the rows of single ids."""
    generator = np.random.default_rng(1)
    rows: dict[str, dict[str, object]] = {}
    for number in range(n_files):
        block = []
        for _ in range(400):
            node_id = "large" if generator.random() < 0.9 else "small"
            code = int(generator.integers(0, 2000))
            extents = sorted(generator.integers(100, 110, 3).astype(float).tolist(), reverse=True)
            row = {"item_id": f"{code:04d}", "hash": code, "node_id": node_id, "kind": "product", "extents_mm": extents}
            block.append(row)
            rows.setdefault(f"{code:04d}", row)
        with pa.ipc.new_file(folder / f"ingest-{number:07d}.arrow", ROWS) as writer:
            for shard in range(SHARDS):
                writer.write_batch(pa.RecordBatch.from_pylist(block if shard == 0 else [], schema=ROWS))
    list(BuildFolder(folder).map("repeats", repeated_rows, [(folder, 0, 1)], SerialExecutor(), {"places": ".arrow"}))
    return list(rows.values())


def test_units_have_every_row_once_and_equal_extents_of_a_large_node_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The largest node is divided, and its duplicates meet in one part."""
    monkeypatch.setattr(shards, "MAX_UNIT_ROWS", 300)
    rows = write_sizes(tmp_path)
    divided = units(0, shard_sizes(tmp_path, 0))
    assert [(one.nodes, one.part, one.n_parts) for one in divided] == [
        *((("large",), part, 4) for part in range(4)),
        (("small",), 0, 1),
    ]
    tables = [unit_rows(tmp_path, unit) for unit in divided]
    assert sorted(row for one in tables for row in one["item_id"].to_pylist()) == sorted(row["item_id"] for row in rows)
    assert max(one.num_rows for one in tables) < 400
    seen = [set(map(tuple, one["extents_mm"].to_pylist())) for one in tables[:4]]
    assert sum(map(len, seen)) == len(set.union(*seen))


@pytest.mark.parametrize(("n_rows", "n_parts"), [(300, 1), (301, 2)])
def test_a_node_is_divided_above_the_maximum_of_a_unit(
    monkeypatch: pytest.MonkeyPatch, n_rows: int, n_parts: int
) -> None:
    monkeypatch.setattr(shards, "MAX_UNIT_ROWS", 300)
    assert len(units(0, {"node": NodeSizes(n_rows, n_rows, np.zeros(3), None)})) == n_parts


@pytest.mark.parametrize("max_rows", [100, 20_000])
def test_typical_sizes_are_those_of_the_rows_with_the_lowest_hashes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, max_rows: int
) -> None:
    """The sample of a stream of files is the sample of all rows."""
    monkeypatch.setattr(shards, "MAX_SAMPLE_ROWS", max_rows)
    write_sizes(tmp_path, 8)
    table = pa.concat_tables(
        pa.ipc.open_file(pa.memory_map(str(path))).read_all() for path in sorted(tmp_path.glob("ingest-*.arrow"))
    )
    found = shard_sizes(tmp_path, 0)
    assert found["large"].n_rows + found["small"].n_rows == table.num_rows > found["large"].n_ids + found["small"].n_ids
    for node_id, node in found.items():
        rows = table.filter(pa.compute.equal(table["node_id"], node_id))
        lowest = np.argsort(rows["hash"].to_numpy(), kind="stable")[:max_rows]
        logs = np.log(np.array(rows["extents_mm"].to_pylist())[lowest])
        assert np.array_equal(node.median, np.median(logs, axis=0))
