"""What becomes of the rows of a source: repeats, draws, exclusion, and records in many files."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from crawler.imports.declaration import source
from crawler.imports.importer import source_folder
from crawler.imports.table_files import BadTable
from crawler.items import RawItem
from tests.crawler.imports.invented_tables import HEAD, made_up

REPEATED = """
[[tables]]
files = ["table.csv"]
unit = "mm"
id = "{no}"
title = "{name}"
category = ["laptop"]
axes = { width = "w" }
"""


def test_identical_rows_become_one_with_their_number_and_ids_stay_unique(tmp_path: Path) -> None:
    rows = "no,name,w\n1,A,300\n2,A,300\n3,A,310\n3,B,300\n"
    result = made_up(tmp_path, REPEATED, table_csv=rows)
    assert [(item.source_id, item.count) for item in result.items] == [("1", 2), ("3", 1), ("3#2", 1)]
    kept = made_up(tmp_path, "collapse = false\n" + REPEATED, table_csv=rows)
    assert [item.count for item in kept.items] == [1, 1, 1, 1]


def test_of_several_sizes_under_one_title_the_middle_one_stands_for_all(tmp_path: Path) -> None:
    rows = "no,name,w\n1,A,900\n2,A,300\n3,A,310\n"
    result = made_up(tmp_path, "one_per_title = true\n" + REPEATED, table_csv=rows)
    assert [(item.source_id, item.count) for item in result.items] == [("3", 3)]
    result = made_up(tmp_path, "one_per_title = true\n" + REPEATED, table_csv="no,name,w\n1,A,900\n2,A,300\n")
    assert [item.source_id for item in result.items] == ["2"]  # the smaller of two


def test_a_large_category_is_drawn_down_the_same_way_every_time(tmp_path: Path) -> None:
    rows = "no,name,w\n" + "".join(f"{n},N{n},{300 + n}\n" for n in range(50))
    result = made_up(tmp_path, "per_category = 10\n" + REPEATED, table_csv=rows)
    assert (len(result.items), result.n_sampled_out, result.n_rows) == (10, 40, 50)
    assert all(item.flags == ("sampled",) for item in result.items)
    backwards = "no,name,w\n" + "".join(f"{n},N{n},{300 + n}\n" for n in reversed(range(50)))
    again = made_up(tmp_path, "per_category = 10\n" + REPEATED, table_csv=backwards)
    assert {item.source_id for item in again.items} == {item.source_id for item in result.items}


def test_a_table_without_bounds_has_sizes_of_a_tenth_of_a_millimetre_to_half_a_kilometre(tmp_path: Path) -> None:
    rows = "no,name,w\n1,A,0.09\n2,B,0.1\n3,C,500000\n4,D,500001\n"
    result = made_up(tmp_path, REPEATED, table_csv=rows)
    assert [item.source_id for item in result.items] == ["2", "3"]
    assert [(one.reason, one.row) for one in result.rejected] == [
        ("out_of_bounds", "table:1"),
        ("out_of_bounds", "table:4"),
    ]


def test_an_excluded_source_has_no_items(tmp_path: Path) -> None:
    result = made_up(tmp_path, 'excluded = "parcels, not objects"')
    assert (result.items, result.rejected, result.n_rows) == ((), (), 0)


RECORDS = """
[[tables]]
files = ["table.jsonl"]
records = "table/*.json"
format = "jsonl"
unit = "cm"
id = "{no}"
category = ["box"]
axes = { width = "w" }
"""


def test_the_records_of_a_repository_stand_for_the_file_made_of_them(tmp_path: Path) -> None:
    records = [{"no": "2", "w": "4"}, {"no": "1", "w": None}, {"no": "3", "w": "5"}]
    joined, repository = tmp_path / "joined", tmp_path / "repository"
    joined.mkdir()
    (repository / "table").mkdir(parents=True)
    for name, record in zip("abc", records, strict=True):
        (repository / "table" / f"{name}.json").write_text(json.dumps(record, indent=2), encoding="utf-8")
    lines = "".join(json.dumps(record) + "\n" for record in records)
    of_file, of_folder = made_up(joined, RECORDS, table_jsonl=lines), made_up(repository, RECORDS)
    assert [item.source_id for item in of_folder.items] == ["2", "3"]
    assert of_folder.items == of_file.items
    assert [row.line() for row in of_folder.rejected] == [row.line() for row in of_file.rejected]


def test_a_repository_with_a_folder_of_the_source_name_is_read_from_its_root(tmp_path: Path) -> None:
    (tmp_path / "made_up").mkdir()
    (tmp_path / "made_up.toml").write_text(HEAD + RECORDS.replace("table/*", "made_up/*"), encoding="utf-8")
    declared = source("made_up", tmp_path)
    assert source_folder(declared, tmp_path) == tmp_path / "made_up"
    (tmp_path / "made_up" / "a.json").write_text("{}", encoding="utf-8")
    assert source_folder(declared, tmp_path) == tmp_path


@pytest.mark.parametrize(
    ("record", "line"),
    [(None, "expected table.jsonl or table/*.json; found no such"), ("{", "a.json: expected json")],
)
def test_records_that_are_missing_or_none_are_named(tmp_path: Path, record: str | None, line: str) -> None:
    if record is not None:
        (tmp_path / "table").mkdir()
        (tmp_path / "table" / "a.json").write_text(record, encoding="utf-8")
    with pytest.raises(BadTable, match=re.escape(line)):
        made_up(tmp_path, RECORDS)


def test_every_item_is_a_raw_item_that_survives_its_line(tmp_path: Path) -> None:
    result = made_up(tmp_path, REPEATED, table_csv="no,name,w\n1,Ä Ö “x”,300\n")
    assert [RawItem.from_line(item.line()) for item in result.items] == list(result.items)
