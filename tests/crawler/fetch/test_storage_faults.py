"""Full disks and lost servers: nothing half-written, one line, exit 2, and a crawl that goes on from there."""

from __future__ import annotations

import asyncio
import resource
import shutil
import signal
import subprocess
import time
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from scrapy import Request
from scrapy.http import Response

from crawler.fetch.frontier import Outcome, Task
from crawler.fetch.frontier_sqlite import SqliteFrontier
from crawler.fetch.scheduler import KEY, CommitMiddleware
from crawler.fetch.watched import WatchedFrontier
from crawler.items import RawItem
from crawler.page.budget import SlowPage
from metric_base.faults import StorageFault
from tests.crawler.fetch.test_crawl_faults import ROOT, items, words
from tests.made.made_site import MadeSite, Shop


class _Unwritable:
    """A fact that no JSON holds."""


def leased(frontier: SqliteFrontier) -> Task:
    frontier.add([Task("http://a.example/1")])
    task = frontier.lease()
    assert task is not None
    return task


def test_a_page_whose_links_cannot_be_written_leaves_no_item(tmp_path: Path) -> None:
    frontier = SqliteFrontier(tmp_path / "f.sqlite")
    task = leased(frontier)
    links = [Task("http://a.example/2"), Task("http://a.example/3", meta={"fact": _Unwritable()})]
    with pytest.raises(TypeError):
        frontier.commit(Outcome(task.key, [("shop:1", "{}")], links))
    assert frontier.counts() == {"waiting": 0, "leased": 1, "done": 0, "failed": 0, "items": 0, "pictures": 0}
    assert frontier.commit(Outcome(task.key, [("shop:1", "{}")], links[:1])) == 1
    assert frontier.counts() == {"waiting": 1, "leased": 0, "done": 1, "failed": 0, "items": 1, "pictures": 0}


def test_a_disk_that_is_full_at_the_commit_leaves_the_page_to_be_fetched_again(tmp_path: Path) -> None:
    frontier = SqliteFrontier(tmp_path / "f.sqlite")
    task = leased(frontier)
    frontier._connection.execute("PRAGMA max_page_count = 1")  # SQLite rounds it up to the pages in use
    many = [(f"shop:{number}", "x" * 4000) for number in range(40)]
    watched = WatchedFrontier(frontier, "f.sqlite")
    ended: list[bool] = []
    watched.on_fault = lambda: ended.append(True)
    assert watched.commit(Outcome(task.key, many)) == 0
    assert "f.sqlite: expected a frontier that can be written and asked, found: database or disk is full" in str(
        watched.fault
    )
    assert (watched.lease(), watched.is_exhausted(), ended) == (None, True, [True])
    again = SqliteFrontier(tmp_path / "f.sqlite")
    assert again.counts() == {"waiting": 1, "leased": 0, "done": 0, "failed": 0, "items": 0, "pictures": 0}


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of a megabyte."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("no right to mount a small disk here")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=False)


@pytest.mark.parametrize("more", [[], ["--pictures"]], ids=["pages", "pictures"])
def test_a_crawl_on_a_full_disk_ends_with_one_line(small_disk: Path, more: list[str]) -> None:
    filler = small_disk / "filler"
    filler.write_bytes(b"0" * 560_000)
    with MadeSite(Shop(products=300, faults=False)) as site:
        start = ["--private", "--start-url", f"{site.base}/list/0", *more]
        done = subprocess.run(
            words("generic", small_disk / "out", *start),
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=180,
            check=False,
        )
        assert (done.returncode, done.stderr.count("\n"), done.stdout) == (2, 1, ""), done.stderr
        assert "full" in done.stderr or "No space left" in done.stderr
        filler.unlink()
        moved = small_disk.parent / "moved"
        shutil.copytree(small_disk / "out", moved)
        again = subprocess.run(
            words("generic", moved, "--private", "--resume"),
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=240,
            check=False,
        )
    assert (again.returncode, items(moved)) == (0, 300), again.stderr


