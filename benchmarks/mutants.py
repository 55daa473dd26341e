"""How many small errors the tests notice.

    python -m benchmarks.mutants [FOLDER ...] --work DIR [--sample 120] [--seed 1] [--minutes 60]

Cosmic Ray lists the mutants of the folders (a changed operator, constant or branch) and applies them, one at a time,
in a copy of the last commit. Each is tried against the tests that run its line, the quickest first, until their
seconds without a mutant reach `--seconds`. Results are a line of JSON each in DIR; a run on the same DIR continues it.
`--cosmic-ray` names the program; it is not a dependency, so it is run from an environment of its own:
`uv tool install cosmic-ray==8.7.0`.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import sqlite3
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias
from xml.etree import ElementTree as ET

from coverage import CoverageData

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("insertion", "taxonomy", "metric_tree/fit", "estimator/evidence")
#: `int | None` of an annotation is no code that runs; a mutant of it survives by its nature.
ANNOTATIONS = "%BinaryOperator_BitOr%"
#: A mutant whose tests take so many times their seconds is treated as killed.
HANG_FACTOR = 12
CONFIG = '[cosmic-ray]\nmodule-path = {folders}\ntimeout = 60\nexcluded-modules = []\ntest-command = "true"\n'
PYTEST = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]

Mutant: TypeAlias = tuple[str, str, int, int]


def main() -> None:
    """Try the sample, and print the table of folders and each survivor."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", default=FOLDERS)
    parser.add_argument("--work", type=Path, required=True, help="the copy of the repository, and results.jsonl")
    parser.add_argument("--sample", type=int, default=120, help="mutants of all folders (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=60, help="what is not tried then is left for the next run")
    parser.add_argument("--seconds", type=float, default=10, help="for the tests of a mutant (default: %(default)s)")
    parser.add_argument("--cosmic-ray", default="cosmic-ray", help="the program (default: the one on PATH)")
    arguments = parser.parse_args()
    end = time.monotonic() + 60 * arguments.minutes
    copy, results = arguments.work / "copy", arguments.work / "results.jsonl"
    if not copy.is_dir():
        copy_repository(copy)
    mutants = _mutants(copy, arguments)
    tried = {tuple(row["mutant"]) for row in _rows(results)}
    covering = Covering(copy, arguments.folders)
    for mutant in mutants:
        if time.monotonic() < end and mutant not in tried:
            row = _outcome(mutant, copy, covering.within(mutant[0], mutant[3], arguments.seconds), arguments)
            with results.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
    _print(arguments.folders, [row for row in _rows(results) if tuple(row["mutant"]) in mutants])


def copy_repository(copy: Path) -> None:
    copy.mkdir(parents=True)
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, capture_output=True, check=True).stdout
    subprocess.run(["tar", "-x", "-C", str(copy)], input=archive, check=True)


def _mutants(copy: Path, arguments: argparse.Namespace) -> list[Mutant]:
    """The sample: file, operator, its occurrence, and the line."""
    session = copy / "mutants.sqlite"
    if not session.exists():
        (copy / "mutants.toml").write_text(CONFIG.format(folders=json.dumps(list(arguments.folders))), encoding="utf-8")
        subprocess.run([arguments.cosmic_ray, "init", "mutants.toml", session.name], cwd=copy, check=True)
    columns = "module_path, operator_name, occurrence, start_pos_row"
    query = f"SELECT {columns} FROM mutation_specs WHERE operator_name NOT LIKE ? ORDER BY {columns}"  # noqa: S608
    with sqlite3.connect(session) as database:
        rows: list[Mutant] = database.execute(query, [ANNOTATIONS]).fetchall()
    return random.Random(arguments.seed).sample(rows, min(arguments.sample, len(rows)))  # noqa: S311


