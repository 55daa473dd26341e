"""The priors of a build of open sources are those that it had: who changes a fit sees which numbers move, and how far.

`python -m tests.metric_tree.fit.test_same_numbers` writes the file anew, where a change is meant.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from metric_tree.pipeline.build import BuildOptions, build_release

RAW = Path(__file__).resolve().parents[3] / "data" / "raw"
#: Products, models and made objects; several of one class, some with a region and a year.
SOURCES = ("gazebo_models", "procthor_ai2thor", "tdw_models", "open_models", "energy_star_2025")
NUMBERS = Path(__file__).with_name("same_numbers.json")
#: Every so manieth prior is in the file, by its node's id.
STEP = 12
COLUMNS = ("weights", "means", "covariances", "shared_covariance", "sameness", "evidence", "contexts")


def _numbers(folder: Path) -> dict[str, list[float]]:
    """The numbers of some priors of a build in `folder`, one list each."""
    files = [RAW / f"{name}.jsonl.gz" for name in SOURCES]
    build_release(files, folder, BuildOptions(version="0.0.0", created="2026-11-23", name="numbers", heldout=False))
    rows = {
        f"{row['node_id']} {' '.join(row['dims'])}": row for row in pq.read_table(folder / "priors.parquet").to_pylist()
    }
    return {name: [v for column in COLUMNS for v in _flat(rows[name][column])] for name in sorted(rows)[::STEP]}


def _flat(value: Any) -> list[float]:
    if isinstance(value, list | dict):
        parts = value.values() if isinstance(value, dict) else value
        return [number for part in parts for number in _flat(part)]
    return [] if value is None else [float(f"{value:.5g}")] if isinstance(value, float | int) else []


def test_a_build_has_the_numbers_that_it_had(tmp_path: Path) -> None:
    before, now = json.loads(NUMBERS.read_text()), _numbers(tmp_path / "release")
    assert now.keys() == before.keys()
    for name, numbers in before.items():
        np.testing.assert_allclose(now[name], numbers, rtol=2e-3, atol=2e-5, err_msg=name)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        numbers = _numbers(Path(made) / "release")
    NUMBERS.write_text(
        "{" + ",\n".join(f"{json.dumps(name)}:{json.dumps(row)}" for name, row in numbers.items()) + "}\n"
    )
