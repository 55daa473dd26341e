"""JSON lines end at a line feed and nowhere else."""

from __future__ import annotations

from pathlib import Path

import msgspec

from metric_base.records import json_lines


class _Row(msgspec.Struct):
    why: str


def test_a_line_separator_in_a_text_ends_no_line(tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    file.write_text('{"why": "a\u2028b\x85c"}\r\n\n{"why": "d"}\n', encoding="utf-8")
    assert [row.why for _, row in json_lines(file, _Row)] == ["a\u2028b\x85c", "d"]
