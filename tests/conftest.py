from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from metric_tree.commands import main
from metric_tree.tree import Tree, open_tree
from tests.made import minitree

# How long an example takes depends on what else the machine does; times are the benchmarks' business.
settings.register_profile("suite", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("suite")


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
