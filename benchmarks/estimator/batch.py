"""Kill a batch of scenes several times, continue it, and compare its rows with those of an uninterrupted run.

    python -m benchmarks.estimator.batch [--scenes 500] [--broken 10] [--kills 5]

The scenes are small COLMAP models with masks; broken ones have a damaged file of points. The output states the rows,
the times, the memory of all processes together, and the number of processes that outlived a kill.
"""

from __future__ import annotations

import argparse
import json
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from tests.synthetic.small_scene import write_small_scene

CODE = "import sys; from metric_cli.estimate_scale.estimate import main; sys.exit(main(sys.argv[1:]))"
#: Seed of the broken scenes and of the moments of the kills.
SEED = 48


def write_scenes(folder: Path, n_scenes: int, n_broken: int) -> None:
    """Write the scenes and `list.csv`."""
    write_small_scene(folder / "original")
    broken = set(np.random.default_rng(SEED).permutation(n_scenes)[:n_broken].tolist())
    lines = ["scene,output"]
    for index in range(n_scenes):
        scene = folder / "scenes" / f"{index:04d}"
        shutil.copytree(folder / "original" / "colmap", scene)
        if index in broken:
            points = scene / "points3D.bin"
            points.write_bytes(points.read_bytes()[:100])
        lines.append(f"scenes/{index:04d},{index:04d}.json")
    (folder / "list.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def processes_of(parent: int) -> list[int]:
    """Return a process and its children."""
    with suppress(OSError):
        children = Path(f"/proc/{parent}/task/{parent}/children").read_text(encoding="ascii").split()
        return [parent, *map(int, children)]
    return []


def is_running(process: int) -> bool:
    """Return whether a process exists and has not ended; an ended one waits for its parent."""
    with suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"
    return False


def resident_mb(processes: list[int]) -> float:
    """Return the resident memory of processes in MB."""
    total = 0
    for process in processes:
        with suppress(OSError):
            total += int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1]) * 4096
    return total / 1e6


def run(folder: Path, out: str, kill_after_s: float | None) -> tuple[int | None, float, float, int]:
    """Run the batch; return status, seconds, maximum memory in MB, and the number of processes that outlived it."""
    command = [sys.executable, "-c", CODE, "--batch", "list.csv", "--out", out, "--jobs", "2"]
    start, most = time.monotonic(), 0.0
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as child:
        processes: list[int] = []
        while child.poll() is None:
            processes = processes_of(child.pid) or processes
            most = max(most, resident_mb(processes))
            if kill_after_s is not None and time.monotonic() - start > kill_after_s:
                child.send_signal(signal.SIGKILL)
                child.wait()
            time.sleep(0.05)
    seconds = time.monotonic() - start
    time.sleep(1.0)
    return child.returncode, seconds, most, sum(is_running(process) for process in processes[1:])


def rows_of(table: Path) -> list[dict[str, Any]]:
    """Return the rows without times."""
    rows: list[dict[str, Any]] = pq.read_table(table).drop_columns(["seconds"]).to_pylist()
    for row in rows:
        if row["result"] is not None:
            row["result"] = json.loads(row["result"]) | {"seconds": None}
    return rows


def main() -> None:
    """Run the comparison and print it as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=500)
    parser.add_argument("--broken", type=int, default=10)
    parser.add_argument("--kills", type=int, default=5)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_scenes(folder, options.scenes, options.broken)
        status, seconds, memory_mb, _ = run(folder, "expected.parquet", None)
        expected = rows_of(folder / "expected.parquet")
        for output in folder.glob("*.json"):
            output.unlink()
        moments, survivors, killed_s = np.random.default_rng(SEED), 0, 0.0
        for _ in range(options.kills):
            wait_s = float(moments.uniform(2.0, max(seconds / (options.kills + 1), 2.0)))
            _, took_s, _, alive = run(folder, "killed.parquet", wait_s)
            killed_s, survivors = killed_s + took_s, survivors + alive
        final_status, final_s, final_mb, _ = run(folder, "killed.parquet", None)
        rows = rows_of(folder / "killed.parquet")
        counts: dict[str, int] = {}
        for row in rows:
            label = row["status"] or f"exit {row['exit_status']}"
            counts[label] = counts.get(label, 0) + 1
        record = {
            "scenes": len(rows), "counts": counts, "rows_equal": rows == expected, "statuses": [status, final_status],
            "outputs": len(list(folder.glob("*.json"))), "seconds": round(seconds, 1), "kills": options.kills,
            "seconds_killed_runs": round(killed_s, 1), "seconds_last_run": round(final_s, 1),
            "memory_mb": [round(memory_mb), round(final_mb)], "processes_that_outlived_a_kill": survivors,
        }  # fmt: skip
        sys.stdout.write(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
