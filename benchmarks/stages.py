"""Kills and full disks in every stage of a video, several in a row, and then a run to the end.

    python -m benchmarks.stages [kills] [disks] [--trials 10] [--stages NAME ...] [--whole DIR] [--seed 1]

An undisturbed `estimate-scale VIDEO --work` says which stages there are, how long each takes and what it writes. For
each stage a work folder with the stages before it is continued. A kill is SIGKILL to the process group, at a moment
drawn from the time of the stage. A full disk is a file system in memory with room for a drawn part of what the stage
writes; it must end with exit 2 and one line that names the disk, and leave no half of a stage. Counted is what differs
from the undisturbed run at the end. Needs Linux with user namespaces (`unshare`), and no root.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.child import ours, run_child
from benchmarks.common import ROOT, options_parser
from metric_cli.terminal import print_table

VIDEO = ROOT / "data" / "scenes" / "demo_video"
KINDS = ("kills", "disks")
INSIDE = "STAGES_INSIDE"
#: A run that takes longer hangs; seconds between two looks at the work folder; the room of a whole run.
LIMIT_S, POLL_S, ROOMY = 900, 0.01, 1 << 30
COLUMNS = ("stage", "what", "trials", "met the stage", "not one line and exit 2", "halves left", "differs at the end")


@dataclass(frozen=True, slots=True)
class Stage:
    """A stage of the undisturbed run: its outputs, wall seconds, and the bytes that it wrote."""

    name: str
    outputs: tuple[str, ...]
    seconds: float
    size: int


class Trials:
    """The trials of one stage in `place`, a file system in memory; `whole` : the undisturbed run."""

    def __init__(self, stages: list[Stage], number: int, whole: Path, place: Path, draw: random.Random) -> None:
        self.before, self.stage = stages[:number], stages[number]
        self.whole, self.place, self.draw = whole, place, draw
        self.met = self.wrong = self.halves = 0

    def reset(self) -> None:
        """The work folder as it is before the stage."""
        resize(self.place, ROOMY)
        for entry in self.place.iterdir():
            shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
        for part in ["stamps", *(output for stage in self.before for output in stage.outputs)]:
            source, target = self.whole / "work" / part, self.place / "work" / part
            target.parent.mkdir(parents=True, exist_ok=True)
            if part == "stamps":
                target.mkdir(parents=True, exist_ok=True)
                for stage in self.before:
                    shutil.copy2(source / f"{stage.name}.json", target)
            elif source.is_dir():
                shutil.copytree(source, target, dirs_exist_ok=True)
            else:
                shutil.copy2(source, target)

    def kill(self) -> None:
        """A run that is killed at a moment of the stage."""
        work = self.place / "work"
        if (work / "stamps" / f"{self.stage.name}.json").exists():
            self.reset()
        process = subprocess.Popen(
            command(self.place), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        part, started = work / f".metric-tree.{self.stage.name}.part", time.monotonic()
        while process.poll() is None and not part.exists() and time.monotonic() - started < LIMIT_S:
            time.sleep(POLL_S)
        self.met += part.exists()
        time.sleep(self.draw.random() * self.stage.seconds)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    def fill(self) -> None:
        """A run on a disk with room for a part of what the stage writes."""
        if (self.place / "work" / "stamps" / f"{self.stage.name}.json").exists():
            self.reset()
        state = os.statvfs(self.place)
        used = (state.f_blocks - state.f_bfree) * state.f_frsize
        resize(self.place, used + int(self.draw.uniform(0.05, 0.95) * self.stage.size))
        run = run_child(command(self.place), LIMIT_S)
        lines = [line for line in run.errors.splitlines() if line.startswith("estimate-scale: ")]
        named = len(lines) == 1 and "No space left" in lines[0]
        if run.status != 2 or not named:
            self.wrong += 1
            sys.stderr.write(f"{self.stage.name}: exit {run.status}: {run.errors[-600:]}\n")
        self.met += run.status != 0
        self.halves += len([*(self.place / "work").rglob(".*.part")])

    def end(self) -> int:
        """What differs after a run to the end."""
        resize(self.place, ROOMY)
        run = run_child(command(self.place), LIMIT_S)
        if run.status != 0:
            sys.stderr.write(f"{self.stage.name}: at the end: exit {run.status}: {run.errors[-600:]}\n")
            return -1
        right, outcome = _outcome(self.whole), _outcome(self.place)
        return ((right - outcome) + (outcome - right)).total()


def command(place: Path) -> list[str]:
    """The words of a run in a folder."""
    words = [VIDEO / "video.mp4", "--instances", VIDEO / "instances.json", "--frames", 12, "--dense", "none"]
    return ours("estimate-scale", *words, "--work", place / "work", "--output", place / "scale.json")


def _outcome(place: Path) -> Counter[str]:
    """The scale to a thousandth, and the names of what the work folder holds."""
    result = json.loads((place / "scale.json").read_text())
    names = Counter(str(path.relative_to(place)) for path in (place / "work").rglob("*") if path.is_file())
    return names + Counter([f"scale {result['scale']:.3g}"])


def resize(place: Path, size: int) -> None:
    """Give a file system in memory so many bytes."""
    subprocess.run(["mount", "-o", f"remount,size={max(size, 1 << 16)}", str(place)], check=True)


def undisturbed(whole: Path) -> list[Stage]:
    """The stages of a whole run, in their order."""
    if not whole.exists():
        whole.mkdir(parents=True)
        run = run_child(command(whole), LIMIT_S)
        if run.status != 0:
            raise SystemExit(run.errors)
    stamps = sorted((whole / "work" / "stamps").glob("*.json"), key=lambda file: file.stat().st_mtime_ns)
    rows: list[tuple[str, dict[str, Any]]] = [(file.stem, json.loads(file.read_text())) for file in stamps]
    return [
        Stage(name, tuple(row["outputs"]), row["seconds"], _size(whole / "work", row["outputs"])) for name, row in rows
    ]


def _size(work: Path, outputs: list[str]) -> int:
    entries = [path for output in outputs for path in (work / output, *(work / output).rglob("*"))]
    return sum(path.stat().st_size for path in entries if path.is_file())


def main() -> int:
    """Print the table."""
    parser = options_parser(__doc__)
    parser.add_argument("kinds", nargs="*", choices=["kills", "disks", []], metavar="KIND")
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--stages", nargs="*", default=[], metavar="NAME")
    parser.add_argument("--whole", type=Path, metavar="DIR", help="keep the undisturbed run there, and use it again")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if INSIDE not in os.environ:
        words = ["unshare", "--map-root-user", "--mount", sys.executable, "-m", "benchmarks.stages", *sys.argv[1:]]
        return subprocess.run(words, env=os.environ | {INSIDE: "1"}, check=False).returncode
    rows = []
    with tempfile.TemporaryDirectory(prefix="stages-") as folder:
        whole, place = options.whole or Path(folder) / "whole", Path(folder) / "disk"
        place.mkdir()
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={ROOMY}", "tmpfs", str(place)], check=True)
        stages = undisturbed(whole)
        for number, stage in enumerate(stages):
            for kind in (options.kinds or KINDS) if not options.stages or stage.name in options.stages else ():
                trials = Trials(stages, number, whole, place, random.Random(f"{stage.name} {options.seed}"))  # noqa: S311
                trials.reset()
                for _ in range(options.trials):
                    trials.kill() if kind == "kills" else trials.fill()
                differs = trials.end()
                wrong = trials.wrong if kind == "disks" else ""
                rows.append((stage.name, kind, options.trials, trials.met, wrong, trials.halves, differs))
                sys.stderr.write(f"{rows[-1]}\n")
        subprocess.run(["umount", str(place)], check=True)
    print_table(COLUMNS, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
