"""Scrapy's scheduler over a durable frontier, and the spider middleware that commits a page as one transaction."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Any
from urllib.parse import urlsplit

from scrapy import Request, Spider
from scrapy.core.scheduler import BaseScheduler
from scrapy.crawler import Crawler
from scrapy.exceptions import DownloadCancelledError, IgnoreRequest
from scrapy.http import Response
from scrapy.spidermiddlewares.httperror import HttpError
from scrapy.statscollectors import StatsCollector
from twisted.python.failure import Failure

from crawler.fetch.frontier import FULL, FailFastFrontier, Outcome, Task, task_key
from crawler.fetch.item_images import Picture
from crawler.items import RawItem
from crawler.page.time_limit import SlowPage
from metric_base.errors import StorageError

#: Name of the key of the task in the meta of a request.
KEY = "frontier_key"

#: Name of the setting with the number of new items after which a crawl ends; 0: no limit.
LIMIT_SETTING = "METRIC_TREE_LIMIT"

#: Maximum number of addresses that a spider stores (about 20 MB); the frontier stores all.
MAX_REMEMBERED_URLS = 100_000

#: Prefix of the counters of a site: host and name follow.
SITES = "metric_tree/sites/"

#: Set when a failure is committed, because Scrapy passes the empty output of the errback to the spider middlewares.
_SETTLED = "frontier_settled"

#: Keys of the meta of a request that are stored: counters of Scrapy's middlewares, and values of spiders.
_LASTING = ("depth", "retry_times", "redirect_times", "redirect_urls", "bans", "item")


def frontier_of(crawler: Crawler) -> FailFastFrontier:
    """Return the frontier of a crawler, which is an attribute, because a setting would be deep-copied."""
    frontier: FailFastFrontier = crawler.frontier
    return frontier


def close_crawl(crawler: Crawler, reason: str) -> None:
    """End a running crawl after its requests in flight."""
    from scrapy.utils.defer import deferred_from_coro

    if crawler.engine is not None and crawler.engine.spider is not None:
        deferred_from_coro(crawler.engine.close_spider_async(reason=reason))


class FrontierScheduler(BaseScheduler):
    """Take requests from the frontier and return them to it; no request waits in memory."""

    def __init__(self, frontier: FailFastFrontier) -> None:
        self._frontier = frontier
        self._spider: Spider | None = None

    @classmethod
    def from_crawler(cls, crawler: Crawler) -> FrontierScheduler:
        """Return the scheduler for the frontier of the crawler."""
        return cls(frontier_of(crawler))

    def open(self, spider: Spider) -> None:
        """Store the spider, whose methods the tasks name."""
        self._spider = spider

    def has_pending_requests(self) -> bool:
        """Return True if a task waits or is leased by a worker."""
        return not self._frontier.is_exhausted()

    def enqueue_request(self, request: Request) -> bool:
        """Add a request to the frontier; a leased one (redirect, retry) is returned to it."""
        task = _task(request)
        if task.key:
            self._frontier.put_back(task)
            return True
        return self._frontier.add([task]) == 1

    def next_request(self) -> Request | None:
        """Return the request of the next task, or None."""
        task = self._frontier.lease()
        if task is None:
            return None
        meta = dict(task.meta) | {KEY: task.key}
        return Request(
            task.url,
            callback=getattr(self._spider, task.callback),
            errback=self._commit_failure,
            meta=meta,
            priority=task.priority,
            dont_filter=True,  # the frontier returns a task once
        )

    def _commit_failure(self, failure: Failure) -> None:
        request: Request = failure.request
        if isinstance(failure.value, OSError) and failure.value.errno in FULL:
            self._frontier.fail(failure.value)  # the disk of the cache is full
            return
        reason = _reason(failure.value)
        request.meta[_SETTLED] = True
        self._frontier.commit(Outcome(request.meta[KEY], failure=reason))
        if self._spider is not None:
            _count(self._spider.crawler.stats, f"failed/{reason}", 1, request.url)


class CommitMiddleware:
    """Commit the items, links and completion of a page in one transaction."""

    def __init__(self, crawler: Crawler) -> None:
        self._frontier = frontier_of(crawler)
        self._crawler = crawler
        self._stats = crawler.stats
        self._limit = crawler.settings.getint(LIMIT_SETTING)
        self._accepted = 0

    @classmethod
    def from_crawler(cls, crawler: Crawler) -> CommitMiddleware:
        """Return the middleware of a crawler."""
        return cls(crawler)

    async def process_spider_output(self, response: Response, result: AsyncIterator[Any]) -> AsyncIterator[Any]:
        """Collect the output of a page and commit it; the scheduler takes the links from the frontier."""
        items: list[tuple[str, str]] = []
        pictures: list[tuple[str, str]] = []
        tasks: list[Task] = []
        failure = None
        self._count("bytes", len(response.body), response.url)
        try:
            async for part in result:
                if isinstance(part, Request):
                    tasks.append(_task(part, depth=response.meta.get("depth", 0) + 1))
                elif isinstance(part, RawItem):
                    items.append((part.identity, part.line()))
                elif isinstance(part, Picture):
                    pictures.append((part.identity, part.line()))
                else:
                    self._count(f"dropped/{part}", 1, response.url)
        except StorageError as error:
            self._frontier.fail(error)
        except Exception as error:  # noqa: BLE001 - any error of the reader fails the page and not the crawl
            failure = "too slow" if isinstance(error, SlowPage) else f"unreadable: {type(error).__name__}"
            items, pictures, tasks = [], [], []
        if KEY in response.meta and not response.meta.get(_SETTLED) and self._frontier.error is None:
            max_items = max(self._limit - self._accepted, 0) if self._limit else None
            outcome = Outcome(response.meta[KEY], items, tasks, failure, pictures, max_items)
            # only requests for the image of an item have an item
            self._commit(outcome, "item" in response.meta, response.url)
        if False:  # Scrapy needs an asynchronous generator
            yield

    def _commit(self, outcome: Outcome, is_image: bool, url: str) -> None:
        """Commit and count a page, and end the crawl at its limit of items."""
        new = self._frontier.commit(outcome)
        if self._frontier.error is not None:
            return
        known: set[str] | None = getattr(self._crawler.spider, "known", None)
        if outcome.failure is not None:
            self._count(f"failed/{outcome.failure}", 1, url)
        elif known is not None:
            if len(known) > MAX_REMEMBERED_URLS:
                known.clear()
            known.update(task.url for task in outcome.tasks)
        if is_image:
            self._count("pictures", new, url)
            return
        self._count("items", new, url)
        if outcome.is_whole(new):  # the rest is not a duplicate: a resumed crawl fetches the page again
            self._count("dropped/duplicate", len(outcome.items) - new, url)
        self._count("pages", 1, url)
        before, self._accepted = self._accepted, self._accepted + new
        if before < self._limit <= self._accepted:
            close_crawl(self._crawler, "limit")

    def _count(self, name: str, count: int, url: str) -> None:
        _count(self._stats, name, count, url)


def _count(stats: StatsCollector | None, name: str, count: int, url: str) -> None:
    """Increase a counter of the crawl and of the site of an address."""
    if count and stats is not None:
        stats.inc_value(f"metric_tree/{name}", count)
        stats.inc_value(f"{SITES}{urlsplit(url).hostname}/{name}", count)


def _task(request: Request, depth: int | None = None) -> Task:
    meta = {name: request.meta[name] for name in _LASTING if name in request.meta}
    if depth is not None:
        meta["depth"] = depth
    callback = getattr(request.callback, "__name__", None) or "parse"
    key = request.meta.get(KEY, "") if depth is None else ""
    return Task(
        request.url, callback, meta, request.priority, key or ("" if depth is None else task_key(request.url, callback))
    )


def _reason(error: BaseException) -> str:
    if isinstance(error, HttpError):
        return f"http {error.response.status}"
    # Scrapy cancels responses that are too large, and ignores those that are too large after decompression
    if isinstance(error, DownloadCancelledError) or str(error).startswith("Ignored response"):
        return "too large"
    if isinstance(error, IgnoreRequest):
        return str(error).split(":")[0] or "ignored"
    return type(error).__name__
