from __future__ import annotations

import ctypes
import functools
import gc
import json
import math
import os
import signal
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from hypothesis import HealthCheck, settings

from metric_cli.subcommands import main
from metric_tree.tree import Tree, open_tree
from tests.synthetic import minitree

# A shell that starts the tests in the background makes them ignore SIGINT, and the tested commands would inherit this.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# No deadline: the time of an example depends on other load on the machine; benchmarks measure times.
# The suite draws the same examples each time, so that a failure is caused by the change under test. `make hunt` and
# `make fuzz` draw new examples; failing ones are added to the suite as explicit examples.
settings.register_profile("suite", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("hunt", deadline=None, max_examples=1000, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "suite"))


ROOT = Path(__file__).resolve().parents[1]
#: Seconds of each test file in a complete run, written by `--record-durations`.
DURATIONS = Path(__file__).with_name("durations.json")
#: Maximum recorded seconds of a file that `--quick` runs: all such files together take under two minutes.
QUICK_FILE_S = 2.0
#: Files that load WordNet and its matcher, which takes 7 s of processor time and 300 MB.
WORDNET_FILES = {
    "tests/end_to_end/test_pictures.py",
    "tests/metric_cli/test_build_command.py",
    "tests/metric_cli/test_explain.py",
    "tests/metric_tree/fit/test_same_numbers.py",
    "tests/metric_tree/pipeline/test_build_hierarchy.py",
    "tests/project/test_doctests.py",
    "tests/taxonomy/matching/test_decisions.py",
    "tests/taxonomy/naming/test_resolver.py",
    "tests/taxonomy/naming/test_shared_names.py",
    "tests/taxonomy/test_insertions.py",
    "tests/taxonomy/test_wordnet.py",
}
#: Resident memory of a process in MiB from which its caches are emptied after a test. Single tests need up to
#: 450 MiB more, and a process stays below 1 GiB.
MAX_CACHED_MIB = 500.0
#: Increase since the caches were last emptied from which it is worth the time.
MIN_FREED_MIB = 60.0
#: Resident memory in MiB after the caches were last emptied.
_REMAINDER: dict[str, float] = {}


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--quick", action="store_true", help="run only the files whose recorded time is short")
    parser.addoption("--record-durations", action="store_true", help=f"write the seconds per file to {DURATIONS.name}")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--record-durations") and not hasattr(config, "workerinput"):
        config.pluginmanager.register(DurationRecorder())


class DurationRecorder:
    """Sum of the times of the tests of each file."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid.partition("::")[0]] += report.duration

    def pytest_sessionfinish(self) -> None:
        rounded = {name: round(seconds, 1) for name, seconds in sorted(self.seconds.items())}
        DURATIONS.write_text(json.dumps(rounded, indent=0) + "\n", encoding="utf-8")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Start with the longest files, so that no process runs them at the end while the others wait."""
    recorded: dict[str, float] = json.loads(DURATIONS.read_text(encoding="utf-8"))
    seconds = {item: recorded.get(item.nodeid.partition("::")[0], 0.0) for item in items}
    if config.getoption("--quick"):
        config.hook.pytest_deselected(items=[item for item in items if seconds[item] > QUICK_FILE_S])
        items[:] = [item for item in items if seconds[item] <= QUICK_FILE_S]
    items.sort(key=lambda item: -seconds[item])


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Return the scheduler of `--dist loadfile`, with one process for all files that load WordNet."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file: str = super()._split_scope(nodeid)
            return "wordnet" if file in WORDNET_FILES else file

    return Scheduling(config, log) if config.getoption("dist") == "loadfile" else None


@pytest.fixture(autouse=True)
def _bounded_caches(request: pytest.FixtureRequest) -> Iterator[None]:
    """Empty the caches of the packages after a test if this process is large and does not run `WORDNET_FILES`.

    WordNet with its matcher (300 MB), releases and likelihoods would otherwise remain in each process of the suite.
    """
    yield
    if request.node.nodeid.partition("::")[0] in WORDNET_FILES:
        return  # the next file of their process needs it again
    if _resident_mib() < max(MAX_CACHED_MIB, _REMAINDER.get("mib", 0.0) + MIN_FREED_MIB):
        return
    for cached in [item for item in gc.get_objects() if isinstance(item, functools._lru_cache_wrapper)]:
        if (ROOT / (cached.__module__ or "").partition(".")[0] / "__init__.py").is_file():
            cached.cache_clear()
    gc.collect()
    pa.default_memory_pool().release_unused()
    if hasattr(libc := ctypes.CDLL(None), "malloc_trim"):  # glibc keeps freed memory
        libc.malloc_trim(0)
    _REMAINDER["mib"] = _resident_mib()


def _resident_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


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
    return open_tree(minitree.release(tmp_path / "mini").directory)


@pytest.fixture
def shown(capsys: pytest.CaptureFixture[str]) -> Any:
    """Return a function that runs `metric-tree WORDS --json` and returns its exit status and parsed output."""

    def run(*words: str) -> tuple[int, Any]:
        status = main([*words, "--json"])
        out = capsys.readouterr().out
        return status, json.loads(out) if out else None

    return run
