"""Run the tests in parts, each in a new process, several at a time: `python -m tests.run`.

A process imports only the libraries of its part and ends with it, so that its memory does not grow over the whole
suite. Each process of pytest-xdist imports all test modules (13 s) and keeps what every test leaves (up to 2.9 GB).
"""

from __future__ import annotations

import argparse
import json
import math
import re
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TESTS = ROOT / "tests"
#: Seconds of each test file in a complete run on an idle machine, written by `--record-durations`.
DURATIONS = TESTS / "durations.json"
#: Maximum recorded seconds of a part of several files: short enough to keep all processes busy until the end, and long
#: enough that the 2 to 5 s of its imports matter little. Parts of 100 s reached 1,154 MiB.
MAX_PART_S = 80.0
#: Minimum recorded seconds of a part that ends with its package.
MIN_PART_S = 35.0
#: Seconds after which a part fails; pytest itself ends a single test after `faulthandler_timeout`.
PART_TIMEOUT_S = 2400.0
#: Exit status of pytest if no test is selected, as in a part without fast tests.
NO_TESTS = 5


def test_files(folder: Path) -> list[str]:
    """Return the test files of a folder or the file itself, sorted, relative to the repository."""
    files = [folder] if folder.is_file() else folder.rglob("test_*.py")
    return sorted(file.resolve().relative_to(ROOT).as_posix() for file in files)


def parts(files: Sequence[str], seconds: dict[str, float]) -> list[list[str]]:
    """Divide files into runs of up to `MAX_PART_S`, the longest first.

    Neighbours import the same libraries. A run also ends with its package, unless it is too short to be worth the start
    of a process (`MIN_PART_S`).
    """
    found: list[list[str]] = []
    length, package = math.inf, ""
    for file in files:
        other = "/".join(file.split("/")[:2])
        length += seconds.get(file, 0.0)
        if length > MAX_PART_S or (other != package and length - seconds.get(file, 0.0) >= MIN_PART_S):
            found.append([])
            length = seconds.get(file, 0.0)
        found[-1].append(file)
        package = other
    return sorted(found, key=lambda part: -sum(seconds.get(file, 0.0) for file in part))


def run(command: Sequence[str]) -> tuple[int, str]:
    """Run a command in the repository; return its exit status (1 if it takes too long) and all its output."""
    try:
        done = subprocess.run(
            command,
            cwd=ROOT,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            timeout=PART_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        output = error.stdout or b""
        text = output if isinstance(output, str) else output.decode(errors="replace")
        return 1, f"{text}\nnot finished after {PART_TIMEOUT_S:.0f} s"
    return done.returncode, done.stdout


def counts(output: str) -> Iterator[tuple[str, int]]:
    """Yield the numbers of the last line of pytest with their words: passed, failed, skipped, ..."""
    for line in reversed(output.splitlines()):
        if re.search(r" in [\d.]+s", line):
            yield from ((word, int(number)) for number, word in re.findall(r"(\d+) ([a-z]+)", line.split(" in ")[0]))
            return


def main(words: Sequence[str] | None = None) -> int:
    """Run the parts and print the result of each and the sums; return 1 if one of them failed, else 0."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("paths", nargs="*", type=Path, default=[TESTS], help="test files or folders (default: tests)")
    parser.add_argument("-n", type=int, default=3, metavar="N", help="processes at a time (default: 3)")
    parser.add_argument("--types", action="store_true", help="check the types with mypy at the same time")
    arguments, options = parser.parse_known_args(words)  # other options are those of pytest, such as --quick
    files = sorted({file for path in arguments.paths for file in test_files(path)})
    commands = {"types": [sys.executable, "-m", "mypy"]} if arguments.types else {}
    for part in parts(files, json.loads(DURATIONS.read_text(encoding="utf-8"))):
        others = f" and {len(part) - 1} more" if len(part) > 1 else ""
        commands[f"{part[0]}{others}"] = [sys.executable, "-m", "pytest", "-q", *options, *part]
    return run_all(commands, arguments.n)


def run_all(commands: dict[str, list[str]], n_processes: int) -> int:
    """Run named commands, `n_processes` at a time, and print the output of those that failed."""
    failed, total, skipped, start = [], Counter[str](), list[str](), time.monotonic()
    pool = ThreadPoolExecutor(n_processes)
    running = {pool.submit(run, command): name for name, command in commands.items()}
    try:
        for n_done, future in enumerate(as_completed(running, timeout=PART_TIMEOUT_S * len(running)), start=1):
            (status, output), name = future.result(timeout=1), running[future]
            total.update(dict(counts(output)))
            skipped += [line for line in output.splitlines() if line.startswith("SKIPPED")]
            if status not in (0, NO_TESTS):
                failed.append(name)
                print(output)
            usage = re.findall(r"^.* of processor, .*$", output, re.MULTILINE)
            ending = (output.strip() or f"exit status {status}").splitlines()[-1]
            print(f"[{n_done}/{len(running)}] {name}: {'; '.join([ending, *usage[-1:]])}", flush=True)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)  # after an interrupt, no further part is started
    print("\n".join(sorted(skipped)))
    for name in failed:
        print(f"FAILED {name}")
    sums = ", ".join(f"{number} {word}" for word, number in sorted(total.items()))
    print(f"===== {sums} in {time.monotonic() - start:.2f}s =====")  # the form of pytest's last line
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
