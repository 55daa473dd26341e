"""The small release as a command takes it."""

from __future__ import annotations

from pathlib import Path

import pytest

from metric_tree.tree import Tree


@pytest.fixture
def tree(mini: Tree) -> Path:
    """The folder of the small release."""
    return Path(mini.release.directory)
