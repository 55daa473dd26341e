"""Sets that are no plain table: a museum's sentences, tables of standard parts."""

from __future__ import annotations

import json
import os
from contextlib import nullcontext
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from crawler.imports import Import, import_source, row_items
from crawler.imports.declaration import source
from crawler.imports.downloads import NoInput
from crawler.imports.importer import changed_files, source_folder
from crawler.imports.table_files import BadTable, flat
from tests.crawler.imports.invented_tables import made_up, reasons, sizes

#: Lists of lists of the same list: a few lines that stand for a billion values.
_ALIASES = "".join(f"{two}: &{two} [{', '.join([f'*{one}'] * 10)}]\n" for one, two in pairwise("abcdefghi"))


def walters(folder: Path, *objects: dict[str, Any]) -> Import:
    blank = {"ObjectName": "vases", "Title": "Vase", "Classification": "Ceramics", "DateText": "ca. 1710"}
    lines = [json.dumps(blank | {"ObjectID": n} | given) for n, given in enumerate(objects)]
    (folder / "walters_dims.jsonl").write_text("\n".join(lines), encoding="utf-8")
    declared = source("walters")
    return import_source(declared, folder)


def test_museum_sentences(tmp_path: Path) -> None:
    result = walters(
        tmp_path,
        {"Dimensions": "H: 12 1/2 x Max. Diam: 6 in. (31.8 x 15.2 cm); Diam at rim: 3 in. (7.6 cm)"},
        {"Dimensions": "2 x 10 in. (5.1 x 25.4 cm) (h. x max. diam.)"},
        {"Dimensions": "Bezel H: 1/2 in. (1.3 cm); Ring H: 1 in. (2.5 cm)", "ObjectName": "finger rings; jewelry"},
        {"Dimensions": "15/16 x 2 1/2 in. (2.4 x 6.4 cm)"},
        {"Dimensions": "H with handles: 8 in. (20.3 cm)", "ObjectName": "boxes (containers)"},
        {"Dimensions": "H: 8 x Diam at base: 12 in. (20.3 x 30.5 cm)"},
        {"Dimensions": "H without mount: 2 x W: 1 in. (5.1 x 2.5 cm); Mount H: 9 in. (22.9 cm)"},
    )
    assert sizes(result) == [
        {"height": 317.5, "diameter": 152.4},
        {"height": 50.8, "diameter": 254.0},
        {"height": 25.4},
        {},
        {"height": 203.2},
        {"height": 203.2},
        {"height": 50.8, "width": 25.4},
    ]
    assert result.items[3].extents_mm == (63.5, 23.812)
    assert result.items[2].category_path == ("Ceramics", "finger rings")
    assert result.items[4].category_path == ("Ceramics", "boxes")
    assert result.items[0].year == 1710


def test_museum_sheets_parts_and_silences_are_refused(tmp_path: Path) -> None:
    result = walters(
        tmp_path,
        {"Dimensions": "H: 9 x W: 6 in.", "ObjectName": "illuminated manuscripts; folios (leaves)"},
        {"Dimensions": "H: 9 x W: 6 in.", "Classification": "Prints"},
        {"Dimensions": "H: 9 in.", "ObjectName": "figures; fragments"},
        {"Dimensions": "Diam of medallion: 2 in."},
        {"Dimensions": None},
        {"Dimensions": "unknown"},
        {"Dimensions": "H: 9 in.", "ObjectName": None},
    )
    assert [reason for reason, _ in reasons(result)] == [
        "flat_picture",
        "flat_picture",
        "part_not_whole",
        "part_not_whole",
        "no_size",
        "unreadable",
        "no_category",
    ]


def test_tables_of_a_standard_part(tmp_path: Path) -> None:
    (tmp_path / "made.blt").write_text(
        """
classes:
  - id: hexagonnut9
    names: {name: Made-up nut}
    parameters:
      types: {s: Length (in), m_max: Length (in)}
      tables:
        - {index: key, columns: [s, m_max], data: {"1/2 in": [0.75, 0.4375]}}
        - {index: type, columns: [finish], data: {black: ["BK"]}}
  - id: ibeam_made_up
    parameters:
      types: {h: Length (mm)}
      tables: {index: key, columns: [h], data: {"I100": [100]}}
""",
        encoding="utf-8",
    )
    declared = source("bolts")
    result = import_source(declared, tmp_path)
    assert sizes(result) == [{"width": 19.05, "height": 11.112}]
    assert result.items[0].title == "Made-up nut 1/2 in"
    assert reasons(result) == [("part_not_whole", "class")]


@pytest.mark.parametrize("damage", ["classes: 3", "[1, 2", ""])
def test_a_damaged_table_of_standard_parts_is_one_clear_line(tmp_path: Path, damage: str) -> None:
    (tmp_path / "made.blt").write_text(damage, encoding="utf-8")
    with pytest.raises(BadTable, match=r"made\.blt: .*expected .*; found "):
        list(row_items(source("bolts"), tmp_path))


