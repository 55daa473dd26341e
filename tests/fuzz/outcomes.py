"""What came of damaged input: taken, refused with one line, or harm."""

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

__all__ = ["COUNTS", "KEPT", "Bench", "bound_memory", "fuzz", "one_outcome", "peak_mib"]

HANG_SECONDS = 5
#: Bytes of address space of a reader; its answer to a lie about a size must not need more.
MEMORY = 4 << 30
#: Inputs that did harm, each beside what happened.
KEPT = Path("out") / "fuzz"
#: What is counted of each reader.
COUNTS = ("inputs", "taken", "refused", "errors", "hangs", "wrong")


class Hang(BaseException):
    """A reader took too long."""


class Bench:
    """A reader's whole folder, in which one file at a time is damaged and restored.

    kept : where inputs that do harm are written; None keeps none.
    """

    def __init__(self, reader: Reader, seeds: Path, temporary: Path, kept: Path | None) -> None:
        self.reader, self.seeds, self.kept = reader, seeds, kept
        self.counts: Counter[str] = Counter()
        self.folder = temporary / "scene"
        shutil.copytree(seeds / reader.seed, self.folder)
        self.files: Sequence[Path] = [
            file for pattern in reader.files for file in sorted(self.folder.glob(pattern)) if file.is_file()
        ]
        self.whole = [file.read_bytes() for file in self.files]
        self._complaints: set[str] = set()

    def run(self, number: int, data: bytes) -> str:
        """What came of `data` in place of a file."""
        file = self.files[number]
        file.write_bytes(data)
        outcome = one_outcome(self.reader, file if self.reader.alone else self.folder, self.seeds)
        file.write_bytes(self.whole[number])
        self.counts.update(["inputs", outcome.partition(":")[0]])
        if self.kept is not None and not outcome.startswith(("taken", "refused")):
            self._keep(self.kept, file.name, data, outcome)
        return outcome

    def run_whole(self) -> set[str]:
        """What comes of the whole files; the first time loads what the reader needs."""
        places = self.files if self.reader.alone else [self.folder]
        return {one_outcome(self.reader, place, self.seeds) for place in places}

    def _keep(self, kept: Path, name: str, data: bytes, outcome: str) -> None:
        """Write the input and what happened, once for each last line of a traceback."""
        place = "\n".join(line for line in outcome.splitlines() if line.strip().startswith("File"))[-300:]
        if place in self._complaints:
            return
        self._complaints.add(place)
        kept.mkdir(parents=True, exist_ok=True)
        stem = f"{self.reader.name}-{time.time_ns() // 1_000_000}-{name}"
        (kept / stem).write_bytes(data)
        (kept / f"{stem}.txt").write_text(outcome, encoding="utf-8", errors="backslashreplace")


def fuzz(reader: Reader, seeds: Path, seconds: float, most: int, seed: int) -> Counter[str]:
    """Mutate the files of a reader for so long, or so many times, without guidance; what came of it, counted."""
    rng = np.random.default_rng(seed)
    end = time.monotonic() + seconds
    with tempfile.TemporaryDirectory() as temporary:
        bench = Bench(reader, seeds, Path(temporary), None)
        while time.monotonic() < end and bench.counts["inputs"] < most:
            number = int(rng.integers(len(bench.files)))
            bench.run(number, mutated(bench.whole[number], rng))
    return bench.counts


def one_outcome(reader: Reader, folder: Path, seeds: Path) -> str:
    """`taken`, `refused`, or `errors`, `hangs`, `wrong` with what was said."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise Hang

    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, HANG_SECONDS)  # of the processor: others may keep it busy
    try:
        reader.read(folder, seeds)
    except InputError as error:
        return "refused" if "\n" not in str(error) and len(str(error)) < 2000 else f"errors: {error}"
    except Hang:
        return f"hangs: {traceback.format_exc()}"
    except AssertionError as error:
        return f"wrong: {error}\n{traceback.format_exc()}"
    except Exception:  # noqa: BLE001 - what is looked for
        return f"errors: {traceback.format_exc()}"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)
    return "taken"


def bound_memory() -> None:
    """From now on the process may not have more than `MEMORY`."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def peak_mib() -> int:
    """The largest memory of this process, MiB."""
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
