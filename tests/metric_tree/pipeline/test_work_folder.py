"""Rows that repeat an earlier one, over the shards of several files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from metric_tree.pipeline.ingest import ROWS, SHARDS
from metric_tree.pipeline.work_folder import repeated_rows


def write_rows(file: Path, shards: list[list[int]]) -> Path:
    """Write an ingested block whose rows have these hashes; the remaining shards are empty."""
    with pa.ipc.new_file(file, ROWS) as writer:
        for hashes in [*shards, *([[]] * (SHARDS - len(shards)))]:
            rows = [{"item_id": str(value), "hash": value} for value in hashes]
            writer.write_batch(pa.RecordBatch.from_pylist(rows, schema=ROWS))
    return file


@pytest.mark.parametrize("max_partition_rows", [2, 5, 1000])
def test_the_first_row_of_an_id_is_kept_in_any_number_of_partitions(tmp_path: Path, max_partition_rows: int) -> None:
    large = 2**64 - 1
    first = write_rows(tmp_path / "0.arrow", [[7, large, 7], [8]])
    second = write_rows(tmp_path / "1.arrow", [[9], [], [8, large, 10, 10]])
    found = repeated_rows([first, second], max_partition_rows)
    assert [len(file) for file in found] == [SHARDS, SHARDS]
    assert [row.tolist() for row in found[0][:3]] == [[False, False, True], [False], []]
    assert [row.tolist() for row in found[1][:3]] == [[False], [], [True, True, False, True]]


def test_partitions_of_many_rows_find_the_repeats_of_all_rows(tmp_path: Path) -> None:
    generator = np.random.default_rng(3)
    hashes = generator.integers(0, 3000, (4, 1000), dtype=np.uint64)
    paths = [write_rows(tmp_path / f"{number}.arrow", [row.tolist()]) for number, row in enumerate(hashes)]
    seen: set[int] = set()
    expected = []
    for value in hashes.ravel().tolist():
        expected.append(value in seen)
        seen.add(value)
    found = repeated_rows(paths, 300)
    assert np.concatenate([file[0] for file in found]).tolist() == expected


def test_no_file_has_no_rows() -> None:
    assert repeated_rows([]) == []
