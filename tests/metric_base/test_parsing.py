"""Binary files, tables and records: what is missing or invalid is one line with file, field, expected and found."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import msgspec
import pytest

from metric_base.errors import FieldError, InputError
from metric_base.parsing import BinaryReader, csv_rows, finite_numbers, json_name, json_object, stated_numbers
from metric_base.records import csv_cell, json_record, toml_record


@pytest.mark.parametrize(
    ("data", "read", "message"),
    [
        (b"abc", lambda reader: reader.name("image"), "image: expected a name that ends in a zero byte"),
        (b"\xff\0", lambda reader: reader.name("image"), "image: expected UTF-8"),
        (
            b"a\0b",
            lambda reader: (reader.name("image"), reader.end()),
            "end: expected the end of the file, found 1 more",
        ),
        (b"1234567", lambda reader: reader.count("points", 1), "points: expected 8 bytes, found 7 left"),
        (b"\2" + 15 * b"\0", lambda reader: reader.count("points", 5), r"points: expected at most 1 .*, found 2"),
        (b"123", lambda reader: reader.rows("<u2", 2, "pixels"), "pixels: expected 4 bytes, found 3 left"),
    ],
)
def test_a_binary_file_that_ends_early(data: bytes, read: object, message: str, tmp_path: Path) -> None:
    (path := tmp_path / "images.bin").write_bytes(data)
    with pytest.raises(InputError, match=message):
        read(BinaryReader(path))  # type: ignore[operator]


def test_counts_and_names_of_a_binary_file(tmp_path: Path) -> None:
    (path := tmp_path / "images.bin").write_bytes(b"\2" + 7 * b"\0" + b"a\0b\0")
    reader = BinaryReader(path)
    assert (reader.count("names", 2), reader.name("name"), reader.name("name")) == (2, "a", "b")
    reader.end()


def test_a_line_that_is_no_record_has_its_number(tmp_path: Path) -> None:
    (path := tmp_path / "table.csv").write_text(f"a,b\n1,2\n3,{'x' * 140_000}\n")
    limit = csv.field_size_limit(131_072)
    try:
        with pytest.raises(InputError, match=rf"{re.escape(str(path))}: line 3: expected comma-separated values"):
            csv_rows(path)
    finally:
        csv.field_size_limit(limit)


@pytest.mark.parametrize(
    ("text", "numbers"), [("1,2.5", (1.0, 2.5)), ("1,nan", ()), ("1,inf", ()), ("1;2", ()), ("", ()), ("3", (3.0,))]
)
def test_numbers_that_a_user_states(text: str, numbers: tuple[float, ...]) -> None:
    assert stated_numbers(text) == numbers


def test_numbers_have_a_limit() -> None:
    assert finite_numbers(["1", -9.9], limit=10) == [1.0, -9.9]
    for cells, message in (
        (["10"], "finite numbers below 10"),
        (["-10"], "finite numbers below 10"),
        (["x"], "numbers"),
    ):
        with pytest.raises(FieldError, match=f"expected {message}, found"):
            finite_numbers(cells, limit=10)
    for cell in ("inf", "nan"):
        with pytest.raises(FieldError, match="expected finite numbers, found"):
            finite_numbers([cell])


@pytest.mark.parametrize("value", [None, True, 1, 1.5, "a", [1]])
def test_another_value_than_an_object(value: object) -> None:
    kinds = {None: "null", True: "a truth value", 1.5: "a number", "a": "a string"}
    kind = "an array" if isinstance(value, list) else "a number" if value == 1 and value is not True else kinds[value]  # type: ignore[index]
    with pytest.raises(FieldError, match=f"scene: expected an object, found '{kind}'"):
        json_object(value, "scene")


@pytest.mark.parametrize("value", ["", " ", 3, None])
def test_a_name_has_a_visible_character(value: object) -> None:
    assert json_name("a", "label") == "a"
    with pytest.raises(FieldError, match="label: expected a name"):
        json_name(value, "label")


class _Rule(msgspec.Struct):
    matches: re.Pattern[str] | None = None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("matches = 3", "matches: expected a regular expression, found 3"),
        ("matches = '('", r"matches: expected a regular expression \(missing"),
    ],
)
def test_a_pattern_of_a_declaration(text: str, message: str, tmp_path: Path) -> None:
    (path := tmp_path / "rule.toml").write_text("matches = 'a+'")
    pattern = toml_record(path, _Rule).matches
    assert pattern is not None
    assert pattern.fullmatch("AA")
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        toml_record(path, _Rule)


@pytest.mark.parametrize("line", ["[1]", "{", '{"a": 1', "\ud800"])
def test_a_line_that_is_no_object(line: str) -> None:
    with pytest.raises(FieldError, match="expected a JSON object"):
        json_record(line, dict[str, int])


@pytest.mark.parametrize(
    ("value", "cell"),
    [(["a", 1], "a 1"), ("=1+1", "'=1+1"), (" @x", "' @x"), ("a-b", "a-b"), (-3, -3), ("a\x1b", "a\\x1b")],
)
def test_cells_of_a_spreadsheet(value: object, cell: object) -> None:
    assert csv_cell(value) == cell
