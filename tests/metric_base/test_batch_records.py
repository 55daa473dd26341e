"""Files of records: what a killed run has left is continued, and files of others are not changed."""

from __future__ import annotations

from pathlib import Path

import pytest

from metric_base.batch import completed_records
from metric_base.errors import InputError

SCHEMA = "metric-tree/test/1"
LINE = f'{{"schema": "{SCHEMA}", "file": "a.glb"}}\n'


def _read(path: Path, *, is_own: bool = True) -> list[str]:
    records = completed_records(path, SCHEMA, ["file"], "--out", "a test", is_own=is_own)
    return [record["file"] for _, record in records]


@pytest.mark.parametrize("content", ["notes of a user", "[", LINE.replace("test", "other").rstrip()])
def test_a_file_without_a_complete_line_is_of_another_program_unless_it_has_the_schema(
    tmp_path: Path, content: str
) -> None:
    (path := tmp_path / "a.jsonl").write_text(content)
    with pytest.raises(InputError, match="expected results of a test, or no file yet"):
        _read(path)
    assert path.read_text() == content


@pytest.mark.parametrize("whole", ["", LINE, 2 * LINE])
@pytest.mark.parametrize(("is_own", "is_cut"), [(True, True), (False, False)])
def test_an_incomplete_last_line_is_removed_by_its_writer(
    tmp_path: Path, whole: str, is_own: bool, is_cut: bool
) -> None:
    (path := tmp_path / "a.jsonl").write_text(whole + LINE[:-5])
    assert _read(path, is_own=is_own) == ["a.glb"] * whole.count("\n")
    assert path.read_text() == (whole if is_cut else whole + LINE[:-5])


def test_an_empty_file_has_no_record(tmp_path: Path) -> None:
    (path := tmp_path / "a.jsonl").write_text(" ")
    assert _read(path) == []
