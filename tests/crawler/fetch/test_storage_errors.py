"""Full disks and lost servers: nothing half-written, one line, exit 2, and a crawl that continues from there."""

from __future__ import annotations

import asyncio
import resource
import shutil
import signal
import subprocess
import time
from collections.abc import AsyncIterator, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from scrapy import Request
from scrapy.http import Response

from crawler.fetch.frontier import FailFastFrontier, Outcome, Task
from crawler.fetch.redis_frontier import RedisFrontier
from crawler.fetch.scheduler import KEY, CommitMiddleware
from crawler.fetch.sqlite_frontier import SqliteFrontier, stored_counts
from crawler.items import RawItem
from crawler.page.time_limit import SlowPage
from metric_base.errors import StorageError
from tests.crawler.conftest import RedisServer
from tests.crawler.fetch.test_crawl_errors import ROOT, items, words
from tests.support.processes import started
from tests.synthetic.synthetic_site import Shop, SyntheticSite


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
    watched = FailFastFrontier(frontier, "f.sqlite")
    ended: list[bool] = []
    watched.on_error = lambda: ended.append(True)
    assert watched.commit(Outcome(task.key, many)) == 0
    assert "f.sqlite: expected a frontier that can be read and written, found: database or disk is full" in str(
        watched.error
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
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True, check=False, timeout=300).returncode:
        pytest.skip("mounting a small disk is not allowed here (needs root)")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=False, timeout=300)


@pytest.mark.slow
@pytest.mark.parametrize("more", [[], ["--pictures"]], ids=["pages", "pictures"])
def test_a_crawl_on_a_full_disk_ends_with_one_line(small_disk: Path, more: list[str]) -> None:
    filler = small_disk / "filler"
    filler.write_bytes(b"0" * 560_000)
    with SyntheticSite(Shop(products=300, errors=False)) as site:
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

    with SyntheticSite(Shop(products=300, errors=False)) as site:
        start = ["--private", "--start-url", f"{site.base}/list/0"]
        done = subprocess.run(
            words("generic", tmp_path / "out", *start),
            cwd=ROOT, capture_output=True, text=True, timeout=180, check=False, preexec_fn=bounded,
        )  # fmt: skip
        assert (done.returncode, done.stderr.count("\n"), done.stdout) == (2, 1, ""), done.stderr
        assert "frontier.sqlite: expected a frontier that can be read and written" in done.stderr


@pytest.mark.slow
def test_a_crawl_whose_server_is_stopped_ends_with_one_line_and_goes_on_when_it_is_started(
    tmp_path: Path, redis_server: RedisServer
) -> None:
    import redis

    out = tmp_path / "out"
    with SyntheticSite(Shop(products=150, errors=False, delay=0.5)) as site:
        more = ["--private", "--redis", redis_server.url, "--worker", "one"]
        begin = words("generic", out, *more, "--start-url", f"{site.base}/list/0")
        server = redis.Redis.from_url(redis_server.url, socket_timeout=60)
        with started(begin, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            end = time.monotonic() + 120
            while int(server.hget("metric-tree:out:done", "pages") or 0) < 20:
                assert time.monotonic() < end
                time.sleep(0.05)
            redis_server.stop(keep=True)
            site.shop = replace(site.shop, delay=0.0)
            output, message = process.communicate()
        assert (process.returncode, message.count("\n"), output) == (2, 1, ""), message
        assert f"{redis_server.url}: expected a frontier that can be read and written" in message
        assert 0 < stored_counts(out / "one" / "frontier.sqlite")["items"] < 150
        redis_server.start()
        again = words("generic", out, *more, "--resume", "--json")
        held = server.zrange("metric-tree:out:leases", 0, -1)
        if held:  # their time is up; nobody need wait for it here
            server.zadd("metric-tree:out:leases", dict.fromkeys(held, 0))
        done = subprocess.run(again, cwd=ROOT, capture_output=True, text=True, timeout=180, check=False)
    lines = [line for path in out.rglob("items-*.jsonl") for line in path.read_text().splitlines()]
    assert (done.returncode, len(lines), len(set(lines))) == (0, 150, 150), done.stderr


def test_a_server_that_comes_back_without_its_data_does_not_end_a_crawl_as_done(
    tmp_path: Path, redis_server: RedisServer
) -> None:
    frontier = RedisFrontier(redis_server.url, "crawl", tmp_path)
    watched = FailFastFrontier(frontier, redis_server.url)
    frontier.remember({"start": ["http://a.example/1"]})
    watched.add([Task(f"http://a.example/{number}") for number in range(3)])
    task = watched.lease()
    assert task is not None
    redis_server.stop()
    redis_server.start()
    watched.commit(Outcome(task.key, [("shop:1", "{}")]))
    assert (watched.lease(), watched.is_exhausted()) == (None, True)
    assert "has lost them; --resume" in str(watched.error)
    assert [line for _, line in frontier.lines()] == ["{}"]  # pages that were read are kept


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


def _answered(frontier: FailFastFrontier, error: Exception) -> None:
    """A page whose reader raises passes through the middleware that commits pages."""

    async def result() -> AsyncIterator[Any]:
        yield RawItem(source="shop", source_id="1")
        raise error

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
    _answered(FailFastFrontier(stored, "f.sqlite"), SlowPage("slow"))
    counts = stored.counts()
    assert (counts["waiting"], counts["failed"], counts["items"]) == (1, 1, 0)
    assert stored.reopen("too slow") == 1


def test_a_picture_that_cannot_be_stored_does_not_cost_its_page(tmp_path: Path) -> None:
    stored = SqliteFrontier(tmp_path / "f.sqlite")
    stored.add([Task("http://a.example/1")])
    watched = FailFastFrontier(stored, "f.sqlite")
    _answered(watched, StorageError("pictures/ab: expected space for an image, found: No space left on device"))
    assert "No space left" in str(watched.error)
    assert (stored.counts()["leased"], stored.counts()["failed"]) == (1, 0)
