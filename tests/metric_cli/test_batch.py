"""`--batch LIST`: one row per scene, whatever other scenes do, also if the run is killed and continued."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from estimator.reconstructions.objects_file import SCHEMA
from metric_base.batch import BatchScene, run_batch
from metric_base.executors import MAX_ITEMS_PER_PROCESS, isolated_results
from metric_base.files import sole_writer
from metric_cli.estimate_scale.estimate import main
from metric_cli.insert_object.insert import main as insert_object
from metric_cli.subcommands import main as metric_tree
from tests.models3d.models import write_chair
from tests.support.processes import started

CODE = "import sys; from metric_cli.estimate_scale.estimate import main; sys.exit(main(sys.argv[1:]))"
#: Index of the scenes of `write_list` that are no objects files.
BROKEN = (2, 7, 9)


def write_list(folder: Path, n_scenes: int) -> Path:
    """Write objects files, some of them broken, and a list that requests the result of each as a file."""
    rows = []
    for index in range(n_scenes):
        size = {"length": 1.24, "width": 1.2, "height": 2.1 + 0.01 * index}
        objects = [{"id": "a", "category": "swivel chair", "dimensions": size}]
        text = "{" if index in BROKEN else json.dumps({"schema": SCHEMA, "objects": objects})
        (folder / f"{index}.json").write_text(text, encoding="utf-8")
        rows.append({"objects": f"{index}.json", "output": f"out-{index}.json", "level": 0.8})
    path = folder / "list.jsonl"
    path.write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
    return path


def is_running(process: str) -> bool:
    """Return whether a process exists and has not ended; an ended one may wait for its parent."""
    try:
        return Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def rows_of(table: Path) -> list[dict[str, Any]]:
    """Return the rows of a table of results without the times, which differ between runs."""
    rows: list[dict[str, Any]] = pq.read_table(table).drop_columns(["seconds"]).to_pylist()
    for row in rows:
        if row["result"] is not None and row["result"].startswith("{\n"):  # one document, not a line per object
            result = json.loads(row["result"])
            del result["seconds"]
            row["result"] = result
    return rows


def test_a_killed_batch_continues_and_equals_an_uninterrupted_one(tmp_path: Path, tree: Path) -> None:
    folders = [tmp_path / name for name in ("killed", "uninterrupted")]
    for folder in folders:
        folder.mkdir()
        write_list(folder, 12)
    for file in folders[0].glob("*.json"):  # equal times of equal files
        os.utime(folders[1] / file.name, ns=(file.stat().st_atime_ns, file.stat().st_mtime_ns))
    words = ["--jobs", "2", "--tree", str(tree)]
    arguments = ["--batch", "list.jsonl", "--out", "r.parquet", *words]
    with started([sys.executable, "-c", CODE, *arguments], cwd=folders[0], stderr=subprocess.PIPE) as child:
        records = folders[0] / "r.parquet.records" / "1-of-1.jsonl"
        while not records.exists() or records.read_text(encoding="utf-8").count('"exit_status"') < 2:
            assert child.poll() is None
            time.sleep(0.002)
        workers = Path(f"/proc/{child.pid}/task/{child.pid}/children").read_text(encoding="ascii").split()
        child.send_signal(signal.SIGKILL)
    assert not (folders[0] / "r.parquet").exists()
    assert records.read_text(encoding="utf-8").count('"exit_status"') < 12
    until = time.monotonic() + 10
    while any(is_running(worker) for worker in workers) and time.monotonic() < until:
        time.sleep(0.01)
    assert workers
    assert not any(is_running(worker) for worker in workers)
    for folder in folders:
        assert main(["--batch", str(folder / "list.jsonl"), "--out", str(folder / "r.parquet"), *words]) == 2
    rows, expected = (rows_of(folder / "r.parquet") for folder in folders)
    assert rows == expected
    assert [index for index, row in enumerate(rows) if row["error"] is not None] == list(BROKEN)
    assert [row["scene"] for row in rows] == [f"{index}.json" for index in range(12)]
    assert all((row["exit_status"], row["status"]) == (2, None) for row in rows if row["error"])
    assert "2.json: JSON: expected a valid document" in rows[2]["error"]
    first = rows[0]["result"]
    assert (rows[0]["scale"], rows[0]["low"]) == (first["scale"], first["interval"]["low"])
    assert first["interval"]["level"] == 0.8
    assert len(list(folders[0].glob("out-*.json"))) == 9


def test_a_run_repeats_scenes_without_a_row_failed_ones_and_changed_ones(
    tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    listed, out = write_list(tmp_path, 4), tmp_path / "r.parquet"
    command = ["--batch", str(listed), "--out", str(out), "--jobs", "1", "--tree", str(tree), "--json"]
    assert main(command) == 2
    assert json.loads(capsys.readouterr().out)["counts"]["failed"] == 1
    before = rows_of(out)
    records = tmp_path / "r.parquet.records" / "1-of-1.jsonl"
    lines = records.read_text(encoding="utf-8").splitlines(keepends=True)
    records.write_text("".join(lines[:-1]) + lines[-1][:20], encoding="utf-8")  # killed after the effect
    assert (tmp_path / "out-3.json").exists()
    assert main(command) == 2
    assert "2 of 4 scenes have a result of an earlier run" in capsys.readouterr().err
    assert rows_of(out) == before
    (tmp_path / "2.json").write_bytes((tmp_path / "1.json").read_bytes())
    assert main(command) == 0
    assert "3 of 4 scenes have a result" in capsys.readouterr().err
    assert rows_of(out)[2]["scale"] == before[1]["scale"]
    with sole_writer(records):
        assert main(command) == 2
    assert "another run is writing" in capsys.readouterr().err


def test_the_last_part_writes_the_table(tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    listed, out = write_list(tmp_path, 3), tmp_path / "r.parquet"
    command = ["--batch", str(listed), "--out", str(out), "--jobs", "1", "--tree", str(tree)]
    assert main([*command, "--part", "1/2"]) == 2
    assert not out.exists()
    assert "scenes of other parts have no result" in capsys.readouterr().err
    assert main([*command, "--part", "2/2"]) == 0
    assert [row["exit_status"] for row in rows_of(out)] == [0, 0, 2]


@pytest.mark.parametrize(
    ("text", "more", "message"),
    [
        ("scene,tre\na,b\n", [], "list.csv:2: tre: expected a column that is an option"),
        ("tree\nb\n", [], "list.csv:2: scene: expected a path"),
        ("scene,options\na,--draw\n", [], "found --draw"),
        ("scene,output\na,b\nc,b\n", [], "list.csv:3: outputs: expected other outputs than those of"),
        ("scene,quiet\na,maybe\n", [], "quiet: expected true or false"),
        ("scene\na,b\n", [], "expected a cell for each column"),
        ("scene\n", [], "expected at least one scene"),
        ("scene\na\n", ["--part", "3/2"], "--part: part: expected I/N"),
        ("scene\na\n", ["--jobs", "0"], "--jobs: processes: expected a number from 1 on"),
        ("scene\na\n", ["--out", "r.csv"], "--out: expected a Parquet file"),
        ("scene\na\n", ["--figure", "a.png", "b"], "found b"),
    ],
)
def test_an_invalid_list_is_an_error_before_any_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, more: list[str], message: str
) -> None:
    (tmp_path / "list.csv").write_text(text, encoding="utf-8")
    out = tmp_path / "r.parquet"
    assert main(["--batch", str(tmp_path / "list.csv"), "--out", str(out), *more]) == 2
    assert message in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["list.csv"]


def test_options_of_batches_need_a_list(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path), "--jobs", "2"]) == 2
    assert insert_object([str(tmp_path), "--model", "a.glb", "--out", "a.mp4", "--part", "1/2"]) == 2
    assert metric_tree(["check-asset", "a.glb", "--jobs", "2"]) == 2
    assert capsys.readouterr().err.count("expected --batch LIST and --out RESULTS.parquet; found none") == 3


def test_models_and_insertions_have_the_same_form(tmp_path: Path) -> None:
    write_chair(tmp_path, "stl", 1000.0)
    write_chair(tmp_path, "obj")
    rows = {"file": ["chair.stl", "chair.obj", "none.stl"], "category": ["chair", "chair", None]}
    pq.write_table(pa.table(rows), tmp_path / "models.parquet")
    out = tmp_path / "r.parquet"
    command = ["check-asset", "--batch", str(tmp_path / "models.parquet"), "--out", str(out), "--jobs", "1"]
    assert metric_tree(command) == 2
    wrong, right, missing = rows_of(out)
    assert (wrong["status"], wrong["scale"], wrong["exit_status"]) == ("wrong unit", 0.001, 3)
    assert (right["status"], right["exit_status"]) == ("right", 0)
    assert missing["exit_status"] == 2
    assert "none.stl" in missing["error"]
    (tmp_path / "none").mkdir()
    (tmp_path / "none" / "cameras.bin").symlink_to("absent")
    (tmp_path / "scenes.csv").write_text("scene,model,size,out\nnone,chair.glb,height=1,a.mp4\n", encoding="utf-8")
    command = ["--batch", str(tmp_path / "scenes.csv"), "--out", str(tmp_path / "i.parquet"), "--jobs", "1"]
    assert insert_object([*command, "--scale", "1"]) == 2
    (row,) = rows_of(tmp_path / "i.parquet")
    assert row["exit_status"] == 2
    assert "none" in row["error"]


def row_or_death(scene: BatchScene) -> dict[str, Any]:
    """Return a row with the id of this process as its status, or end the process."""
    if scene.name == "dies":
        os.kill(os.getpid(), signal.SIGKILL)
    return {"scene": scene.name, "status": str(os.getpid()), "exit_status": 0, "error": None}


def test_a_dead_process_costs_its_scene_only(tmp_path: Path) -> None:
    names = ["a", "dies", "b", "c"]
    scenes = [BatchScene(name, (), name, ()) for name in names]
    counts, is_written = run_batch(scenes, row_or_death, tmp_path / "r.parquet")
    assert is_written
    rows = rows_of(tmp_path / "r.parquet")
    assert [row["exit_status"] for row in rows] == [0, 1, 0, 0]
    assert "process of the scene ended" in rows[1]["error"]
    assert rows[0]["status"] != rows[2]["status"] == rows[3]["status"]
    assert counts[(1, "failed")] == 1


def process_id(_item: int) -> int:
    """Return the id of the current process."""
    return os.getpid()


def test_processes_are_replaced_so_that_leaks_stay_small() -> None:
    results = [result for _, result in isolated_results(process_id, range(MAX_ITEMS_PER_PROCESS + 1), 1)]
    assert len(set(results[:MAX_ITEMS_PER_PROCESS])) == 1
    assert results[-1] not in results[:-1]