class Covering:
    """The tests that run a line, quickest first.

    They are known from one run of all tests without a mutant, which takes as long as they do; programs that a test
    starts do not count.
    """

    def __init__(self, copy: Path, folders: Sequence[str]) -> None:
        data, times = copy / "covering.sqlite", copy / "covering.xml"
        if not times.exists():
            rooms = [f"--cov={folder}" for folder in folders]
            words = [*rooms, "--cov-context=test", "--cov-report=", "--cov-config=covering.toml", "-n", "2"]
            (copy / "covering.toml").write_text(f'[tool.coverage.run]\ndata_file = "{data.name}"\n')
            run_tests([*words, "--dist", "loadfile", f"--junitxml={times.name}"], copy, None)
        self._copy, self._data = copy, CoverageData(str(data))
        self._data.read()
        self._seconds = {
            f"{case.get('classname')}.{case.get('name')}": float(case.get("time", 0))
            for case in ET.parse(times).iter("testcase")  # noqa: S314 - written above
            if not len(case)  # neither failed nor skipped
        }

    def of_line(self, module: str, row: int) -> list[tuple[str, float]]:
        """The tests of a line with their seconds, quickest first.

        No test runs a line that runs at the import, such as that of a constant: those of the module's lines do.
        """
        by_line = self._data.contexts_by_lineno(str(self._copy.resolve() / module))
        # Of a statement over several lines the first is known.
        line = max((known for known in by_line if known <= row), default=0)
        own = {*by_line.get(line, ())} - {""} or {context for every in by_line.values() for context in every} - {""}
        names = {context.partition("|")[0] for context in own}
        timed = sorted((seconds, name) for name in names if (seconds := self._seconds.get(_case(name))) is not None)
        return [(name, seconds) for seconds, name in timed]

    def within(self, module: str, row: int, limit: float) -> list[tuple[str, float]]:
        """The quickest tests of a line that take at most `limit` seconds together, and at least one."""
        chosen: list[tuple[str, float]] = []
        for name, seconds in self.of_line(module, row):
            if chosen and sum(s for _, s in chosen) + seconds > limit:
                break
            chosen.append((name, seconds))
        return chosen


def _case(name: str) -> str:
    """A test's name in JUnit's XML, from that of pytest."""
    path, _, test = name.partition("::")
    return f"{path.removesuffix('.py').replace('/', '.')}.{test.replace('::', '.')}"


def _outcome(
    mutant: Mutant, copy: Path, tests: list[tuple[str, float]], arguments: argparse.Namespace
) -> dict[str, Any]:
    """What became of a mutant, with its line."""
    source = copy / mutant[0]
    whole = source.read_text(encoding="utf-8")
    try:
        command = [arguments.cosmic_ray, "apply", mutant[0], mutant[1], str(mutant[2])]
        subprocess.run(command, cwd=copy, check=True, capture_output=True)
        changed = [line for line in source.read_text(encoding="utf-8").splitlines() if line not in whole.splitlines()]
        names = [name for name, _ in tests]
        limit = HANG_FACTOR * sum(seconds for _, seconds in tests) + 20
        status = run_tests(["-x", *names], copy, limit) if names else 0
    finally:
        source.write_text(whole, encoding="utf-8")
    return {
        "mutant": mutant,
        "killed": status != 0,
        "late": status is None,
        "line": (changed or [""])[0].strip(),
        "tests": names,
    }


def run_tests(words: list[str], copy: Path, limit: float | None) -> int | None:
    """The exit status; None after `limit` seconds."""
    environment = os.environ | {"PYTHONPATH": str(copy)}
    try:
        return subprocess.run(
            [*PYTEST, *words], cwd=copy, env=environment, capture_output=True, timeout=limit, check=False
        ).returncode
    except subprocess.TimeoutExpired:
        return None


def _rows(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").split("\n") if line] if path.exists() else []


def _print(folders: list[str], rows: list[dict[str, Any]]) -> None:
    print("| folder | tried | killed | of them by time | share |\n|---|---|---|---|---|")
    for folder in folders:
        own = [row for row in rows if str(row["mutant"][0]).startswith(f"{folder}/")]
        counts = Counter(row["killed"] for row in own)
        share = f"{counts[True] / counts.total():.2f}" if counts else "–"
        late = sum(row.get("late", False) for row in own)
        print(f"| `{folder}` | {counts.total()} | {counts[True]} | {late} | {share} |")
    for row in rows:
        if not row["killed"]:
            print(f"- survived: `{row['mutant'][0]}:{row['mutant'][3]}` {row['mutant'][1]}: `{row['line']}`")


if __name__ == "__main__":
    main()
