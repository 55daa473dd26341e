"""Files of records: what a killed run has left is continued, and files of others are not changed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from metric_base import batch
from metric_base.batch import completed_records, read_list
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


@pytest.mark.parametrize("line", ["3", '{"schema": "other"}', LINE.strip().replace("file", "name"), "[" * 9999])
def test_a_complete_line_of_another_form_is_an_error(tmp_path: Path, line: str) -> None:
    (path := tmp_path / "a.jsonl").write_text(f"{LINE}{line}\n")
    with pytest.raises(InputError, match=r"a\.jsonl:2: --out: expected a result of a test; found another line"):
        _read(path)
    path.write_text(f"{LINE}\n \n{LINE}")
    assert _read(path) == ["a.glb", "a.glb"]
    assert _read(tmp_path / "missing") == []


def test_a_list_of_scenes_is_a_table_or_names(tmp_path: Path) -> None:
    (names := tmp_path / "list.txt").write_text("a\n\n b \n")
    assert list(read_list(names, "scene")) == [(f"{names}:1", {"scene": "a"}), (f"{names}:3", {"scene": "b"})]
    (table := tmp_path / "list.PARQUET").write_bytes(b"PAR1")
    with pytest.raises(InputError, match="file: expected a Parquet table, found "):
        list(read_list(table, "scene"))


@pytest.mark.parametrize(("statuses", "expected"), [((1, 0), 0), ((0, 1), 0), ((1, 2), 2), ((0, 3), 3), ((3, 0), 0)])
def test_the_last_row_with_a_result_counts(tmp_path: Path, statuses: tuple[int, ...], expected: int) -> None:
    lines = [json.dumps({"schema": batch.SCHEMA, "key": "k", "exit_status": status}) for status in statuses]
    (tmp_path / "1-of-1.jsonl").write_text("\n".join([*lines, ""]))
    assert batch._completions(tmp_path, tmp_path / "1-of-1.jsonl")[0]["k"].exit_status == expected
