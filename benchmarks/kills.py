"""What is left after long commands are killed at random moments and run again.

    python -m benchmarks.kills COMMAND ... [--kills 10] [--in-a-row 2] [--seed 1]

COMMAND is crawl, build, cutout, export, estimate-scale (on a video) or import (its downloads). Each works on small
inputs of its own. An undisturbed run says what is right and how long it takes. Then a run is killed with SIGKILL, its
whole process group at once, at a moment drawn evenly from that time, `--in-a-row` times on one output
(the second time from its half, since it has less to do, and so on), and run once
more to its end. Lost, doubled and changed count parts of the result against the undisturbed run; left over are
temporary files and folders beside the result or in the system's temporary folder.
"""

from __future__ import annotations

import argparse
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from benchmarks.child import run_child
from benchmarks.kill_cases import CASES, Case, Prepared
from metric_cli.terminal import print_table

COLUMNS = ("command", "seconds", "kills", "before the end", "outputs", "lost", "doubled", "changed", "left over")
#: A run that takes longer hangs.
SECONDS = 600


@dataclass(frozen=True, slots=True)
class Trial:
    """What became of one output: kills that met a run at work, and what is not as it should be."""

    kills: int
    lost: int
    doubled: int
    changed: int
    left_over: list[str]


def measure_case(case: Case, folder: Path, kills: int, in_a_row: int, draw: random.Random) -> tuple[object, ...]:
    """A row of the table."""
    prepared = case.prepare(folder / "inputs")
    try:
        right, seconds = _undisturbed(case, prepared, folder / "whole")
        trials: list[Trial] = []
        while sum(trial.kills for trial in trials) < kills and len(trials) < 2 * kills:
            place = folder / f"trial-{len(trials)}"
            trials.append(
                _trial(case, prepared, place, right, [draw.uniform(0, seconds / (row + 1)) for row in range(in_a_row)])
            )
    finally:
        prepared.close()
    for trial in trials:
        for name in trial.left_over:
            sys.stderr.write(f"{case.name}: left over: {name}\n")
    given = in_a_row * len(trials)
    sums = [sum(getattr(trial, name) for trial in trials) for name in ("kills", "lost", "doubled", "changed")]
    return (case.name, round(seconds, 1), given, sums[0], len(trials), *sums[1:], sum(len(t.left_over) for t in trials))


def _undisturbed(case: Case, prepared: Prepared, place: Path) -> tuple[Counter[str], float]:
    place.mkdir()
    started = time.monotonic()
    status, message = _run(case.command(prepared, place, False), place, None)
    if status != 0:
        sys.exit(f"{case.name}: the undisturbed run fails: {message}")
    return case.outcome(place), time.monotonic() - started


def _trial(case: Case, prepared: Prepared, place: Path, right: Counter[str], moments: list[float]) -> Trial:
    place.mkdir()
    kills, again = 0, False
    for moment in moments:
        status, _ = _run(case.command(prepared, place, again), place, moment)
        kills += status == -signal.SIGKILL
        again = True
    status, message = _run(case.command(prepared, place, again), place, None)
    outcome = case.outcome(place)
    if status != 0 and not (status == 2 and case.stands in message and outcome == right):
        sys.stderr.write(f"{case.name}: killed at {moments}: exit {status}: {message[-500:]}\n")
    lost, more = right - outcome, outcome - right
    doubled = sum((Counter({part: n for part, n in more.items() if part in right})).values())
    changed = min(lost.total(), more.total() - doubled)
    return Trial(kills, lost.total() - changed, doubled, changed, _left_over(case, place))


def _run(words: list[str], place: Path, moment: float | None) -> tuple[int, str]:
    """Exit status and standard error of a run that is killed after `moment` seconds."""
    temporary = place / "tmp"
    temporary.mkdir(exist_ok=True)
    run = run_child(words, SECONDS if moment is None else moment, {"TMPDIR": str(temporary)})
    return run.status, run.errors if moment or not run.timed_out else f"still running after {SECONDS} s"


def _left_over(case: Case, place: Path) -> list[str]:
    kept = {"tmp", *case.results}
    beside = [entry.name for entry in place.iterdir() if entry.name not in kept]
    within = [str(path.relative_to(place)) for path in place.rglob("*") if path.name.endswith((".part", ".half"))]
    temporary = [f"tmp/{entry.name}" for entry in (place / "tmp").iterdir()]
    return sorted({*beside, *within, *temporary})


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commands", nargs="*", choices=[*CASES, []], metavar="COMMAND")
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--in-a-row", type=int, default=2, help="kills of one output (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    rows = []
    for name in arguments.commands or CASES:
        with tempfile.TemporaryDirectory(prefix="kills-") as folder:
            draw = random.Random(f"{name} {arguments.seed}")  # noqa: S311
            rows.append(measure_case(CASES[name], Path(folder), arguments.kills, arguments.in_a_row, draw))
    print_table(COLUMNS, rows)


if __name__ == "__main__":
    main()
