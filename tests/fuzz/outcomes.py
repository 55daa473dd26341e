"""Outcomes of damaged inputs: accepted ("taken"), refused with one line, or a failure."""

from __future__ import annotations

import resource
import shutil
import signal
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from types import FrameType

import numpy as np

from metric_base.errors import InputError
from tests.fuzz.mutations import mutated
from tests.fuzz.reader import Reader

__all__ = ["COUNTS", "KEPT", "Bench", "bound_memory", "fuzz", "outcome_of", "peak_mib"]

#: Maximum processor time of a reader in seconds.
MAX_SECONDS = 5
#: Maximum address space of a reader in bytes; a false size in a file must not require more.
MAX_BYTES = 4 << 30
#: Folder of inputs that cause a failure, with the traceback of each.
KEPT = Path("out") / "fuzz"
#: Names of the counts of a reader.
COUNTS = ("inputs", "taken", "refused", "errors", "hangs", "wrong")


class Hang(BaseException):
    """A reader exceeded its time."""


class Bench:
    """A folder of intact files of a reader, in which one file at a time is damaged and restored.

    kept : folder for inputs that cause a failure, or None.
    """

    def __init__(self, reader: Reader, seeds: Path, temporary: Path, kept: Path | None) -> None:
        self.reader, self.seeds, self.kept = reader, seeds, kept
        self.counts: Counter[str] = Counter()
        self.folder = temporary / "scene"
        shutil.copytree(seeds / reader.seed, self.folder)
        self.files: Sequence[Path] = [
            file for pattern in reader.files for file in sorted(self.folder.glob(pattern)) if file.is_file()
        ]
        self.intact = [file.read_bytes() for file in self.files]
        self._reported: set[str] = set()

    def run(self, index: int, data: bytes) -> str:
        """Return the outcome with `data` as content of a file."""
        file = self.files[index]
        file.write_bytes(data)
        outcome = outcome_of(self.reader, file if self.reader.alone else self.folder, self.seeds)
        file.write_bytes(self.intact[index])
        self.counts.update(["inputs", outcome.partition(":")[0]])
        if self.kept is not None and not outcome.startswith(("taken", "refused")):
            self._keep(self.kept, file.name, data, outcome)
        return outcome

    def run_intact(self) -> set[str]:
        """Return the outcomes of the intact files. The first call also loads the libraries of the reader."""
        paths = self.files if self.reader.alone else [self.folder]
        return {outcome_of(self.reader, path, self.seeds) for path in paths}

    def _keep(self, kept: Path, name: str, data: bytes, outcome: str) -> None:
        """Write the input and its outcome, once for each location in a traceback."""
        location = "\n".join(line for line in outcome.splitlines() if line.strip().startswith("File"))[-300:]
        if location in self._reported:
            return
        self._reported.add(location)
        kept.mkdir(parents=True, exist_ok=True)
        stem = f"{self.reader.name}-{time.time_ns() // 1_000_000}-{name}"
        (kept / stem).write_bytes(data)
        (kept / f"{stem}.txt").write_text(outcome, encoding="utf-8", errors="backslashreplace")


def fuzz(reader: Reader, seeds: Path, seconds: float, max_inputs: int, seed: int) -> Counter[str]:
    """Mutate the files of a reader without guidance for `seconds`, at most `max_inputs` times; return the counts."""
    rng = np.random.default_rng(seed)
    end = time.monotonic() + seconds
    with tempfile.TemporaryDirectory() as temporary:
        bench = Bench(reader, seeds, Path(temporary), None)
        while time.monotonic() < end and bench.counts["inputs"] < max_inputs:
            index = int(rng.integers(len(bench.files)))
            bench.run(index, mutated(bench.intact[index], rng))
    return bench.counts


def outcome_of(reader: Reader, folder: Path, seeds: Path) -> str:
    """Read a folder; return `taken`, `refused`, or `errors`, `hangs` or `wrong` with a message or traceback."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise Hang

    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, MAX_SECONDS)  # processor time, independent of other load
    try:
        reader.read(folder, seeds)
    except InputError as error:
        return "refused" if "\n" not in str(error) and len(str(error)) < 2000 else f"errors: {error}"
    except Hang:
        return f"hangs: {traceback.format_exc()}"
    except AssertionError as error:
        return f"wrong: {error}\n{traceback.format_exc()}"
    except Exception:  # noqa: BLE001 - the defects that the fuzzing searches for
        return f"errors: {traceback.format_exc()}"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)
    return "taken"


def bound_memory() -> None:
    """Limit the address space of this process to `MAX_BYTES`."""
    resource.setrlimit(resource.RLIMIT_AS, (MAX_BYTES, MAX_BYTES))


def peak_mib() -> int:
    """Return the peak resident memory of this process in MiB."""
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
