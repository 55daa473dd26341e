from __future__ import annotations

import json
import math
import os
import signal
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from metric_cli.subcommands import main
from metric_tree.tree import Tree, open_tree
from tests.synthetic import minitree

# A shell that starts the tests in the background makes them ignore Ctrl-C; the commands under test would inherit it.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# How long an example takes depends on what else the machine does; times are the benchmarks' business.
# The suite draws the same examples each time, so that a red run is the change's own doing. `make hunt` and
# `make fuzz` draw new ones; what they find becomes an example of the suite.
settings.register_profile("suite", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("hunt", deadline=None, max_examples=1000, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "suite"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests come first, or one process would end the suite with them while the others wait."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(autouse=True)
def _no_given_width(monkeypatch: pytest.MonkeyPatch) -> None:
    """pytest-xdist gives its workers a width of their own; a table in a pipe is as wide as it needs to be."""
    monkeypatch.delenv("COLUMNS", raising=False)


@pytest.fixture(autouse=True)
def _no_progress_lines(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy machine takes over ten seconds where an idle one takes two; what a command says must not depend on it."""
    if "test_progress" not in request.node.nodeid:
        monkeypatch.setattr("metric_cli.progress.LINE_S", math.inf)


@pytest.fixture
def mini(tmp_path: Path) -> Tree:
    """A small valid tree."""
    return open_tree(minitree.release(tmp_path / "mini").directory)


@pytest.fixture
def shown(capsys: pytest.CaptureFixture[str]) -> Any:
    """Run `metric-tree WORDS --json`: the status and the parsed output."""

    def run(*words: str) -> tuple[int, Any]:
        status = main([*words, "--json"])
        out = capsys.readouterr().out
        return status, json.loads(out) if out else None

    return run
