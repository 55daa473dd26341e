from __future__ import annotations

import argparse
import errno
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from metric_base.errors import InputError
from metric_cli.errors import exit_status
from metric_cli.estimate_scale.parser import parser as estimate_scale_parser
from metric_cli.estimate_scale.request import named_sources
from metric_cli.insert_object.parser import parser as insert_object_parser
from metric_cli.subcommands import SUBCOMMANDS, main, parser_of
from metric_cli.subcommands.training.export import parse_plan
from metric_cli.tables import print_table
from metric_tree.release.registry import PATH_VARIABLE
from metric_tree.tree import Tree
from tests.synthetic import minitree


@pytest.mark.parametrize(
    "parser", [estimate_scale_parser(), insert_object_parser(), *map(parser_of, SUBCOMMANDS)], ids=lambda one: one.prog
)
def test_a_help_fits_on_two_screens(parser: argparse.ArgumentParser, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert parser.format_help().count("\n") <= 2 * 48


@pytest.mark.parametrize("subcommand", SUBCOMMANDS)
def test_every_subcommand_has_help_and_json(subcommand: str) -> None:
    text = parser_of(subcommand).format_help()
    assert "--json" in text
    assert f"metric-tree {subcommand}" in text


def test_query(mini: Tree, shown: Any) -> None:
    status, found = shown("query", "Swivel_Chairs", "--tree", str(mini.release.directory))
    assert status == 0
    assert found["node"] == "swivel_chair.n.01"
    assert found["path"] == ["entity", "furniture", "seat", "chair", "swivel chair"]
    assert found["quantiles_mm"]["height"]["0.05"] < 1050 < found["quantiles_mm"]["height"]["0.95"]
    status, found = shown("query", "swivel chair", "--dims", "height", "--tree", str(mini.release.directory))
    assert found["dims"] == ["height"]


def test_query_prints_a_table(mini: Tree, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["query", "swivel chair", "--tree", str(mini.release.directory)]) == 0
    out = capsys.readouterr().out
    assert "entity > furniture > seat > chair > swivel chair" in out
    assert "height" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["query", "unicorn"], "no node is called 'unicorn'"),
        (["query", "swivl chiar"], "did you mean 'swivel chair'"),
        (["query", "chair", "--dims", "height"], "chair.n.01: dims: expected a prior that holds height; found none"),
    ],
)
def test_a_bad_question_is_one_line(
    mini: Tree, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    assert main([*words, "--tree", str(mini.release.directory)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert message in captured.err
    assert captured.err.count("\n") == 1


def test_list(tmp_path: Path, shown: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    minitree.release(tmp_path / "99.0.0")
    monkeypatch.setenv(PATH_VARIABLE, str(tmp_path))
    status, found = shown("list")
    assert status == 0
    assert found[0]["path"] == str(tmp_path / "99.0.0")


@pytest.mark.parametrize(("depth", "n_lines"), [("1", 1), ("2", 3), ("5", 15)])
def test_the_outline_ends_at_the_depth(
    mini: Tree, capsys: pytest.CaptureFixture[str], depth: str, n_lines: int
) -> None:
    command = ["list", "--tree", str(mini.release.directory), "--depth", depth]
    assert main(command) == 0
    assert capsys.readouterr().out.count("\n") == n_lines
    assert main([*command, "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)) == n_lines


@pytest.mark.parametrize(
    ("error", "is_valid"), [("0", False), ("0.01", True), ("1", True), ("1.01", False), ("dust3r", False)]
)
def test_the_error_of_depth_maps_is_a_fraction(tmp_path: Path, error: str, is_valid: bool) -> None:
    words = ["scene", "--metric-depth", str(tmp_path), "--depth-error", error]
    options = estimate_scale_parser().parse_args(words)
    if is_valid:
        (source,) = named_sources(options)
        assert source.network_sd == float(error)
    else:
        with pytest.raises(InputError, match="--depth-error"):
            named_sources(options)


@pytest.mark.parametrize(("words", "folder", "sd"), [([], None, None), (["--depth-error", "Pi3X"], None, 0.31)])
def test_the_scene_itself_is_in_metres(words: list[str], folder: Path | None, sd: float | None) -> None:
    (source,) = named_sources(estimate_scale_parser().parse_args(["SCENE", "--metric-depth", "scene", *words]))
    assert (source.folder, source.network_sd) == (folder, sd)


def test_a_search_has_at_least_one_row(mini: Tree, shown: Any, capsys: pytest.CaptureFixture[str]) -> None:
    release = str(mini.release.directory)
    assert len(shown("search", "mouse", "--limit", "1", "--tree", release)[1]) == 1
    assert len(shown("search", "mouse", "--limit", "2", "--tree", release)[1]) == 2
    assert main(["search", "mouse", "--limit", "0", "--tree", release]) == 2
    assert "--limit: expected a number from 1; found 0" in capsys.readouterr().err


def test_validate(mini: Tree, tmp_path: Path, shown: Any) -> None:
    assert shown("validate", str(mini.release.directory))[0] == 0
    content = minitree.rows()
    content["items.parquet"][0]["kind"] = "guess"
    status, found = shown("validate", str(minitree.release(tmp_path / "bad", content).directory))
    assert status == 2
    assert [finding["code"] for finding in found if finding["code"].startswith("E")] == ["E305"]


@pytest.mark.parametrize(("options", "n_rows"), [([], 10), (["--all"], 11)])
def test_validate_prints_ten_findings_of_a_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], n_rows: int
) -> None:
    for n_wrong in (10, 11):
        content = minitree.rows()
        for row in content["items.parquet"][:n_wrong]:
            row["kind"] = "guess"
        release = minitree.release(tmp_path / f"bad{n_wrong}", content)
        assert main(["validate", str(release.directory), *options]) == 2
        assert capsys.readouterr().out.count("E305 ") == 1 + min(n_wrong, n_rows)  # the title has the total


@pytest.mark.parametrize(
    ("size", "is_valid"), [("64x64", True), ("63x64", False), ("64x63", False), ("8192x8192", True), ("8193x64", False)]
)
def test_sides_of_synthetic_images(size: str, is_valid: bool) -> None:
    parser = parser_of("export")
    arguments = parser.parse_args(["--out", "nowhere-yet", "--size", size])
    if is_valid:
        assert parse_plan(arguments).size == tuple(int(side) for side in size.split("x"))
    else:
        with pytest.raises(InputError, match="--size: expected WIDTHxHEIGHT from 64 to 8192"):
            parse_plan(arguments)


@pytest.mark.parametrize(("number", "status", "line"), [
    (errno.ENOSPC, 2, "x: out.json: No space left on device\n"),
    (errno.EDOM, 1, f"x: internal error: OSError: [Errno {errno.EDOM}] {os.strerror(errno.EDOM)}: 'out.json'\n"),
])  # fmt: skip
def test_a_full_disk_is_an_error_of_the_input(
    number: int, status: int, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def run() -> int:
        raise OSError(number, os.strerror(number), "out.json")

    assert exit_status("x", run) == status
    assert capsys.readouterr().err == line


def test_an_unknown_subcommand_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["quary"]) == 2
    assert "expected one of query" in capsys.readouterr().err
    assert main([]) == 0


def test_an_error_of_the_program_is_one_line_and_1(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_status("x", lambda: 1 // 0) == 1
    assert capsys.readouterr().err == "x: internal error: ZeroDivisionError: integer division or modulo by zero\n"


def test_a_reader_that_leaves_a_pipe_is_no_error(mini: Tree) -> None:
    read, write = os.pipe()
    os.close(read)
    words = ["query", "chair", "--tree", str(mini.release.directory)]
    code = f"from metric_cli.subcommands import main; raise SystemExit(main({words!r}))"
    done = subprocess.run(
        [sys.executable, "-c", code], stdout=write, stderr=subprocess.PIPE, text=True, check=False, timeout=300
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_title_of_a_narrow_table_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    print_table(["n"], [(1,)], title="a title that is wider than its table")
    assert capsys.readouterr().out.splitlines()[0] == "a title that is wider than its table"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["report", "--out", "nowhere/p.html"],
            "--out: expected a file in an existing folder; found no folder nowhere",
        ),
        (["select", "--out", "."], "--out: expected a file; found the folder ."),
        (["review", "list", "nofile"], "nofile: expected raw items (*.jsonl, *.jsonl.gz); found none"),
        (
            ["export", "--out", "x", "--categories", "no.csv"],
            "no.csv: expected a table; found No such file or directory",
        ),
        (["export", "--out", "x", "--coco", "nofile.json", "."], "--coco: expected a JSON file; found no file"),
        (["export", "--out", "x", "--coco", "there", "nodir"], "--coco: expected a folder of pictures; found no"),
    ],
)
def test_a_path_at_error_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, words: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("there").write_text("{}")
    assert main(words) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Errno" not in error
    assert error.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["there"]


def test_sizes_are_printed_as_people_state_them(capsys: pytest.CaptureFixture[str]) -> None:
    """A door is wide and a can has a diameter; a table has one unit and one number of decimals."""
    assert main(["query", "office chair", "--units", "in"]) == 0
    chair = capsys.readouterr().out
    assert "24.8 x 23.5 x 38.4 in (width x depth x height)" in chair
    cells = re.findall(r"^ (?:width|depth|height).*?((?:\s+[\d.]+)+)$", chair, re.MULTILINE)
    assert len(cells) == 3
    assert {len(number.partition(".")[2]) for row in cells for number in row.split()} == {1}
    assert main(["query", "soda can"]) == 0
    assert "mm (diameter x height)" in capsys.readouterr().out
    assert main(["priors", "--vocabulary", "kitti_8", "--units", "cm"]) == 0
    assert "height_q50_cm" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "sides"),
    [
        ("door", "width x height"), ("sofa", "width x depth x height"), ("car", "length x width x height"),
        ("bucket", "diameter x height"), ("banana", "longest side first"),
    ],
)  # fmt: skip
def test_sides_have_the_names_of_their_kind(name: str, sides: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["query", name]) == 0
    assert f" mm ({sides})\n" in capsys.readouterr().out