TABLE = """[[tables]]
files = ["table.{format}"]
format = "{format}"
unit = "cm"
category = ["object"]
axes = {{ height = "h" }}
"""


@pytest.mark.parametrize(
    ("form", "text", "words"),
    [
        ("yaml", "a: &a [1,1,1,1,1,1,1,1,1,1]\n" + _ALIASES, "more than 100,000 values"),
        ("json", "[" * 5000 + "]" * 5000, "expected json"),
        ("json", "9" * 5000, "expected json"),
    ],
    ids=["a billion aliases", "deep", "digits"],
)
def test_a_table_that_grows_when_it_is_read_is_one_line(tmp_path: Path, form: str, text: str, words: str) -> None:
    with pytest.raises(BadTable, match=words):
        made_up(tmp_path, TABLE.format(format=form), **{f"table_{form}": text})


def test_a_table_is_a_regular_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "table.csv")
    with pytest.raises(BadTable, match="expected a file; found none"):
        made_up(tmp_path, TABLE.format(format="csv"))


@pytest.mark.parametrize("name", ["other.csv", "pipe"])
def test_a_file_that_no_table_reads_is_no_input(tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    os.mkfifo(file) if name == "pipe" else file.write_text("h\n3\n")
    with pytest.raises(NoInput, match=r"expected a folder, or a file such as abalone\.csv"):
        source_folder(source("abalone"), file)


@pytest.mark.parametrize(("excess", "is_read"), [(0, True), (1, False)])
def test_a_table_has_at_most_two_gibibytes(
    excess: int, is_read: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stat, large = Path.stat, os.stat_result((0o100644, *[0] * 5, (1 << 31) + excess, 0, 0, 0))
    monkeypatch.setattr(Path, "stat", lambda path, **named: large if path.suffix == ".csv" else stat(path, **named))
    with nullcontext() if is_read else pytest.raises(BadTable, match="expected at most 2,147,483,648 bytes"):
        made_up(tmp_path, TABLE.format(format="csv"), table_csv="h\n3\n")


@pytest.mark.parametrize(("n", "is_read"), [(100_000, True), (100_001, False)])
def test_a_record_has_at_most_100000_values(n: int, is_read: bool) -> None:
    with nullcontext() if is_read else pytest.raises(ValueError, match="more than 100,000 values"):
        assert flat(list(range(n)))["99999"] == "99999"


def test_a_folder_without_tables_of_standard_parts(tmp_path: Path) -> None:
    with pytest.raises(BadTable, match=r"expected \*\.blt; found no such file"):
        list(row_items(source("bolts"), tmp_path))


def test_a_file_that_differs_from_the_declared_one_is_named_if_it_exists(tmp_path: Path) -> None:
    declared = source("abalone")
    file = tmp_path / declared.files[0].path
    assert list(changed_files(declared, tmp_path)) == []
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("other")
    assert list(changed_files(declared, tmp_path)) == [file]
    assert list(changed_files(declared, file)) == [file]


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"ObjectName": "chess set", "Dimensions": "H: 3 in. (7.6 cm)"}, "set_of_objects"),
        ({"ObjectName": "fragment", "Dimensions": "H: 3 in. (7.6 cm)"}, "part_not_whole"),
        ({"Dimensions": "3 x 4 x 5 x 6 cm"}, "several_states"),
        ({"Dimensions": " ; "}, "no_size"),
        ({"Dimensions": "unknown"}, "unreadable"),
        ({"Dimensions": "base: 3 cm"}, "part_not_whole"),
        ({"ObjectName": "", "Dimensions": "3 cm"}, "no_category"),
    ],
)
def test_an_object_of_the_museum_without_a_size_of_its_own(tmp_path: Path, fields: dict[str, str], reason: str) -> None:
    assert [row.reason for row in walters(tmp_path, fields).rejected] == [reason]


def test_a_rule_applies_to_listed_texts_and_to_numbers(tmp_path: Path) -> None:
    (tmp_path / "listed.txt").write_text("A\n\nB\n")
    declaration = TABLE.format(format="csv") + (
        'title = "{name}"\nreject = [{ column = "name", listed = "listed.txt", outcome = "not_an_object" },'
        ' { column = "n", below = 3, outcome = "miniature" }, { column = "n", above = 9, outcome = "miniature" }]\n'
    )
    rows = "name,n,h\nA,5,1\nB,5,2\nC,5,3\nD,2,4\nE,3,5\nF,9,6\nG,10,7\nH,x,8\n,5,9\n"
    result = made_up(tmp_path, declaration, table_csv=rows)
    assert [item.title for item in result.items] == ["C", "E", "F", "H", ""]
    assert [row.reason for row in result.rejected] == ["not_an_object"] * 2 + ["miniature"] * 2


def test_lines_before_the_header_are_skipped(tmp_path: Path) -> None:
    result = made_up(tmp_path, TABLE.format(format="csv") + "skip_lines = 2\n", table_csv="a\nb\nh\n3\n ,\n4\n")
    assert [item.extents_mm for item in result.items] == [(30,), (40,)]
