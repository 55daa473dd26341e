"""Crawls of a made shop on loopback: items against truth, kills, shared frontiers, manners."""

from __future__ import annotations

import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import redis

from tests.crawler.conftest import RedisServer
from tests.support.processes import started
from tests.synthetic.synthetic_site import PICTURES, Shop, SyntheticSite, error, expected

ROOT = Path(__file__).resolve().parents[3]


class PatientSite(SyntheticSite):
    """A shop that returns its first page when the lease of the page has been renewed in Redis."""

    redis_url = ""

    def answer(self, path: str) -> tuple[int, dict[str, str], bytes]:
        if path == "/list/0" and not self.fetched[path]:
            ends = redis.Redis.from_url(self.redis_url, socket_timeout=60)
            leased = ends.zrange("metric-tree:out:leases", 0, -1, withscores=True)
            _until(lambda: ends.zscore("metric-tree:out:leases", leased[0][0]) > leased[0][1], 20.0)
        return super().answer(path)


def command(site: SyntheticSite, out: Path, *words: str) -> list[str]:
    code = "from metric_cli.subcommands import main; raise SystemExit(main())"
    fixed = [
        "crawl",
        "generic",
        "--out",
        str(out),
        "--start-url",
        f"{site.base}/list/0",
        "--contact",
        "tests@example.org",
    ]
    return [sys.executable, "-c", code, *fixed, "--delay", "0", "--private", "--json", *words]


def crawl(site: SyntheticSite, out: Path, *words: str, status: int = 0) -> Any:
    done = subprocess.run(
        command(site, out, *words), cwd=ROOT, capture_output=True, text=True, timeout=240, check=False
    )
    assert done.returncode == status, done.stderr
    return json.loads(done.stdout) if status == 0 else done.stderr


def items(out: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for path in sorted(out.rglob("items-*.jsonl")) for line in path.read_text().splitlines()]


def sizes(out: Path) -> dict[str, tuple[float, ...]]:
    return {item["title"]: tuple(item["extents_mm"]) for item in items(out)}


@pytest.mark.slow
def test_a_shop_with_errors_is_brought_home(tmp_path: Path) -> None:
    shop = Shop(products=250)
    with SyntheticSite(shop) as site:
        summary = crawl(site, tmp_path / "out")
        assert sizes(tmp_path / "out") == expected(shop)
        assert len(items(tmp_path / "out")) == len(expected(shop))
        assert not any(path.startswith("/private/") for path in site.fetched)
    cases = [error(number, shop) for number in range(shop.products)]
    assert summary["reason"] == "finished"
    assert summary["frontier"]["waiting"] == summary["frontier"]["leased"] == 0
    assert summary["failed"]["http 500"] == cases.count("lasting_500")
    assert summary["failed"].get("off the site", 0) == cases.count("off_site")
    assert summary["frontier"]["failed"] == sum(summary["failed"].values())
    assert summary["failed"]["too large"] == cases.count("bomb") + cases.count("endless")
    assert summary["bans"] == cases.count("passing_503")
    assert summary["dropped"]["no_html"] == cases.count("lying_type")
    assert summary["dropped"]["no_size"] >= cases.count("no_size") + cases.count("package_only")
    whole = {name: sum(site.get(name, 0) for site in summary["sites"].values()) for name in ("pages", "items")}
    assert whole == {"pages": summary["pages"], "items": summary["items"]}
    for kind in ("dropped", "failed"):
        for reason, count in summary[kind].items():
            assert sum(site.get(f"{kind}/{reason}", 0) for site in summary["sites"].values()) == count
    home = max(summary["sites"].values(), key=lambda site: site.get("pages", 0))
    assert home["bytes"] > 0
    assert home["pages_per_second"] > 0


@pytest.mark.slow
def test_kills_lose_nothing_and_repeat_nothing(tmp_path: Path) -> None:
    kills = 3
    shop = Shop(products=80 * kills, errors=False, delay=0.5)
    generator = random.Random(4)
    with SyntheticSite(shop) as site:
        for number in range(kills):
            words = ["--resume"] if number else []
            with started(command(site, tmp_path / "out", *words), cwd=ROOT, stdout=subprocess.DEVNULL) as process:
                before = _stored(tmp_path / "out")
                _until(lambda before=before: _stored(tmp_path / "out") > before)
                time.sleep(generator.random())
                assert process.poll() is None  # a kill finds the crawl at work
                process.send_signal(signal.SIGKILL)
        site.shop = replace(shop, delay=0.0)
        crawl(site, tmp_path / "out", "--resume")
        found = items(tmp_path / "out")
        assert len(found) == len({item["title"] for item in found}) == shop.products
        again = sum(count - 1 for path, count in site.fetched.items() if path.startswith("/item/"))
    # only pages in flight at a kill are requested again: in the downloader, and fetched but not yet read
    assert again <= kills * 32


def test_a_limit_stops_a_resume_goes_on_and_a_crawl_is_not_overwritten(tmp_path: Path) -> None:
    with SyntheticSite(Shop(products=60, errors=False)) as site:
        assert crawl(site, tmp_path / "out", "--limit", "20")["reason"] == "limit"
        assert len(items(tmp_path / "out")) == 20
        message = crawl(site, tmp_path / "out", status=2)
        assert "expected a free folder, or --resume; found a crawl" in message
        crawl(site, tmp_path / "out", "--resume")
        assert len(items(tmp_path / "out")) == 60
        assert crawl(site, tmp_path / "out", "--resume")["items"] == 0


