"""Public names that are imported on first use."""

from __future__ import annotations

import pytest

import metric_tree


def test_a_name_that_a_package_does_not_have() -> None:
    assert "open" in dir(metric_tree)
    assert metric_tree.Tree.__name__ == "Tree"
    with pytest.raises(AttributeError, match="module 'metric_tree' has no attribute 'unknown'"):
        metric_tree.unknown  # noqa: B018
