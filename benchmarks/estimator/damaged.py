"""What `estimate-scale` gives for each input that broke release 1.0.0.

    python -m benchmarks.estimator.damaged [FOLDER]

FOLDER is the collection of damaged inputs (default `../shared/data/damaged`). Each runs in a process of its own, on a
copy, with an overlay where there are pictures: exit status, seconds, peak memory, and the first line of the answer.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from metric_base.terminal import print_table

__all__ = ["DamagedRun", "damaged_runs"]

FOLDER = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "damaged"
#: Scene in which the damaged clouds and side files are tried.
SCENE = FOLDER.parent / "scenes" / "tum_office"
DEMO = Path(__file__).resolve().parents[2] / "data" / "scenes" / "demo_room"
SECONDS = 120


@dataclass(frozen=True, slots=True)
class DamagedRun:
    """One input and what became of it; `status` is None where it ran out of time."""

    name: str
    status: int | None
    seconds: float
    peak_mib: float
    output: str
    errors: str


def damaged_runs(folder: Path = FOLDER) -> Iterator[DamagedRun]:
    """Every input of the collection that concerns `estimate-scale`, each run once."""
    for entry in sorted(folder.iterdir()):
        with tempfile.TemporaryDirectory() as temporary:
            words = _command(entry, Path(temporary))
            if words is not None:
                yield _run(entry.name, words)


def _command(entry: Path, work: Path) -> list[str] | None:
    """The arguments that try the input, or None where it is not for `estimate-scale`."""
    if entry.is_dir():
        scene = _copy(entry, work / "scene")
        return [str(scene), "--overlay", str(work / "overlay")] if (scene / "images").is_dir() else [str(scene)]
    if entry.suffix == ".ply":
        return [str(SCENE), "--dense", str(entry)]
    if entry.name.endswith("categories.json"):
        scene = _copy(DEMO, work / "scene")
        (scene / "instances.json").unlink(missing_ok=True)
        (scene / "instances").mkdir()
        shutil.copyfile(entry, scene / "instances" / "categories.json")
        return [str(scene)]
    if entry.name.startswith("truth_fault"):
        scene = _copy(DEMO, work / "scene")
        shutil.copyfile(entry, scene / "truth.json")
        return [str(scene), "--figure", str(work / "figure.png")]
    return ["--objects", str(entry)] if entry.suffix == ".json" else None


def _copy(source: Path, target: Path) -> Path:
    shutil.copytree(source, target, copy_function=shutil.copyfile)
    for path in [target, *target.rglob("*")]:
        path.chmod(0o755 if path.is_dir() else 0o644)
    return target


def _run(name: str, words: list[str]) -> DamagedRun:
    started = time.perf_counter()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.estimator.damaged", "--one", *words], stdout=out, stderr=err
        )
        status, usage = _wait(process, started)
        seconds = time.perf_counter() - started
        texts = []
        for file in (out, err):
            file.seek(0)
            texts.append(file.read().decode("utf-8", "replace"))
    return DamagedRun(name, status, seconds, usage / 1024, texts[0], texts[1])


def _wait(process: subprocess.Popen[bytes], started: float) -> tuple[int | None, float]:
    """Exit status (None after SECONDS) and peak memory in KiB."""
    while time.perf_counter() - started < SECONDS:
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            return process.returncode, float(usage.ru_maxrss)
        time.sleep(0.05)
    process.kill()
    _, _, usage = os.wait4(process.pid, 0)
    process.returncode = -9
    return None, float(usage.ru_maxrss)


def main(words: list[str]) -> int:
    """Print the table, or run one input."""
    if words[:1] == ["--one"]:
        from estimator.command import main as estimate_scale

        return estimate_scale(words[1:])
    rows = []
    for run in damaged_runs(Path(words[0]) if words else FOLDER):
        said = (run.output or run.errors).strip().splitlines() or [""]
        status = "killed" if run.status is None else run.status
        rows.append((run.name, status, f"{run.seconds:.1f}", f"{run.peak_mib:.0f}", said[0][:90]))
    print_table(("input", "exit", "seconds", "MiB", "answer"), rows)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
