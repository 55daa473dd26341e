from __future__ import annotations

import ctypes
import fcntl
import gc
import json
import math
import os
import resource
import signal
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings

from metric_cli.programs import THREAD_VARIABLES
from metric_cli.subcommands import main
from tests.run import DURATIONS, ROOT

if TYPE_CHECKING:
    from metric_tree.tree import Tree

# One thread, as in the programs: several test processes with the threads of NumPy's BLAS would wait for each other.
# NumPy reads these when it is imported, which the imports above do not do.
for variable in THREAD_VARIABLES:
    os.environ.setdefault(variable, "1")

# A shell that starts the tests in the background makes them ignore SIGINT, and the tested commands would inherit this.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# No deadline: the time of an example depends on other load on the machine; benchmarks measure times.
# The suite draws the same examples each time, so that a failure is caused by the change under test. `make hunt` and
# `make fuzz` draw new examples; failing ones are added to the suite as explicit examples.
settings.register_profile("suite", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("hunt", deadline=None, max_examples=1000, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "suite"))


#: Maximum recorded seconds of a file that `--quick` runs: all such files together take under two minutes.
QUICK_FILE_S = 2.0


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--quick", action="store_true", help="run only the files whose recorded time is short")
    parser.addoption("--record-durations", action="store_true", help=f"write the seconds per file to {DURATIONS.name}")


def pytest_configure(config: pytest.Config) -> None:
    if sys.platform == "linux":
        config.pluginmanager.register(MemoryRelease())
    if config.getoption("--record-durations") and not hasattr(config, "workerinput"):
        config.pluginmanager.register(DurationRecorder())


class MemoryRelease:
    """Returns freed memory to the system after tests that used much of it, which the allocator would keep."""

    #: Growth in MiB since the last release at which memory is released.
    MAX_GROWTH_MIB = 64.0

    def __init__(self) -> None:
        self.resident_mib = self._resident_mib()

    def _resident_mib(self) -> float:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * resource.getpagesize() / 2**20

    def pytest_runtest_logfinish(self) -> None:
        if self._resident_mib() > self.resident_mib + self.MAX_GROWTH_MIB:
            gc.collect()
            ctypes.CDLL(None).malloc_trim(0)
            self.resident_mib = self._resident_mib()


class DurationRecorder:
    """Sum of the times of the tests of each file."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid.partition("::")[0]] += report.duration

    def pytest_sessionfinish(self) -> None:
        """Replace the seconds of these files, and remove those of files that are gone."""
        with DURATIONS.open("r+", encoding="utf-8") as stream:
            fcntl.flock(stream, fcntl.LOCK_EX)  # parts of `tests.run` end at the same time
            seconds = json.load(stream) | {name: round(seconds, 1) for name, seconds in self.seconds.items()}
            stream.seek(0)
            stream.truncate()
            kept = {name: seconds[name] for name in sorted(seconds) if (ROOT / name).exists()}
            stream.write(json.dumps(kept, indent=0) + "\n")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Start with the longest files, so that no process runs them at the end while the others wait."""
    recorded: dict[str, float] = json.loads(DURATIONS.read_text(encoding="utf-8"))
    seconds = {item: recorded.get(item.nodeid.partition("::")[0], 0.0) for item in items}
    if config.getoption("--quick"):
        config.hook.pytest_deselected(items=[item for item in items if seconds[item] > QUICK_FILE_S])
        items[:] = [item for item in items if seconds[item] <= QUICK_FILE_S]
    items.sort(key=lambda item: -seconds[item])


def pytest_collection_finish() -> None:
    """Exempt what the imports left from garbage collection: every full collection would visit 500,000 objects."""
    gc.freeze()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Write the processor time of this process and its children, and the peak memory of this process."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    processor_s = sum(usage.ru_utime + usage.ru_stime for usage in usages)
    peak_mib = usages[0].ru_maxrss / 1024  # Linux states KiB
    terminalreporter.write_line(f"{processor_s:.0f} s of processor, {peak_mib:.0f} MiB of memory")


@pytest.fixture(autouse=True)
def _no_given_width(monkeypatch: pytest.MonkeyPatch) -> None:
    """Remove the terminal width that pytest-xdist sets for its workers, so that tables in pipes are not truncated."""
    monkeypatch.delenv("COLUMNS", raising=False)


@pytest.fixture(autouse=True)
def _no_progress_lines(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Disable progress lines, which depend on the speed of the machine, except in the tests of progress."""
    if "test_progress" not in request.node.nodeid:
        monkeypatch.setattr("metric_cli.progress.LOG_INTERVAL_S", math.inf)


@pytest.fixture
def mini(tmp_path: Path) -> Tree:
    """Return a small valid tree."""
    from metric_tree.tree import open_tree
    from tests.synthetic import minitree

    return open_tree(minitree.release(tmp_path / "mini").directory)


@pytest.fixture
def shown(capsys: pytest.CaptureFixture[str]) -> Any:
    """Return a function that runs `metric-tree WORDS --json` and returns its exit status and parsed output."""

    def run(*words: str) -> tuple[int, Any]:
        status = main([*words, "--json"])
        out = capsys.readouterr().out
        return status, json.loads(out) if out else None

    return run
