"""Fuzz all readers, each in a separate process with bounded memory.

    python -m tests.fuzz [MINUTES] [READER ...]         (make fuzz MINUTES=10)
    python -m tests.fuzz --table                        print the totals of all runs

Counts for each reader: inputs, accepted inputs, inputs refused with one line, internal errors, hangs (over 5 s), wrong
results (accepted, with invalid numbers), and peak memory. Inputs that cause a failure are stored in `out/fuzz`, inputs
that reach new code in `out/fuzz/reached`. Each run adds a line to `tests/fuzz/runs.jsonl`.
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

#: Counts of all runs.
RUNS = Path(__file__).with_name("runs.jsonl")
COLUMNS = ("reader", "minutes", *COUNTS, "peak MiB")
#: Seconds after the end of its time at which a reader is killed, because no signal interrupts a hang in a library.
GRACE_S = 60


def main(arguments: list[str]) -> int:
    """Fuzz the readers and print the table; return 1 if any reader failed."""
    if arguments[:1] == ["--table"]:
        print_table(COLUMNS, totals([json.loads(line) for line in RUNS.read_text(encoding="utf-8").splitlines()]))
        return 0
    minutes = float(arguments[0]) if arguments else 1.0
    chosen = [reader.name for reader in READERS if not arguments[1:] or reader.name in arguments[1:]]
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
    """Fuzz a reader for `seconds` in a separate process and return its counts."""
    counts_file = temporary / "counts.json"
    counts_file.unlink(missing_ok=True)
    arguments = [str(temporary / "seeds"), str((KEPT / "reached" / name).absolute()), str(seconds), str(counts_file)]
    command = [sys.executable, "-m", "tests.fuzz.guided", name, *arguments]
    log = temporary / "log"
    with log.open("wb") as output, subprocess.Popen(command, stdout=output, stderr=output) as process:
        try:
            status = process.wait(seconds + GRACE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            status = -signal.SIGKILL
    counts: dict[str, Any] = json.loads(counts_file.read_text()) if counts_file.is_file() else {}
    if status:
        counts["hangs" if status == -signal.SIGKILL else "errors"] = 1 + counts.get("errors", 0)
        KEPT.mkdir(parents=True, exist_ok=True)
        (KEPT / f"{name}-end.txt").write_bytes(log.read_bytes()[-20_000:])
    return {"reader": name, "minutes": round(seconds / 60, 2), **counts}


def totals(runs: list[dict[str, Any]]) -> list[tuple[object, ...]]:
    """Return a row of the table for each reader, and a row for all readers."""
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
