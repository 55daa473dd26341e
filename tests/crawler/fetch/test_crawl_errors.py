"""Crawls and pages that cannot work: one line, exit 2, a folder that stays usable; and resumes that name little."""

from __future__ import annotations

import gzip
import json
import signal
import socket
import sqlite3
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from crawler.fetch.frontier import OFF_SITE, PRIVATE
from crawler.fetch.sqlite_frontier import stored_counts
from metric_cli.subcommands import main
from tests.support.processes import started
from tests.synthetic.synthetic_site import Shop, SyntheticSite

ROOT = Path(__file__).resolve().parents[3]
CONTACT = ("--contact", "tests@example.org", "--delay", "0", "--json")


def words(spider: str, out: Path, *more: str) -> list[str]:
    code = "from metric_cli.subcommands import main; raise SystemExit(main())"
    return [sys.executable, "-c", code, "crawl", spider, "--out", str(out), *CONTACT, *more]


def ran(spider: str, out: Path, *more: str) -> tuple[int, Any, str]:
    """Exit status, summary and standard error of a crawl; Scrapy's reactor allows one in a process."""
    done = subprocess.run(words(spider, out, *more), cwd=ROOT, capture_output=True, text=True, timeout=180, check=False)
    return done.returncode, json.loads(done.stdout) if done.stdout else None, done.stderr


def items(out: Path) -> int:
    return sum(len(path.read_text().splitlines()) for path in out.rglob("items-*.jsonl"))


def tables(database: Path) -> set[str]:
    with sqlite3.connect(f"file:{database}?mode=ro", uri=True) as connection:
        return {row[0] for row in connection.execute("SELECT name FROM sqlite_master")}


def kill(process: subprocess.Popen[bytes], database: Path) -> None:
    end = time.monotonic() + 120
    while not database.exists() or "origin" not in tables(database) or not stored_counts(database)["items"]:
        assert time.monotonic() < end
        time.sleep(0.05)
    assert process.poll() is None  # the kill finds the crawl at work
    process.send_signal(signal.SIGKILL)


@pytest.mark.slow
@pytest.mark.parametrize("shared", [False, True], ids=["sqlite", "redis"])
def test_a_resume_knows_where_the_crawl_began(
    tmp_path: Path, shared: bool, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("METRIC_TREE_LEASE_SECONDS", "3")
    more = ["--redis", request.getfixturevalue("redis_url"), "--worker", "one"] if shared else []
    out, database = tmp_path / "out", tmp_path / "out" / ("one" if shared else "") / "frontier.sqlite"
    with SyntheticSite(Shop(products=24, errors=False, delay=1.0)) as site:
        start = ["--private", "--start-url", f"{site.base}/list/0"]
        with started(words("generic", out, *more, *start), cwd=ROOT, stdout=subprocess.DEVNULL) as process:
            kill(process, database)
        site.shop = replace(site.shop, delay=0.0)
        status, _, message = ran("generic", out, *more, "--resume")
        assert (status, message.count("\n")) == (2, 1)
        assert "private address" in message
        assert "--private allows" in message
        status, summary, _ = ran("generic", out, *more, "--resume", "--private")
    assert (status, {*summary["failed"]} & {OFF_SITE, PRIVATE}) == (0, set())
    assert items(out) == 24


@pytest.mark.parametrize("resume", [[], ["--resume"]])
def test_a_crawl_that_came_to_nothing_says_why_and_leaves_its_folder_usable(tmp_path: Path, resume: list[str]) -> None:
    with SyntheticSite(Shop(products=3, errors=False)) as site:
        start = ["--start-url", f"{site.base}/list/0"]
        status, summary, message = ran("generic", tmp_path / "out", *start)
        assert (status, summary["pages"], message.count("\n")) == (2, 0, 1)
        assert "expected pages; found none (private address 1): --private allows" in message
        again = resume or start
        status, summary, _ = ran("generic", tmp_path / "out", "--private", *again)
        assert (status, summary["items"], items(tmp_path / "out")) == (0, 3, 3)
        if resume:
            status, summary, _ = ran("generic", tmp_path / "out", "--private", "--resume")
            assert (status, summary["pages"]) == (0, 0)  # nothing is left to do, and that is no error


def test_a_dead_host_is_an_error(tmp_path: Path) -> None:
    with socket.socket() as silent:  # a port that nobody listens on, and that nobody else takes
        silent.bind(("127.0.0.1", 0))
        start = f"http://127.0.0.1:{silent.getsockname()[1]}/list/0"
        status, summary, message = ran("generic", tmp_path / "out", "--private", "--start-url", start)
    assert (status, summary["pages"], message.count("\n")) == (2, 0, 1)
    assert "expected pages; found none (" in message


@pytest.mark.parametrize(
    ("spider", "more", "said"),
    [
        ("generic", [], "generic: expected --start-url, to begin with; found none"),
        ("generic", ["--query", "chair"], "generic: expected --start-url, to begin with; found none"),
        ("generic", ["--resume"], "generic: expected --start-url, to begin with; found none"),
        ("ikea", [], "ikea: expected --start-url or --query or --category, to begin with; found none"),
        ("wikidata", [], "wikidata: expected --category, to begin with; found none"),
        ("generic", ["--start-url", "notaurl"], "--start-url: expected an http(s) address; found 'notaurl'"),
        ("generic", ["--start-url", "http://["], "--start-url: expected an http(s) address; found 'http://['"),
        ("ikea", ["--query", "x", "--limit", "0"], "--limit: expected 1 or more items; found 0"),
        ("ikea", ["--query", "x", "--delay", "-1"], "--delay: expected 0 or more seconds; found -1"),
        ("ikea", ["--query", "x", "--contact", "me"], "--contact: expected a mail address or a page's URL"),
        ("ikea", ["--query", "x", "--contact", "a@b\nX-Y: z"], "--contact: expected a mail address or a page's URL"),
    ],
)
def test_an_error_of_the_words_is_one_line_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], spider: str, more: list[str], said: str
) -> None:
    assert main(["crawl", spider, "--out", str(tmp_path / "out"), *CONTACT, *more]) == 2
    message = capsys.readouterr().err
    assert said in message
    assert message.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("limit", [2])
