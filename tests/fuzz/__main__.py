"""Fuzzing of every reader, each in a process of its own with bounded memory.

    python -m tests.fuzz [MINUTES] [READER ...]         (make fuzz MINUTES=10)
    python -m tests.fuzz --table                        the totals of all runs

Counts, for each reader: inputs, those taken, those refused with one line, internal errors, hangs (over 5 s),
wrong answers (taken, with numbers that no scene has), and peak memory. Inputs that did harm are kept in `out/fuzz`,
inputs that reach new code in `out/fuzz/reached`; each run adds a line to `tests/fuzz/runs.jsonl`.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from metric_cli.tables import print_table
from tests.fuzz.outcomes import COUNTS, KEPT
from tests.fuzz.readers import READERS, write_seeds

#: What came of every run.
RUNS = Path(__file__).with_name("runs.jsonl")
COLUMNS = ("reader", "minutes", *COUNTS, "peak MiB")
#: Seconds that a reader may take beyond its time before it is killed: a hang in a library that no signal interrupts.
PATIENCE = 60


def main(words: list[str]) -> int:
    """Fuzz and print the table; 1 if anything did harm."""
    if words[:1] == ["--table"]:
        print_table(COLUMNS, totals([json.loads(line) for line in RUNS.read_text(encoding="utf-8").splitlines()]))
        return 0
    minutes = float(words[0]) if words else 1.0
    chosen = [reader.name for reader in READERS if not words[1:] or reader.name in words[1:]]
    runs = []
    with tempfile.TemporaryDirectory() as temporary:
        write_seeds(Path(temporary) / "seeds")
        for name in chosen:
            runs.append(one_run(name, Path(temporary), 60 * minutes / len(chosen)))
            with RUNS.open("a", encoding="utf-8") as file:
                file.write(json.dumps(runs[-1]) + "\n")
    print_table(COLUMNS, totals(runs))
    return int(any(run.get(name) for run in runs for name in ("errors", "hangs", "wrong")))


def one_run(name: str, temporary: Path, seconds: float) -> dict[str, Any]:
    """What came of fuzzing a reader for so long, in a process of its own."""
    answer = temporary / "answer.json"
    answer.unlink(missing_ok=True)
    places = [str(temporary / "seeds"), str((KEPT / "reached" / name).absolute()), str(seconds), str(answer)]
    command = [sys.executable, "-m", "tests.fuzz.guided", name, *places]
    log = temporary / "log"
    with log.open("wb") as output, subprocess.Popen(command, stdout=output, stderr=output) as process:
        try:
            status = process.wait(seconds + PATIENCE)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            status = -signal.SIGKILL
    counts: dict[str, Any] = json.loads(answer.read_text()) if answer.is_file() else {}
    if status:
        counts["hangs" if status == -signal.SIGKILL else "errors"] = 1 + counts.get("errors", 0)
        KEPT.mkdir(parents=True, exist_ok=True)
        (KEPT / f"{name}-end.txt").write_bytes(log.read_bytes()[-20_000:])
    return {"reader": name, "minutes": round(seconds / 60, 2), **counts}


def totals(runs: list[dict[str, Any]]) -> list[tuple[object, ...]]:
    """A row of the table for each reader, and one for all."""
    by_reader: dict[str, Counter[str]] = {reader.name: Counter() for reader in READERS}
    for run in runs:
        for reader in (run["reader"], "all"):
            counts = by_reader.setdefault(reader, Counter())
            counts.update({name: run.get(name, 0) for name in ("minutes", *COUNTS)})
            counts["peak MiB"] = max(counts["peak MiB"], run.get("peak MiB", 0))
    rows = ((name, counts) for name, counts in by_reader.items() if counts["minutes"])
    return [(name, round(counts["minutes"], 1), *(counts[column] for column in COLUMNS[2:])) for name, counts in rows]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
