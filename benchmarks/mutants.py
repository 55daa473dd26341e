"""How many small errors the tests notice.

    python -m benchmarks.mutants [ROOM ...] [--sample 40] [--seed 1] [--minutes 60]

Cosmic Ray makes each mutant (a changed operator, constant or branch) in a copy of the repository and runs the room's
tests. A mutant that no test notices survives. A room's mutants are sampled by the seed. `--cosmic-ray` names the
program; it is not a dependency, so run it from an environment of its own: `uv tool install cosmic-ray==8.7.0`.
"""

from __future__ import annotations

import argparse
import os
import random
import sqlite3
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: A room and the tests that are there to notice its errors.
ROOMS = {
    "crawler/text": "tests/crawler/text tests/crawler/imports/test_imports.py tests/crawler/page"
    " --ignore=tests/crawler/page/test_page_cost.py",
    "metric_tree/fit": "tests/metric_tree/fit tests/metric_tree/build",
    "estimator/posterior": "tests/estimator/posterior tests/estimator/records/test_result.py",
    "estimator/geometry": "tests/estimator/geometry",
    "estimator/evidence": "tests/estimator/evidence",
    "taxonomy": "tests/taxonomy",
    "insertion": "tests/insertion",
}
#: Seconds for the tests of one mutant; a mutant that makes them hang counts as killed.
TIMEOUT = 600
#: `int | None` of an annotation is no code that runs; a mutant of it survives by its nature.
ANNOTATIONS = "BinaryOperator_BitOr"
CONFIG = """\
[cosmic-ray]
module-path = "{room}"
timeout = {timeout}
excluded-modules = []
test-command = "{python} -m pytest -x -q -p no:cacheprovider {tests}"

[cosmic-ray.distributor]
name = "local"
"""


def main() -> None:
    """Print a table of rooms: mutants made, tried, killed, and each survivor."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rooms", nargs="*", choices=[*ROOMS, []], default=list(ROOMS))
    parser.add_argument("--sample", type=int, default=40, help="mutants of each room (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--minutes", type=float, default=60, help="for each room; what is not tried then is not counted"
    )
    parser.add_argument("--cosmic-ray", default="cosmic-ray", help="the program (default: the one on PATH)")
    arguments = parser.parse_args()
    print("| room | mutants | tried | killed | share |\n|---|---|---|---|---|")
    for room in arguments.rooms:
        with tempfile.TemporaryDirectory() as folder:
            made, outcomes = _outcomes(room, Path(folder), arguments)
        killed = sum(outcome != "SURVIVED" for outcome, _ in outcomes)
        share = f"{killed / len(outcomes):.2f}" if outcomes else "–"
        print(f"| {room} | {made} | {len(outcomes)} | {killed} | {share} |", flush=True)
        for outcome, where in outcomes:
            if outcome == "SURVIVED":
                print(f"  survived: {where}", flush=True)


def _outcomes(room: str, folder: Path, arguments: argparse.Namespace) -> tuple[int, list[tuple[str, str]]]:
    """The number of mutants, and of those tried the outcome and the place."""
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, capture_output=True, check=True).stdout
    subprocess.run(["tar", "-x", "-C", str(folder)], input=archive, check=True)
    config, session = folder / "mutants.toml", folder / "mutants.sqlite"
    config.write_text(
        CONFIG.format(room=room, timeout=TIMEOUT, python=sys.executable, tests=ROOMS[room]), encoding="utf-8"
    )
    environment = os.environ | {"PYTHONPATH": str(folder)}
    program = arguments.cosmic_ray
    subprocess.run([program, "init", config.name, session.name], cwd=folder, env=environment, check=True)
    _check_whole(room, folder, environment)
    made = _keep_sample(session, arguments.sample, arguments.seed)
    work = subprocess.Popen([program, "exec", config.name, session.name], cwd=folder, env=environment)
    end = time.monotonic() + 60 * arguments.minutes
    while work.poll() is None and time.monotonic() < end:
        time.sleep(1)
    if work.poll() is None:
        work.terminate()
        work.wait()
    return made, _results(session)


def _check_whole(room: str, folder: Path, environment: dict[str, str]) -> None:
    """Stop if the tests are red without a mutant: every mutant would count as killed."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *ROOMS[room].split()]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{room}: the tests fail without a mutant:\n{done.stdout[-2000:]}")


def _keep_sample(session: Path, sample: int, seed: int) -> int:
    """Drop all mutants but a sample of the session; return how many there were."""
    with sqlite3.connect(session) as database:
        database.execute("DELETE FROM mutation_specs WHERE operator_name LIKE ?", [f"%{ANNOTATIONS}%"])
        place = "module_path || start_pos_row || operator_name || occurrence"
        ids = [row[0] for row in database.execute(f"SELECT job_id FROM mutation_specs ORDER BY {place}")]  # noqa: S608
        keep = random.Random(seed).sample(ids, min(sample, len(ids)))  # noqa: S311
        database.execute("CREATE TEMP TABLE kept (job_id TEXT)")
        database.executemany("INSERT INTO kept VALUES (?)", [(job,) for job in keep])
        database.execute("DELETE FROM mutation_specs WHERE job_id NOT IN (SELECT job_id FROM kept)")
        database.execute("DELETE FROM work_items WHERE job_id NOT IN (SELECT job_id FROM kept)")
    return len(ids)


def _results(session: Path) -> list[tuple[str, str]]:
    query = (
        "SELECT r.test_outcome, m.module_path || ':' || m.start_pos_row || ' ' || m.operator_name, r.diff"
        " FROM work_results r JOIN mutation_specs m ON r.job_id = m.job_id WHERE r.test_outcome IS NOT NULL"
    )
    with sqlite3.connect(session) as database:
        rows = database.execute(query).fetchall()
    return [(str(outcome).rpartition(".")[2], f"{place}: {_new_line(diff)}") for outcome, place, diff in rows]


def _new_line(diff: str | None) -> str:
    """The line that a mutant puts in place of another."""
    added = [line[1:].strip() for line in (diff or "").splitlines() if line.startswith("+") and line[:3] != "+++"]
    return added[0] if added else ""


if __name__ == "__main__":
    main()