def test_a_limit_is_kept_to_with_answers_in_flight_and_pictures(tmp_path: Path, limit: int) -> None:
    with SyntheticSite(Shop(products=9, errors=False, delay=0.2)) as site:
        more = ["--private", "--pictures", "--start-url", f"{site.base}/list/0"]
        status, summary, _ = ran("generic", tmp_path / "out", *more, "--limit", str(limit))
        assert (status, summary["items"], items(tmp_path / "out")) == (0, limit, limit)
        status, summary, _ = ran("generic", tmp_path / "out", *more, "--resume")
        assert (status, items(tmp_path / "out")) == (0, 9)


PAGE = b"<!doctype html><html><body><h1>Stool</h1><p>Width: 40 cm</p></body></html>"


@pytest.mark.parametrize(
    ("body", "found"),
    [
        (None, "no file"),
        (b"", "nothing"),
        (b"\xff\xd8\xff\xe0\x00\x10JFIF<p >", "a JPEG image"),
        (b"\x00\x01<p >", "binary data"),
        (b'{"html": "<p>1</p>"}', "JSON"),
        (b"1 < 2, and no more", "no element of HTML"),
        (gzip.compress(b"%PDF-1.7"), "a PDF"),
    ],
    ids=["absent", "empty", "jpeg", "binary", "json", "text", "gzipped pdf"],
)
def test_what_is_no_page_is_not_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], body: bytes | None, found: str
) -> None:
    path = tmp_path / "file"
    if body is not None:
        path.write_bytes(body)
    assert main(["extract", str(path), "--url", "https://shop.example/p"]) == 2
    captured = capsys.readouterr()
    assert captured.err == f"metric-tree extract: {path}: expected an HTML page; found {found}\n"
    assert captured.out == ""


@pytest.mark.parametrize(
    "body",
    [PAGE, gzip.compress(PAGE, mtime=0), PAGE.decode().encode("utf-16")],
    ids=["plain", "gzipped", "utf-16"],
)
def test_a_page_is_read_from_a_web_address_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], body: bytes
) -> None:
    path = tmp_path / "page.html"
    path.write_bytes(body)
    assert main(["extract", str(path), "--url", "https://shop.example/p", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["title"] == "Stool"
    assert main(["extract", str(path), "--url", "foo"]) == 2
    assert "--url: expected an http(s) address; found 'foo'" in capsys.readouterr().err


def test_a_file_in_place_of_the_folder_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out").write_text("mine")
    assert main(["crawl", "ikea", "--query", "x", "--out", str(tmp_path / "out"), *CONTACT]) == 2
    message = capsys.readouterr().err
    assert "--out: expected a folder; found the file" in message
    assert message.count("\n") == 1
    assert (tmp_path / "out").read_text() == "mine"
