"""What the commands give for each input that broke release 1.0.0.

    python -m benchmarks.damaged [FOLDER]

FOLDER is the collection of damaged inputs (default `../shared/data/damaged`). Each runs in a process of its own, on a
copy, with an overlay where there are pictures (`estimate-scale`; pages go through `metric-tree extract`): exit status,
seconds of processor time, peak memory, whether control characters reached the output, and the answer in a line. The
table is in Markdown.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

__all__ = ["DamagedRun", "damaged_runs"]

FOLDER = Path(__file__).resolve().parents[1].parent / "shared" / "data" / "damaged"
#: Signs that a terminal takes for commands.
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e]")
#: Where the pages are said to be from.
PAGE_URL = "https://www.shop.example/p/1"
#: Scene in which the damaged clouds and side files are tried.
SCENE = FOLDER.parent / "scenes" / "tum_office"
DEMO = Path(__file__).resolve().parents[1] / "data" / "scenes" / "demo_room"
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
    """Every input of the collection, each run once."""
    for entry in sorted(folder.iterdir()):
        with tempfile.TemporaryDirectory() as temporary:
            words = _command(entry, Path(temporary))
            if words is not None:
                yield _run(entry.name, words)


def _command(entry: Path, work: Path) -> list[str] | None:
    """The command that tries the input; None if no command reads it."""
    if entry.suffix == ".html":
        return ["metric-tree", "extract", str(entry), "--url", PAGE_URL]
    words = _estimate_words(entry, work)
    return None if words is None else ["estimate-scale", *words]


def _estimate_words(entry: Path, work: Path) -> list[str] | None:
    """The arguments of `estimate-scale` that try the input."""
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
    if entry.name.startswith("truth_error"):
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
            [sys.executable, "-m", "benchmarks.damaged", "--one", *words], stdout=out, stderr=err
        )
        status, seconds, peak = _wait(process, started)
        texts = []
        for file in (out, err):
            file.seek(0)
            texts.append(file.read().decode("utf-8", "replace"))
    return DamagedRun(name, status, seconds, peak / 1024, texts[0], texts[1])


def _wait(process: subprocess.Popen[bytes], started: float) -> tuple[int | None, float, float]:
    """Exit status (None after SECONDS), seconds of processor time, and peak memory in KiB."""
    ended = status = 0
    while not ended and time.perf_counter() - started < SECONDS:
        ended, status, usage = os.wait4(process.pid, os.WNOHANG)
        time.sleep(0.05)
    if not ended:
        process.kill()
        _, _, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status) if ended else -9
    return process.returncode if ended else None, usage.ru_utime + usage.ru_stime, float(usage.ru_maxrss)


def main(words: list[str]) -> int:
    """Print the table, or run one input."""
    if words[:2] == ["--one", "estimate-scale"]:
        from metric_cli.estimate_scale.estimate import main as estimate_scale

        return estimate_scale(words[2:])
    if words[:2] == ["--one", "metric-tree"]:
        from metric_cli.verbs import main as metric_tree

        return metric_tree(words[2:])
    print("| input | exit | seconds | MiB | control characters | answer |\n|---|---|---|---|---|---|")
    for run in damaged_runs(Path(words[0]) if words else FOLDER):
        status = "killed" if run.status is None else run.status
        control = "yes" if _CONTROL.search(run.output + run.errors) else "none"
        cells = (f"`{run.name}`", status, f"{run.seconds:.1f}", f"{run.peak_mib:.0f}", control, _answer(run))
        print(f"| {' | '.join(map(str, cells))} |", flush=True)
    return 0


def _answer(run: DamagedRun) -> str:
    """The line that says most: the error, or the scale, or the first fact of a page."""
    lines = [line.strip() for line in run.output.splitlines() if line.strip()]
    told = next((line for line in lines if re.match(r"(scale|unresolved|extents_mm|dimensions_text)", line)), "")
    if run.name.endswith(".html") and run.status == 0 and not told:
        told = "an item without a size"
    said = told or next(iter(run.errors.strip().splitlines()), "") or next(iter(lines), "")
    return re.sub(r"/\S*/", "", said)[:160].replace("|", "\\|")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
