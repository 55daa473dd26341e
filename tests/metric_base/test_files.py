"""Files that appear whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from metric_base.files import whole_file


def half_written(path: Path) -> None:
    with whole_file(path) as work:
        work.write_text("half")
        raise RuntimeError


def test_a_file_appears_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "items.jsonl"
    with whole_file(path) as work:
        work.write_text("a")
        assert not path.exists()
        assert not list(tmp_path.glob("*.jsonl")), "what is not whole is not read as one of its kind"
    assert [(one.name, one.read_text()) for one in tmp_path.iterdir()] == [("items.jsonl", "a")]


def test_a_fault_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "items.jsonl"
    path.write_text("before")
    with pytest.raises(RuntimeError):
        half_written(path)
    assert [(one.name, one.read_text()) for one in tmp_path.iterdir()] == [("items.jsonl", "before")]
