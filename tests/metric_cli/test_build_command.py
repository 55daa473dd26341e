"""The command `metric-tree build`: its output, its exit status, and the same build on two Dask workers."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from functools import partial

import pytest

import metric_cli.subcommands.data.build as command
from crawler.imports.declaration import declared_sources as declared
from metric_base import executors
from metric_cli.subcommands import main
from metric_tree.pipeline.build import build_release, ingest_part
from tests.synthetic.raw_fixture import SOURCES, synthetic_items, written
from tests.synthetic.small_taxonomy import small_taxonomy

DECLARATION = """title = "A shop"
url = "https://shop.example/data"
licence = "CC0-1.0"
licence_basis = "we made it up"
kind = "product"
ship = true
attribution = "A shop"
excluded = "its rows are made elsewhere"
"""


@pytest.fixture
def raw(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "build_release", partial(build_release, taxonomy=small_taxonomy))
    monkeypatch.setattr(command, "ingest_part", partial(ingest_part, taxonomy=small_taxonomy))
    monkeypatch.setattr(command, "declared_sources", lambda folder: SOURCES if folder is None else declared(folder))
    monkeypatch.setattr(command, "shipped_curated", tuple)
    return written(tmp_path / "raw.jsonl", synthetic_items(per_class=12))


def run(*words):
    return main(["build", *map(str, words)])


def test_json_is_the_manifest_and_the_log_lies_where_it_was_asked_for(raw, tmp_path, capsys):
    out, log = tmp_path / "release", tmp_path / "log"
    words = ("--out", out, "--log", log, "--version", "1.2.3", "--created", "2026-01-02", "--workers", 1, "--json")
    assert run(raw, *words) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["version"] == "1.2.3"
    assert printed["created"] == "2026-01-02"
    assert printed["directory"] == str(out)
    assert sorted(path.name for path in log.iterdir()) == ["quarantine.jsonl", "report.json"]


def test_table_names_what_was_refused(raw, tmp_path, capsys):
    raw.write_text(
        raw.read_text() + synthetic_items()[0].line().replace('"chair"', '"gizmo"').replace("chair-0", "g") + "\n"
    )
    assert run(raw, "--out", tmp_path / "release", "--workers", 1, "--no-heldout") == 0
    printed = capsys.readouterr()
    assert "no_category" in printed.out
    assert "leaves" in printed.out
    assert printed.err == ""


def test_the_date_may_come_from_the_environment(raw, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    assert run(raw, "--out", tmp_path / "release", "--workers", 1, "--no-heldout", "--json") == 0
    assert json.loads(capsys.readouterr().out)["created"] == "1970-01-01"


def test_parts_and_a_last_build(raw, tmp_path, capsys):
    words = ("--out", tmp_path / "release", "--workers", 1, "--no-heldout")
    for part in ("2/2", "1/2"):
        assert run(raw, *words, "--part", part) == 0
        assert f"part {part}" in capsys.readouterr().out
    assert not (tmp_path / "release").exists()
    assert run(raw, *words, "--part", "1/2", "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"part": "1/2", "raw": {"taken": 63}}
    assert run(raw, *words, "--json") == 0
    assert json.loads(capsys.readouterr().out)["counts"]["raw"]["taken"] == 63


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--part", "3/2"), "--part: part: expected I/N with I from 1 to N, such as 3/8, found '3/2'"),
        (("--version", "one"), "--version: expected a semantic version such as 1.0.0; found 'one'"),
        (("--created", "yesterday"), "--created: expected an ISO date; found 'yesterday'"),
        (("--scheduler", "tcp://127.0.0.1:1"), "--scheduler: expected a Dask scheduler"),
    ],
)
def test_bad_arguments_are_one_line(raw, tmp_path, capsys, monkeypatch, words, message):
    monkeypatch.setattr(executors, "SCHEDULER_TIMEOUT", 0.3)
    assert run(raw, "--out", tmp_path / "release", *words) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert message in printed.err
    assert printed.err.count("\n") == 1
    assert not (tmp_path / "release").exists()


def test_a_private_source_without_raw_items_is_refused(raw, tmp_path, capsys):
    assert run(raw, "--out", tmp_path / "release", "--workers", 1, "--include-withheld", "shoq") == 2
    assert (
        "--include-withheld: expected sources of the raw items (club, games, lab, shop); found shoq"
        in capsys.readouterr().err
    )
    assert not (tmp_path / "release").exists()


def test_withheld_rows_of_an_undeclared_source_are_reported(raw, tmp_path, capsys):
    raw.write_text(raw.read_text().replace('"source": "shop"', '"source": "mine"'))
    words = ("--workers", 1, "--no-heldout")
    assert run(raw, "--out", tmp_path / "public", *words) == 0
    error = capsys.readouterr().err
    assert "all rows of mine; --include-withheld mine keeps them" in error
    assert error.count("\n") == 1  # the withheld sources that are declared are no news
    assert run(raw, "--out", tmp_path / "private", "--include-withheld", "mine", *words) == 0
    assert capsys.readouterr().err == ""


def test_a_source_that_a_folder_declares_is_known_to_the_build(raw, tmp_path, capsys):
    """Its rows ship under the licence of its declaration, and the manifest has its address."""
    folder = tmp_path / "declarations"
    folder.mkdir()
    name = next(iter({item.source for item in synthetic_items()}))
    (folder / f"{name}.toml").write_text(f'id = "{name}"\n{DECLARATION}')
    words = ("--sources", folder, "--workers", 1, "--no-heldout", "--json")
    assert run(raw, "--out", tmp_path / "release", *words) == 0
    records = {one["id"]: one for one in json.loads(capsys.readouterr().out)["sources"]}
    assert records[name]["url"] == "https://shop.example/data"
    assert records[name]["licence"] == "CC0-1.0"
    assert records[name]["n_rows"] > 0
    assert run(raw, "--out", tmp_path / "other", "--sources", tmp_path / "none") == 2
    assert "--sources: expected a folder of declarations" in capsys.readouterr().err


def test_a_build_of_nothing_but_curated_ranges_says_so(raw, tmp_path, capsys, monkeypatch):
    curated = [replace(item, source="judged") for item in synthetic_items(per_class=4)]
    monkeypatch.setattr(command, "shipped_curated", lambda: curated)
    raw.write_text("")
    assert run(raw, "--out", tmp_path / "release", "--workers", 1, "--no-heldout") == 0
    assert "warning: no raw item was taken" in capsys.readouterr().err


def test_an_interrupt_ends_the_workers_in_silence():
    """Both the parent and its workers get it, as from a terminal; one worker is busy."""
    program = [sys.executable, "-m", "tests.support.interrupted_pool"]
    done = subprocess.run(program, capture_output=True, text=True, check=False, timeout=300, start_new_session=True)
    assert (done.returncode, done.stderr) == (130, "x: interrupted\n")


@pytest.mark.parametrize("fold", ["5/5", "1", "a/b", "1/0"])
def test_a_fold_that_is_none_is_refused(raw, tmp_path, capsys, fold):
    assert run(raw, "--out", tmp_path / "release", "--fold-out", fold) == 2
    assert "expected I/N" in capsys.readouterr().err


@pytest.mark.slow
def test_two_dask_workers_over_tcp_build_the_same_bytes(raw, tmp_path):
    distributed = pytest.importorskip("distributed")
    words = ("--created", "2026-01-02", "--no-heldout")
    assert run(raw, "--out", tmp_path / "here", "--workers", 1, *words) == 0
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, protocol="tcp", dashboard_address=None
    ) as cluster:
        assert cluster.scheduler_address.startswith("tcp://")
        assert run(raw, "--out", tmp_path / "dask", "--scheduler", cluster.scheduler_address, *words) == 0
    for path in (tmp_path / "here").iterdir():
        assert path.read_bytes() == (tmp_path / "dask" / path.name).read_bytes()