@pytest.mark.slow
def test_a_crawl_with_a_cache_asks_whether_pages_changed(tmp_path: Path) -> None:
    with SyntheticSite(Shop(products=30, errors=False)) as site:
        cache = ["--cache", str(tmp_path / "cache")]
        crawl(site, tmp_path / "first", *cache)
        assert not site.unchanged
        asked = site.fetched.copy()
        crawl(site, tmp_path / "second", *cache)
        again = site.fetched - asked
        pages = {path: count for path, count in again.items() if path.startswith(("/item", "/list", "/calendar"))}
        assert len(pages) > 30
        assert {path: site.unchanged[path] for path in pages} == pages  # each was requested, and none was sent
        assert sizes(tmp_path / "second") == sizes(tmp_path / "first") == expected(site.shop)
        unchanged = site.unchanged.copy()
        site.shop = Shop(products=30, errors=False, sizes=(10,))  # every product's page is another now
        crawl(site, tmp_path / "third", *cache)
        sent_again = [path for path in site.unchanged - unchanged if path.startswith("/item")]
        assert sent_again == []
        assert sizes(tmp_path / "third") == expected(site.shop)


def test_pictures_are_stored_once_and_named_by_their_items(tmp_path: Path) -> None:
    with SyntheticSite(Shop(products=20, errors=False)) as site:
        summary = crawl(site, tmp_path / "out", "--pictures")
        asked = {path for path in site.fetched if path.startswith("/picture/")}
    files = [path for path in (tmp_path / "out" / "pictures").rglob("*.png") if path.is_file()]
    lines = [line for path in (tmp_path / "out").glob("pictures-*.jsonl") for line in path.read_text().splitlines()]
    assert len(asked) == len(files) == len({json.loads(line)["image_id"] for line in lines}) == PICTURES
    assert all(item["images"] for item in items(tmp_path / "out"))
    assert (summary["items"], summary["pictures"]) == (20, len(lines))
    assert summary["frontier"]["items"] == 20
    assert [path.name for path in (tmp_path / "out").glob("items-*")] == ["items-000000001-000000020.jsonl"]


@pytest.mark.slow
def test_two_workers_share_a_frontier_and_one_is_killed(tmp_path: Path, redis_url: str) -> None:
    environment = os.environ | {"METRIC_TREE_LEASE_SECONDS": "3"}
    shop = Shop(products=120, errors=False, delay=1.0)  # one worker alone needs 8 s: the other has started by then
    with PatientSite(shop) as site:
        site.redis_url = redis_url
        words = ["--redis", redis_url]
        options = {"cwd": ROOT, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment}
        begin = command(site, tmp_path / "out", *words, "--worker")
        with started([*begin, "one"], **options) as one, started([*begin, "two"], **options) as two:
            _until(lambda: all(_stored(tmp_path / "out" / name) > 5 for name in ("one", "two")))
            one.send_signal(signal.SIGKILL)
            one.wait(timeout=60)
            site.shop = replace(shop, delay=0.0)
        assert two.returncode == 0
        crawl_again = command(site, tmp_path / "out", *words, "--worker", "one", "--resume")
        subprocess.run(crawl_again, cwd=ROOT, capture_output=True, env=environment, timeout=180, check=True)
        found = {item["title"] for item in items(tmp_path / "out")}
        twice = sum(count - 1 for path, count in site.fetched.items() if path.startswith("/item/"))
    assert site.fetched["/list/0"] == 1  # its lease was renewed while the site worked on it
    assert len(found) == shop.products
    assert {path.parent.name for path in (tmp_path / "out").rglob("items-*.jsonl")} == {"one", "two"}
    assert twice <= 32  # pages that the killed worker had in flight: in the downloader, and fetched but not yet read


@pytest.mark.slow
def test_a_killed_worker_and_a_killed_server_lose_no_item(tmp_path: Path, redis_server: RedisServer) -> None:
    """One of two workers is killed, then the server; the other ends with a line, and both continue the crawl."""
    environment = os.environ | {"METRIC_TREE_LEASE_SECONDS": "3"}
    shop = Shop(products=160, errors=False, delay=1.0)
    with SyntheticSite(shop) as site:
        begin = command(site, tmp_path / "out", "--redis", redis_server.url, "--worker")
        quiet = {"cwd": ROOT, "stdout": subprocess.DEVNULL, "env": environment}
        with (
            started([*begin, "one"], stderr=subprocess.DEVNULL, **quiet) as one,
            started([*begin, "two"], stderr=subprocess.PIPE, text=True, **quiet) as two,
        ):
            _until(lambda: all(_stored(tmp_path / "out" / name) > 5 for name in ("one", "two")))
            one.send_signal(signal.SIGKILL)
            redis_server.stop(keep=True)
            message = two.communicate(timeout=180)[1]
        assert (two.returncode, message.count("\n")) == (2, 1), message
        site.shop = replace(shop, delay=0.0)
        redis_server.start()
        again = [[*begin, name, "--resume"] for name in ("one", "two")]
        with started(again[0], **quiet) as one, started(again[1], **quiet) as two:
            pass
        assert (one.returncode, two.returncode) == (0, 0)
        titles = [item["title"] for item in items(tmp_path / "out")]
        twice = sum(count - 1 for path, count in site.fetched.items() if path.startswith("/item/"))
    assert len(set(titles)) == shop.products
    assert len(titles) - len(set(titles)) <= twice <= 64  # pages that the two workers had in flight


def _stored(folder: Path) -> int:
    path = folder / "frontier.sqlite"
    if not path.exists():
        return 0
    with sqlite3.connect(f"file:{path}?mode=ro", uri=True) as connection:
        try:
            return int(connection.execute("SELECT count(*) FROM items").fetchone()[0])
        except sqlite3.OperationalError:  # the worker has not made its tables yet
            return 0


def _until(holds: Any, seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)
