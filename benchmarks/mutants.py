"""How many small errors the nearest tests notice.

    python -m benchmarks.mutants [FOLDER ...] --work DIR [--sample 120] [--seed 1] [--minutes 60]

Cosmic Ray lists the mutants of the folders (a changed operator, constant or branch) and applies them, one at a time,
in a copy of the last commit. Each is tried against the tests nearest to its module: those with the module's name,
then those that import it, until their processor seconds without a mutant reach `--seconds`. Results are a line of
JSON each in DIR; a run on the same DIR continues it. `--cosmic-ray` names the program; it is not a dependency, so it
is run from an environment of its own: `uv tool install cosmic-ray==8.7.0`.
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
from pathlib import Path
from typing import Any, TypeAlias

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("insertion", "taxonomy", "metric_tree/fit", "estimator/evidence")
#: `int | None` of an annotation is no code that runs; a mutant of it survives by its nature.
ANNOTATIONS = "%BinaryOperator_BitOr%"
#: A mutant whose tests take so many times their processor seconds, on the wall, counts as killed.
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
    parser.add_argument(
        "--seconds", type=float, default=10, help="of the processor, for the tests of a mutant (default: %(default)s)"
    )
    parser.add_argument("--cosmic-ray", default="cosmic-ray", help="the program (default: the one on PATH)")
    arguments = parser.parse_args()
    end = time.monotonic() + 60 * arguments.minutes
    copy, results = arguments.work / "copy", arguments.work / "results.jsonl"
    if not copy.is_dir():
        _copy_repository(copy)
    mutants = _mutants(copy, arguments)
    tried = {tuple(row["mutant"]) for row in _rows(results)}
    seconds = Seconds(arguments.work / "seconds.json", copy)
    for mutant in mutants:
        if time.monotonic() < end and mutant not in tried:
            row = _outcome(mutant, copy, seconds.within(nearest_tests(mutant[0], copy), arguments.seconds), arguments)
            with results.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
    _print(arguments.folders, [row for row in _rows(results) if tuple(row["mutant"]) in mutants])


def _copy_repository(copy: Path) -> None:
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


def nearest_tests(module: str, copy: Path) -> list[str]:
    """The test files of a module, nearest first: of its name, that import it, that import a module which does."""
    package, stem = module.split("/", maxsplit=1)[0], Path(module).stem
    name = module.removesuffix(".py").replace("/", ".")
    importers = {name} | {
        str(path.relative_to(copy).with_suffix("")).replace("/", ".")
        for path in (copy / package).rglob("*.py")
        if name in path.read_text(encoding="utf-8")
    }
    ranked = []
    for path in sorted((copy / "tests" / package).rglob("test_*.py")):
        text = path.read_text(encoding="utf-8")
        ranks = [path.stem == f"test_{stem}", name in text, any(importer in text for importer in importers)]
        if any(ranks):
            ranked.append((ranks.index(True), str(path.relative_to(copy))))
    return [path for _, path in sorted(ranked)]


class Seconds:
    """Processor seconds of each test file without a mutant, measured once; a file that fails is left out."""

    def __init__(self, path: Path, copy: Path) -> None:
        self._path, self._copy = path, copy
        self._known: dict[str, float | None] = json.loads(path.read_text()) if path.exists() else {}

    def within(self, tests: list[str], limit: float) -> list[tuple[str, float]]:
        """The first tests that take at most `limit` seconds together, and at least one."""
        chosen: list[tuple[str, float]] = []
        for test in tests:
            seconds = self._measured(test)
            if seconds is not None and (not chosen or sum(s for _, s in chosen) + seconds <= limit):
                chosen.append((test, seconds))
        return chosen

    def _measured(self, test: str) -> float | None:
        if test not in self._known:
            before = _children_seconds()
            done = _run_tests([test], self._copy, None)
            self._known[test] = round(_children_seconds() - before, 1) if done == 0 else None
            self._path.write_text(json.dumps(self._known, indent=1), encoding="utf-8")
        return self._known[test]


def _children_seconds() -> float:
    used = os.times()
    return used.children_user + used.children_system


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
        status = _run_tests(["-x", *names], copy, limit) if names else 0
    finally:
        source.write_text(whole, encoding="utf-8")
    return {
        "mutant": mutant,
        "killed": status != 0,
        "late": status is None,
        "line": (changed or [""])[0].strip(),
        "tests": names,
    }


def _run_tests(words: list[str], copy: Path, limit: float | None) -> int | None:
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