def test_a_file_that_may_not_grow_ends_the_crawl_with_one_line(tmp_path: Path) -> None:
    def bounded() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, 150_000))

    with MadeSite(Shop(products=300, faults=False)) as site:
        start = ["--private", "--start-url", f"{site.base}/list/0"]
        done = subprocess.run(
            words("generic", tmp_path / "out", *start),
            cwd=ROOT, capture_output=True, text=True, timeout=180, check=False, preexec_fn=bounded,
        )  # fmt: skip
        assert (done.returncode, done.stderr.count("\n"), done.stdout) == (2, 1, ""), done.stderr
        assert "frontier.sqlite: expected a frontier that can be written and asked" in done.stderr


def test_a_crawl_that_loses_its_server_ends_with_one_line(tmp_path: Path, redis_url: str) -> None:
    import redis

    out = tmp_path / "out"
    with MadeSite(Shop(products=400, faults=False, delay=0.05)) as site:
        more = ["--private", "--start-url", f"{site.base}/list/0", "--redis", redis_url, "--worker", "one"]
        process = subprocess.Popen(
            words("generic", out, *more), cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        server = redis.Redis.from_url(redis_url)
        end = time.monotonic() + 120
        while not server.hlen("metric-tree:out:done"):
            assert time.monotonic() < end
            time.sleep(0.05)
        server.shutdown(nosave=True)
        output, message = process.communicate(timeout=180)
    assert (process.returncode, message.count("\n"), output) == (2, 1, ""), message
    assert f"{redis_url}: expected a frontier that can be written and asked" in message


@pytest.mark.parametrize("damage", [b"no database" * 100, b"SQLite format 3\x00" + b"\x00" * 200])
def test_a_damaged_frontier_is_one_line(tmp_path: Path, damage: bytes) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "frontier.sqlite").write_bytes(damage)
    start = ["--private", "--start-url", "http://127.0.0.1:9/x", "--resume"]
    done = subprocess.run(
        words("generic", out, *start), cwd=ROOT, capture_output=True, text=True, timeout=180, check=False
    )
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "frontier.sqlite" in done.stderr


def _answered(frontier: WatchedFrontier, fault: Exception) -> None:
    """A page whose reader raises passes through the middleware that commits pages."""

    async def result() -> AsyncIterator[Any]:
        yield RawItem(source="shop", source_id="1")
        raise fault

    async def drain() -> None:
        settings = SimpleNamespace(getint=lambda _: 0)
        crawler = SimpleNamespace(frontier=frontier, stats=None, settings=settings, spider=None, engine=None)
        task = frontier.lease()
        assert task is not None
        request = Request(task.url, meta={KEY: task.key})
        response = Response(task.url, body=b"<p>", request=request)
        assert [part async for part in CommitMiddleware(crawler).process_spider_output(response, result())] == []  # type: ignore[arg-type]

    asyncio.run(drain())


def test_a_page_over_its_budget_costs_itself_alone(tmp_path: Path) -> None:
    stored = SqliteFrontier(tmp_path / "f.sqlite")
    stored.add([Task("http://a.example/1"), Task("http://a.example/2")])
    _answered(WatchedFrontier(stored, "f.sqlite"), SlowPage("slow"))
    assert stored.failures() == {"too slow": 1}
    assert (stored.counts()["waiting"], stored.counts()["items"]) == (1, 0)


def test_a_picture_that_cannot_be_stored_does_not_cost_its_page(tmp_path: Path) -> None:
    stored = SqliteFrontier(tmp_path / "f.sqlite")
    stored.add([Task("http://a.example/1")])
    watched = WatchedFrontier(stored, "f.sqlite")
    _answered(watched, StorageFault("pictures/ab: expected room for a picture, found: No space left on device"))
    assert "No space left" in str(watched.fault)
    assert (stored.counts()["leased"], stored.failures()) == (1, {})
