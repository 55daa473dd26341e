"""Fuzzing of every reader, each in a process of its own with bounded memory.

    python -m tests.fuzz [MINUTES] [READER ...]         (make fuzz MINUTES=10)

Prints, for each reader: inputs, those taken, those refused with one line, faults of the program, hangs (over 5 s),
wrong answers (taken, with numbers that no scene has), and peak memory. Inputs that did harm are kept in `out/fuzz`.
"""

from __future__ import annotations

import json
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path
from types import FrameType

import numpy as np

from metric_base.faults import InputFault
from metric_base.terminal import print_table
from tests.fuzz.mutations import mutated
from tests.fuzz.readers import READERS, Reader, write_seeds

HANG_SECONDS = 5
#: Bytes of address space of a reader; its answer to a lie about a size must not need more.
MEMORY = 4 << 30
KEPT = Path("out") / "fuzz"
COLUMNS = ("reader", "inputs", "taken", "refused", "faults", "hangs", "wrong", "peak MiB")


class Hang(BaseException):
    """A reader took too long."""


def fuzz(reader: Reader, seeds: Path, seconds: float, most: int, seed: int, kept: Path | None) -> Counter[str]:
    """Mutate the files of a reader for so long, or so many times; what came of it, counted."""
    rng = np.random.default_rng(seed)
    counts: Counter[str] = Counter()
    files = [file for pattern in reader.files for file in sorted((seeds / reader.seed).glob(pattern))]
    end = time.monotonic() + seconds
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "scene"
        shutil.copytree(seeds / reader.seed, folder)
        while time.monotonic() < end and counts["inputs"] < most:
            source = files[int(rng.integers(len(files)))]
            target = folder / source.relative_to(seeds / reader.seed)
            whole = source.read_bytes()
            data = mutated(whole, rng)
            target.write_bytes(data)
            outcome = one_outcome(reader, folder, seeds)
            target.write_bytes(whole)
            counts.update(["inputs", outcome.partition(":")[0]])
            if kept is not None and not outcome.startswith(("taken", "refused")):
                kept.mkdir(parents=True, exist_ok=True)
                name = f"{reader.name}-{counts['inputs']}-{source.name}"
                (kept / name).write_bytes(data)
                (kept / f"{name}.txt").write_text(outcome)
    return counts


def one_outcome(reader: Reader, folder: Path, seeds: Path) -> str:
    """`taken`, `refused`, or `faults`, `hangs`, `wrong` with what was said."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, HANG_SECONDS)
    try:
        reader.read(folder, seeds)
    except InputFault as fault:
        return "refused" if "\n" not in str(fault) and len(str(fault)) < 2000 else f"faults: {fault}"
    except Hang:
        return f"hangs: {traceback.format_exc()}"
    except AssertionError as fault:
        return f"wrong: {fault}\n{traceback.format_exc()}"
    except Exception:  # noqa: BLE001 - what is looked for
        return f"faults: {traceback.format_exc()}"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    return "taken"


def _worker(name: str, seeds: Path, seconds: float) -> None:
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    reader = next(reader for reader in READERS if reader.name == name)
    counts = fuzz(reader, seeds, seconds, 10**9, int(time.time()), KEPT)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    sys.stdout.write(json.dumps({**counts, "peak MiB": round(peak)}))


def main(words: list[str]) -> int:
    """Fuzz and print the table; 1 if anything did harm."""
    if words[:1] == ["--worker"]:
        _worker(words[1], Path(words[2]), float(words[3]))
        return 0
    minutes = float(words[0]) if words else 1.0
    chosen = [reader for reader in READERS if not words[1:] or reader.name in words[1:]]
    rows, harm = [], 0
    with tempfile.TemporaryDirectory() as temporary:
        seeds = Path(temporary)
        write_seeds(seeds)
        for reader in chosen:
            seconds = 60 * minutes / len(chosen)
            command = [sys.executable, "-m", "tests.fuzz", "--worker", reader.name, str(seeds), str(seconds)]
            done = subprocess.run(command, capture_output=True, text=True, timeout=seconds + 120, check=False)
            counts = json.loads(done.stdout) if done.returncode == 0 else {"faults": 1}
            if done.returncode:
                sys.stderr.write(done.stderr[-2000:])
            rows.append((reader.name, *(counts.get(name, 0) for name in COLUMNS[1:])))
            harm += sum(counts.get(name, 0) for name in ("faults", "hangs", "wrong"))
    print_table(COLUMNS, rows)
    return int(harm > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
