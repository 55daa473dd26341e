"""Ranges of options and widths of output, in numbers on each side."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import pytest

from metric_cli.estimate_scale.estimate import main as estimate_scale
from metric_cli.subcommands import main
from metric_cli.subcommands.data.build import creation_date
from metric_cli.tables import is_number
from metric_tree.tree import Tree


@pytest.mark.parametrize(("depth", "status"), [("0", 2), ("1", 0), ("5", 0), ("6", 2)])
def test_the_depth_of_an_outline_is_1_to_5(
    mini: Tree, capsys: pytest.CaptureFixture[str], depth: str, status: int
) -> None:
    assert main(["list", "--tree", str(mini.release.directory), "--depth", depth]) == status
    assert ("--depth: expected 1 to 5" in capsys.readouterr().err) == (status == 2)


@pytest.mark.parametrize(("n", "status"), [("0", 2), ("1", 0)])
def test_a_list_of_images_has_at_least_one(mini: Tree, capsys: pytest.CaptureFixture[str], n: str, status: int) -> None:
    assert main(["query", "swivel chair", "--tree", str(mini.release.directory), "--images", n, "--json"]) == status
    assert ("--images: expected a number from 1; found 0" in capsys.readouterr().err) == (status == 2)


@pytest.mark.parametrize(
    ("option", "value", "status"),
    [("--count", "0", 2), ("--count", "1", 0), ("--most-divergence", "0", 2), ("--most-divergence", "0.01", 0)],
)
def test_a_selection_has_categories_and_a_divergence(
    mini: Tree, capsys: pytest.CaptureFixture[str], option: str, value: str, status: int
) -> None:
    assert main(["select", "--tree", str(mini.release.directory), option, value]) == status
    assert (f"{option}: expected" in capsys.readouterr().err) == (status == 2)


@pytest.mark.parametrize(
    ("version", "is_valid"),
    [("1.0.0", True), ("1.0.0-rc.1", True), ("1.0.0+a", True), ("1.0", False), ("1.0.0.0", False), ("1.0.0-", False)],
)
def test_a_version_is_semantic(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], version: str, is_valid: bool
) -> None:
    out = tmp_path / "out"
    main(["build", str(tmp_path), "--out", str(out), "--version", version, "--created", "yesterday"])
    assert ("--created: expected an ISO date" in capsys.readouterr().err) == is_valid


def test_a_date_keeps_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    assert creation_date("2026-01-02") == "2026-01-02"
    assert creation_date("2026-01-02T03:04:05") == "2026-01-02T03:04:05"
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    assert creation_date(None) == "1970-01-02"


@pytest.mark.parametrize(("options", "n_shown"), [((), 40), (("--all",), 41)])
def test_a_review_lists_40_words(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: tuple[str, ...],
    n_shown: int,
) -> None:
    words = Counter({("shop", f"word{index}", "none", "head"): 1 for index in range(41)})
    monkeypatch.setattr("metric_tree.pipeline.review_subjects.unsettled_words", lambda *_: words)
    assert main(["review", "list", str(tmp_path), "--folder", str(tmp_path), *options]) == 0
    out = capsys.readouterr().out
    assert out.count("word") - out.count("words") == n_shown


def test_an_unknown_source_has_three_suggestions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["review", "record", "wikidat: chair", "none", "--reviewer", "A B", "--folder", str(tmp_path)]
    assert main(command) == 2
    error = capsys.readouterr().err
    nearest = error.split("a source (")[1].split(" are nearest")[0].split(", ")
    assert len(nearest) == 3
    assert "wikidata" in nearest


@pytest.fixture
def objects_file(tmp_path: Path) -> Path:
    heights = {"mouse": 0.04, "swivel chair": 1.1, "bar stool": 0.8}
    objects = [
        {"id": str(n), "category": name, "dimensions": {"height": m}} for n, (name, m) in enumerate(heights.items())
    ]
    file = tmp_path / "objects.json"
    file.write_text(json.dumps({"schema": "metric-tree/objects/1", "objects": objects}))
    return file


@pytest.mark.parametrize(("columns", "width"), [(None, 120), ("70", 70)])
def test_lines_of_a_result_are_wrapped(
    mini: Tree,
    objects_file: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    columns: str | None,
    width: int,
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    if columns is not None:
        monkeypatch.setenv("COLUMNS", columns)
    estimate_scale(["--objects", str(objects_file), "--tree", str(mini.release.directory)])
    longest = max(map(len, capsys.readouterr().out.splitlines()))
    assert width - 12 < longest <= width


def test_a_wide_table_has_at_least_160_columns(
    mini: Tree, objects_file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tables = []
    for columns in ("80", "160", "400"):
        monkeypatch.setenv("COLUMNS", columns)
        estimate_scale(["--objects", str(objects_file), "--tree", str(mini.release.directory), "--wide"])
        lines = capsys.readouterr().out.splitlines()
        tables.append([line for line in lines if "swivel_chair.n.01" in line])
    assert tables[0] == tables[1]
    assert len(tables[0]) == 1


def test_cells_of_digits_signs_and_separators_are_numbers() -> None:
    numbers = ["1", "-1,200.5", "+3 %", "–", ""]
    assert [is_number(cell) for cell in (*numbers, "1.2.3", "1e3", "a", "%")] == [True] * 5 + [False] * 4


@pytest.mark.parametrize(
    ("port", "message"), [("-1", "--draw"), ("0", "video"), ("65535", "video"), ("65536", "--draw")]
)
def test_ports_of_the_drawing_page(tmp_path: Path, capsys: pytest.CaptureFixture[str], port: str, message: str) -> None:
    video = tmp_path / "a.mp4"
    video.touch()
    assert estimate_scale([str(video), f"--draw={port}"]) == 2
    assert f"{message}: " in capsys.readouterr().err  # a valid port leads to the next error: the video is empty


@pytest.mark.parametrize(
    ("port", "message"), [("-1", "--port"), ("0", "absent"), ("65535", "absent"), ("65536", "--port")]
)
def test_ports_of_the_server(capsys: pytest.CaptureFixture[str], port: str, message: str) -> None:
    assert main(["serve", f"--port={port}", "--tree", "absent"]) == 2
    assert message in capsys.readouterr().err


def test_a_site_is_written_with_a_line_of_its_size(
    mini: Tree, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "site"
    assert main(["site", str(out), "--tree", str(mini.release.directory), "--workers", "1"]) == 0
    n_files = sum(path.is_file() for path in out.rglob("*"))
    assert capsys.readouterr().out.startswith(f"{out / 'index.html'}: {n_files:,} files, ")
