from __future__ import annotations

import gzip
import hashlib
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import crawler.imports.declaration
from crawler.imports import downloads, importer
from crawler.items import raw_items
from metric_cli.subcommands import main
from metric_cli.subcommands.data.import_ import has_files

ROOT = Path(__file__).resolve().parents[3]

TABLE = """
id = "{id}"
title = "Made-up table"
url = "https://example.org/{id}"
licence = "{licence}"
licence_basis = "we made them up"
attribution = "us"
kind = "measured"
ship = {ship}
address = "never tried"
fetch = "table.csv, a table of widths"
[[tables]]
files = ["table.csv"]
unit = "cm"
id = "{{no}}"
category = ["box"]
axes = {{ width = "w" }}
[[files]]
path = "table.csv"
sha256 = "{sha}"
url = "{url}"
note = "{note}"
"""


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two declared sources, `open_set` (ships) and `shop_set` (does not), with their source_files."""
    folder = tmp_path / "sources"
    folder.mkdir()
    for name, licence, ship, url in (
        ("open_set", "CC0-1.0", "true", "http://127.0.0.1:9/table.csv"),
        ("shop_set", "none", "false", ""),
    ):
        text = TABLE.format(id=name, licence=licence, ship=ship, sha="0" * 64, url=url, note="cut down")
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
        data = tmp_path / "data" / name
        data.mkdir(parents=True)
        (data / "table.csv").write_text("no,w\n1,12.5\n2,?x\n3,\n4,12.5\n", encoding="utf-8")
    monkeypatch.setattr(crawler.imports.declaration, "data_folder", lambda: tmp_path)
    monkeypatch.setenv(downloads.CACHE_VARIABLE, str(tmp_path / "cache"))
    return tmp_path


def test_one_source_with_its_quarantine(world: Path, shown: Any) -> None:
    out = world / "out" / "table.jsonl"
    status, result = shown("import", "open_set", "--input", str(world / "data" / "open_set"), "--out", str(out))
    assert status == 0
    assert result["schema"] == "metric-tree/import/1"
    assert (result["rows"], result["items"], result["physical_rows"], result["refused"]) == (4, 1, 2, 2)
    assert result["reasons"] == {"no_size": 1, "unreadable": 1}
    assert [item.extents_mm for item in raw_items(out)] == [(125.0,)]
    refused = [json.loads(line) for line in (world / "out" / "table.quarantine.jsonl").read_text().splitlines()]
    assert [(r["row"], r["reason"], r["field"]) for r in refused] == [
        ("table:2", "unreadable", "w"),
        ("table:3", "no_size", "dimensions"),
    ]
    assert {path.name for path in out.parent.iterdir()} == {"table.jsonl", "table.quarantine.jsonl"}


def test_all_sources_the_shipped_ones_and_their_page(world: Path, shown: Any) -> None:
    words = ("import", "--all", "--input", str(world / "data"), "--out", str(world / "raw"))
    more = ("--ship", str(world / "ship"), "--summary", str(world / "README.md"))
    status, result = shown(*words, *more)
    assert status == 0
    assert [entry["source"] for entry in result] == ["open_set", "shop_set"]
    assert {path.name for path in (world / "ship").iterdir()} == {"open_set.jsonl.gz"}
    page = (world / "README.md").read_text()
    assert "- `open_set`: us" in page
    assert "`shop_set`: us" not in page
    assert "| [open_set](https://example.org/open_set) | measured | 4 | 1 | 0 | 2 |" in page
    assert "| open_set | [file](http://127.0.0.1:9/table.csv) | CC0-1.0 | yes | yes | never tried |" in page
    assert "| shop_set | [set](https://example.org/shop_set) | none | no | no | fetch table.csv" in page
    first = (world / "ship" / "open_set.jsonl.gz").read_bytes()
    shown(*words, *more)
    assert (world / "ship" / "open_set.jsonl.gz").read_bytes() == first
    assert len(gzip.decompress(first).splitlines()) == 1


def test_the_file_itself_may_be_given(world: Path, shown: Any) -> None:
    status, result = shown("import", "shop_set", "--input", str(world / "data" / "shop_set" / "table.csv"))
    assert (status, result["items"]) == (0, 1)


def test_the_sources_are_listed(world: Path, shown: Any) -> None:
    status, found = shown("import", "--list")
    assert status == 0
    assert [(s["source"], s["ship"], s["downloads"], s["reason"]) for s in found] == [
        ("open_set", True, "yes", "never tried"),
        ("shop_set", False, "no", "fetch table.csv, a table of widths"),
    ]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["import"], "SOURCE: expected one source, or --all; found neither"),
        (["import", "lamps"], "source: expected one of open_set, shop_set; found 'lamps'"),
        (
            ["import", "shop_set"],
            "shop_set: expected --input: table.csv, a table of widths (see https://example.org/shop_set)",
        ),
        (["import", "open_set"], "expected a download of"),
        (["import", "open_set", "--input", "/nowhere"], "/nowhere: expected the files of open_set"),
        (["import", "open_set", "--all"], "expected one source, or --all; found both, open_set and --all"),
        (["import", "open_set", "--input", "/etc"], "expected table.csv; found no such file"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(
    world: Path, words: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = world / "never" / "x.jsonl"
    assert main([*words, "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1
    assert not out.parent.exists()


def test_out_may_be_a_folder_that_is_there(world: Path, shown: Any) -> None:
    (world / "raw").mkdir()
    words = ("--input", str(world / "data"), "--out", str(world / "raw"))
    assert shown("import", "open_set", *words)[0] == 0
    written = {path.name for path in (world / "raw").iterdir()}
    assert written == {"open_set.jsonl", "open_set.quarantine.jsonl"}


@pytest.mark.parametrize("option", ["--out", "--ship"])
def test_a_file_where_a_folder_should_be_is_reported_before_the_work(
    world: Path, option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (world / "raw").write_text("mine")
    assert main(["import", "--all", "--input", "/nowhere", option, str(world / "raw")]) == 2
    error = "already exists" if option == "--out" else "expected a folder; found the file"
    assert error in capsys.readouterr().err
    assert (world / "raw").read_text() == "mine"


def test_a_file_on_the_way_to_out_is_reported(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (world / "raw").write_text("mine")
    words = ["import", "open_set", "--input", str(world / "data"), "--out", str(world / "raw" / "x.jsonl")]
    assert main(words) == 2
    assert f"{world / 'raw'}: expected a folder, or nothing yet; found a file" in capsys.readouterr().err


def test_a_table_without_a_declared_column_is_refused_whole(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = world / "data" / "open_set" / "table.csv"
    file.write_text("a,no\n1,2\n")
    out = world / "out" / "x.jsonl"
    assert main(["import", "open_set", "--input", str(file), "--out", str(out)]) == 2
    assert capsys.readouterr().err == f"metric-tree import: {file}: columns: expected 'w', found 'a', 'no'\n"
    assert not out.parent.exists()


def test_another_file_than_the_declared_one_is_warned_of_once(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = world / "data" / "open_set" / "table.csv"
    words = ["import", "open_set", "--input", str(world / "data")]
    assert main(words) == 0
    error = capsys.readouterr().err
    assert error.startswith(f"warning: {file}: sha256: expected that declared for open_set; found another")
    assert error.count("\n") == 1
    declared = world / "sources" / "open_set.toml"
    sha = hashlib.sha256(file.read_bytes()).hexdigest()
    declared.write_text(declared.read_text().replace("0" * 64, sha))
    assert main(words) == 0
    assert capsys.readouterr().err == ""


def test_the_list_in_a_pipe_keeps_addresses_whole(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    url = "https://example.org/" + "long/" * 60
    declared = world / "sources" / "open_set.toml"
    declared.write_text(declared.read_text().replace("https://example.org/open_set", url))
    assert main(["import", "--list"]) == 0
    out = capsys.readouterr().out
    assert url in out
    assert "never tried" not in out  # it downloads itself
    assert "fetch table.csv" in out
    assert main(["import", "--list", "--verbose"]) == 0
    assert "never tried" in capsys.readouterr().out


def test_a_write_that_fails_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "x.jsonl"
    importer.write_lines(path, ["old"])

    def full(_self: Path, data: bytes) -> int:
        raise OSError("no space left")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="no space left"):
        importer.write_lines(path, ["new"])
    assert path.read_text() == "old\n"
    assert list(tmp_path.iterdir()) == [path]


def test_an_import_that_cannot_be_written_leaves_no_quarantine_file(tmp_path: Path) -> None:
    folder = ROOT / "data" / "examples" / "source"
    (tmp_path / "lamps.jsonl").write_text("a file of others\n")
    words = ["import", "lamps", "--sources", str(folder), "--input", str(folder)]
    assert main([*words, "--out", str(tmp_path)]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["lamps.jsonl"]


def test_sources_of_ones_own_are_imported_without_the_package(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = ROOT / "data" / "examples" / "source"
    words = ["import", "lamps", "--sources", str(folder), "--input", str(folder)]
    assert main([*words, "--out", str(tmp_path), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["items"], summary["reasons"]) == (2, {"no_size": 1, "part_not_whole": 1})
    first = json.loads((tmp_path / "lamps.jsonl").read_text().splitlines()[0])
    assert (first["url"], first["region"], first["year"]) == ("https://lamps.example/p/17", "DE", 2021)
    assert main(["import", "--list", "--sources", str(tmp_path)]) == 2
    assert "--sources: expected a folder of declarations" in capsys.readouterr().err


@pytest.mark.parametrize(("changes", "is_used"), [
    ({}, False), ({"files": ("a.csv",)}, True), ({"excluded": "unclear licence"}, True), ({"id": "here"}, True),
])  # fmt: skip
def test_a_source_without_files_and_without_a_folder_is_left_out(
    changes: dict[str, Any], is_used: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "here").mkdir()
    declared: Any = SimpleNamespace(**{"id": "gone", "files": (), "excluded": "", "fetch": "ask them", **changes})
    assert has_files(declared, tmp_path) is is_used
    warning = f"warning: gone: no folder of this name in {tmp_path}; left out (ask them)\n"
    assert capsys.readouterr().err == ("" if is_used else warning)
    assert has_files(declared, None), "without --input it is downloaded"
