"""Numbers of rows, images and seconds of commands, as their help and messages state them."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import uvicorn

from metric_base.errors import InputError
from metric_cli.subcommands import main
from metric_cli.subcommands.data import build, review
from metric_cli.subcommands.release.diff import print_diff
from metric_tree.pipeline import review_subjects
from metric_tree.reports import contact_sheet
from metric_tree.reports.diff import MovedPrior, ReleaseDiff
from metric_tree.tree import Tree


@pytest.mark.parametrize(("n", "title"), [(20, "20 of 20"), (21, "20 of 21")])
def test_diff_prints_the_20_priors_that_moved_most(n: int, title: str, capsys: pytest.CaptureFixture[str]) -> None:
    priors = [MovedPrior(f"node{k}", "height", 100.0, 110.0, 0.1, 0.0, {}) for k in range(n)]
    print_diff(ReleaseDiff("1", "2", 50, 50, [], [], {}, {}, {}, {}, priors, {}, {}), "mm")
    printed = capsys.readouterr().out
    assert f"priors that moved most, {title}" in printed
    assert ("node19" in printed, "node20" in printed) == (True, False)


@pytest.mark.parametrize(("options", "n_printed"), [([], 40), (["--all"], 41)])
def test_review_prints_40_words(
    options: list[str],
    n_printed: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = Counter({("made", f"word{k:02}", "", "none"): 100 - k for k in range(41)})
    monkeypatch.setattr(review_subjects, "unsettled_words", lambda *_: words)
    (tmp_path / "raw.jsonl").touch()
    assert main(["review", "list", str(tmp_path / "raw.jsonl"), "--folder", str(tmp_path), *options]) == 0
    printed = capsys.readouterr().out
    assert "words that wait for a first reviewer: 41" in printed
    assert printed.count("word") - printed.count("words") == n_printed


def test_a_proofreading_form_has_100_nodes_and_a_blind_list_has_seed_1() -> None:
    parser = argparse.ArgumentParser()
    review.add_arguments(parser)
    assert parser.parse_args(["proof", "--out", "a.html"]).limit == 100
    assert parser.parse_args(["blind", "--reviewer", "a"]).seed == 1


@pytest.mark.parametrize(("options", "n"), [([], 12), (["--images", "3"], 3)])
def test_a_sheet_has_12_images_by_default(
    options: list[str], n: int, mini: Tree, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts: list[int] = []

    def write_sheet(_path: Path, _node: Any, count: int) -> list[Any]:
        counts.append(count)
        return []

    monkeypatch.setattr(contact_sheet, "write_sheet", write_sheet)
    words = ["query", "swivel chair", "--sheet", str(tmp_path / "a.png"), "--tree", str(mini.release.directory)]
    assert main([*words, *options]) == 0
    assert counts == [n]


def test_a_server_stops_after_10_seconds_and_has_500_connections(mini: Tree, monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[str, Any] = {}
    monkeypatch.setattr(uvicorn, "run", lambda _, **options: given.update(options))
    assert main(["serve", "--tree", str(mini.release.directory)]) == 0
    assert (given["timeout_graceful_shutdown"], given["limit_concurrency"]) == (10, 500)


@pytest.mark.parametrize(("name", "size"), [("a.jsonl", 60_000_000), ("a.jsonl.gz", 7_500_000)])
def test_a_build_takes_25_seconds_and_1_6_seconds_per_megabyte(
    name: str, size: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A gzip file has eight times as much raw items; (25 + 1.6 * 60) s are 2.0 minutes."""

    def build_release(*_: Any, **__: Any) -> None:
        raise InputError("stopped")

    monkeypatch.setattr(build, "build_release", build_release)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with (tmp_path / name).open("wb") as file:
        file.truncate(size)
    assert main(["build", str(tmp_path / name), "--out", str(tmp_path / "out"), "--workers", "1"]) == 2
    assert "about 2.0 min: 60 MB of raw items, 1 processes" in capsys.readouterr().err
