"""Run a crawl: frontier, spider and settings, segments of raw items on disk, and a summary at the end.

The frontier stores the items of a page in the transaction that marks the page as done. Segments (JSON Lines, named by
the range of their items) are written from the frontier to a temporary file that is renamed. After a kill between the
two, the next write continues behind the last complete segment.
"""

from __future__ import annotations

import gc
import os
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from crawler.fetch.frontier import OFF_SITE, PRIVATE, FailFastFrontier, has_no_result, storage_errors
from crawler.fetch.sqlite_frontier import SqliteFrontier, stored_counts
from crawler.page.urls import web_address
from crawler.sites.registry import GENERIC, SITES, use_site
from crawler.sites.site import Site
from metric_base.errors import InputError
from metric_base.files import whole_file

if TYPE_CHECKING:
    from scrapy import Spider

#: Number of items of a segment: a few megabytes, so that a build can stream them.
SEGMENT_ITEMS = 5_000
#: Seconds between two writes of segments.
SEGMENT_SECONDS = 60.0
Kind: TypeAlias = Literal["items", "pictures"]
_SEGMENT = re.compile(r"(?P<kind>items|pictures)-(?P<first>\d{9})-(?P<last>\d{9})\.jsonl")
#: Seconds between two reports of the progress, and two renewals of leases.
TICK_SECONDS = 1.0
#: Environment variable: seconds without a renewal after which another worker fetches a leased page.
LEASE_VARIABLE = "METRIC_TREE_LEASE_SECONDS"
#: Names of the spiders: one per site, and the query service of Wikidata.
SPIDERS = (*(site.name for site in SITES), "wikidata", GENERIC.name)


class UnknownSpider(InputError):
    """No spider has this name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Crawl:
    """Options of a crawl."""

    spider: str  #: One of `SPIDERS`, or the name of the site of `site`.
    out: Path
    start: Sequence[str] = ()  #: Start addresses.
    query: str = ""
    category: str = ""
    limit: int = 0  #: Number of new items after which the crawl ends; 0: no limit.
    resume: bool = False
    pictures: bool = False
    contact: str
    cache: Path | None = None
    private: bool = False  #: Whether addresses of this machine and its network are allowed.
    delay: float | None = None  #: Seconds between two requests to a site; None: as declared.
    redis: str = ""  #: Address of the server of a shared frontier.
    worker: str = ""  #: Name of a worker of a shared crawl, whose files are in a folder of this name.
    site: Path | None = None  #: Declaration of a site outside of the package.
    overrides: Mapping[str, Any] = field(default_factory=dict)  #: Settings of Scrapy.

    @property
    def folder(self) -> Path:
        """Folder of the files of this worker."""
        return self.out / self.worker if self.worker else self.out


@dataclass(frozen=True, slots=True)
class Summary:
    """Counts of a run of a crawl, and the state of its frontier afterwards."""

    reason: str
    seconds: float
    pages: int
    items: int
    pictures: int
    bytes: int
    bans: int
    dropped: Mapping[str, int]
    failed: Mapping[str, int]
    frontier: Mapping[str, int]
    sites: Mapping[str, Mapping[str, float]]

    @classmethod
    def from_stats(cls, stats: Mapping[str, Any], frontier: FailFastFrontier, seconds: float) -> Summary:
        """Return the summary of Scrapy's statistics.

        `sites` has by host the pages, items, bytes as unpacked, drops and failures by reason, and the rate.
        """
        from crawler.fetch.scheduler import SITES

        def below(prefix: str) -> dict[str, int]:
            return {name.removeprefix(prefix): value for name, value in stats.items() if name.startswith(prefix)}

        sites: dict[str, dict[str, float]] = {}
        for name, value in below(SITES).items():
            host, _, counter = name.partition("/")
            sites.setdefault(host, {})[counter] = value
        for counts in sites.values():
            counts["pages_per_second"] = round(counts.get("pages", 0) / seconds, 2) if seconds else 0.0
        return cls(
            reason=str(stats.get("finish_reason", "unknown")),
            seconds=round(seconds, 3),
            pages=int(stats.get("metric_tree/pages", 0)),
            items=int(stats.get("metric_tree/items", 0)),
            pictures=int(stats.get("metric_tree/pictures", 0)),
            bytes=int(stats.get("downloader/response_bytes", 0)),
            bans=int(stats.get("metric_tree/bans", 0)),
            dropped=below("metric_tree/dropped/"),
            failed=below("metric_tree/failed/"),
            frontier=frontier.counts(),
            sites=sites,
        )

    @property
    def error(self) -> str | None:
        """Reason why no pages were collected; None for a crawl that worked or was interrupted."""
        refused = PRIVATE in self.failed
        if self.pages or self.reason == "shutdown" or (self.frontier["done"] and not refused):
            return None
        reasons = ", ".join(f"{reason} {count}" for reason, count in self.failed.items()) or self.reason
        hint = ": --private allows addresses of this machine and its network" if refused else ""
        return f"expected pages; found none ({reasons}){hint}"

    def record(self) -> dict[str, Any]:
        """Return the summary as JSON."""
        rate = self.pages / self.seconds if self.seconds else 0.0
        values = {name: getattr(self, name) for name in self.__slots__}
        return {"schema": "metric-tree/crawl/1", **values, "pages_per_second": round(rate, 2)}


def run_crawl(crawl: Crawl, progress: Callable[[Mapping[str, Any]], None] | None = None) -> Summary:
    """Run a crawl to its end.

    Parameters
    ----------
    crawl : Crawl
    progress : callable, optional
        Called once per second with the statistics of Scrapy and the counts of the frontier.

    Raises
    ------
    StorageError
        The frontier, a segment or an image cannot be written, or the server of a shared frontier is gone.
    InputError
        The folder contains a crawl and `resume` is not set, the spider is unknown, or there is no start address.
        Nothing is written then.
    """
    from scrapy.crawler import CrawlerProcess

    from crawler.fetch.scheduler import LIMIT_SETTING, close_crawl
    from crawler.fetch.settings import crawl_settings

    spider = spider_class(crawl.spider, use_site(crawl.site) if crawl.site else None)
    for url in crawl.start:
        web_address(url, "--start-url")
    place = crawl.redis or str(crawl.folder / "frontier.sqlite")
    with storage_errors(place):
        frontier = FailFastFrontier(open_frontier(crawl, spider), place)
    delay = getattr(spider, "site", GENERIC).delay_s if crawl.delay is None else crawl.delay
    options = crawl_settings(contact=crawl.contact, cache=crawl.cache, private=crawl.private, delay=delay)
    options |= {"LOG_INSTALL_ROOT_HANDLER": False, LIMIT_SETTING: crawl.limit}
    process = CrawlerProcess(options | dict(crawl.overrides))
    crawler = process.create_crawler(spider)
    crawler.frontier = frontier
    frontier.on_error = partial(close_crawl, crawler, "storage")
    started = time.monotonic()
    _start_timers(frontier, crawl.folder, crawler, progress)
    failures: list[Any] = []
    images = crawl.folder / "pictures" if crawl.pictures else None
    running = process.crawl(crawler, **frontier.origin(), pictures=images)
    running.addErrback(failures.append)
    # the objects of imported libraries stay; without this the collector examines them after every few pages
    gc.collect()
    gc.freeze()
    process.start()
    gc.unfreeze()
    if failures:
        failures[0].raiseException()
    frontier.call_or(0, partial(write_segments, frontier, crawl.folder))
    summary = Summary.from_stats(crawler.stats.get_stats(), frontier, time.monotonic() - started)
    frontier.close()
    if frontier.error is not None:
        raise frontier.error
    return summary


def spider_class(name: str, given: Site | None = None) -> type[Spider]:
    """Return the spider of a name, or of the site of a declaration; only this function imports Scrapy."""
    if name == "wikidata":
        from crawler.fetch.wikidata_spider import WikidataSpider

        return WikidataSpider
    from crawler.fetch.site_spider import SiteSpider

    for site in (*([given] if given else []), *SITES, GENERIC):
        if site.name == name:
            return type(f"{name.title()}Spider", (SiteSpider,), {"name": name, "site": site})
    known = ", ".join([*([given.name] if given else []), *SPIDERS])
    raise UnknownSpider(f"spider: expected one of {known}; found {name!r}")


def open_frontier(crawl: Crawl, spider: Any) -> Any:
    """Open the frontier of a crawl and store its start addresses.

    A crawl that ended without a page is started over. With `resume`, tasks that were refused because of an option
    that is now different wait again.

    Raises
    ------
    InputError
        The folder contains a crawl and `resume` is not set, or files that the crawl would replace; or there is no start
        address.
    """
    path = crawl.folder / "frontier.sqlite"
    if path.exists() and not crawl.resume and not has_no_result(stored_counts(path)):
        raise InputError(f"{crawl.folder}: expected a free folder, or --resume; found a crawl")
    if not path.exists() and not crawl.redis:
        for pattern in ("items-*", "pictures-*", "pictures"):
            for file in crawl.folder.glob(pattern):
                raise InputError(
                    f"--out: expected a folder without the files of a crawl, or with its frontier; found {file}"
                )
        _origin(crawl, spider, {})  # raises an error before a file is created
    frontier: Any
    if crawl.redis:
        from crawler.fetch.redis_frontier import LEASE_SECONDS, RedisFrontier

        lease = float(os.environ.get(LEASE_VARIABLE, LEASE_SECONDS))
        frontier = RedisFrontier(crawl.redis, crawl.out.name or "crawl", crawl.folder, lease)
    else:
        frontier = SqliteFrontier(path)
    try:
        before, counts = frontier.origin(), frontier.counts()
        if counts["failed"] and has_no_result(counts):
            before = before if crawl.resume else {}
            frontier.start_over()
        frontier.remember(_origin(crawl, spider, before))
    except InputError:
        frontier.close()
        raise
    if crawl.resume:
        frontier.reopen(OFF_SITE)
    if crawl.resume and crawl.private:
        frontier.reopen(PRIVATE)
    return frontier


def _origin(crawl: Crawl, spider: Any, before: Mapping[str, Any]) -> dict[str, Any]:
    """Return the start addresses, query and category of a crawl, completed by the stored ones of a resumed crawl."""
    origin = {
        "start": list(dict.fromkeys([*crawl.start, *before.get("start", ())])),
        "query": crawl.query or before.get("query", ""),
        "category": crawl.category or before.get("category", ""),
    }
    if not spider.origins(**origin):
        raise InputError(f"{crawl.spider}: expected {spider.required_options()}, to begin with; found none")
    return origin


def last_written(folder: Path, kind: Kind = "items") -> int:
    """Return the number of the last item (or image) in a complete segment."""
    matches = (_SEGMENT.fullmatch(path.name) for path in folder.glob(f"{kind}-*.jsonl"))
    return max((int(match["last"]) for match in matches if match), default=0)


def write_segments(frontier: Any, folder: Path) -> int:
    """Write all items and images that no segment contains yet; return the number of items."""
    count = 0
    kinds: tuple[Kind, ...] = ("pictures", "items")
    for kind in kinds:
        count = 0
        lines = iter(frontier.lines(last_written(folder, kind), kind))
        while batch := list(islice(lines, SEGMENT_ITEMS)):
            folder.mkdir(parents=True, exist_ok=True)
            with whole_file(folder / f"{kind}-{batch[0][0]:09d}-{batch[-1][0]:09d}.jsonl") as work:
                work.write_text("".join(f"{line}\n" for _, line in batch), encoding="utf-8")
            count += len(batch)
    return count


def _start_timers(
    frontier: FailFastFrontier, folder: Path, crawler: Any, progress: Callable[[Mapping[str, Any]], None] | None
) -> None:
    """While the reactor runs, renew leases and report progress once per second, and write segments once per minute."""
    from scrapy import signals

    running: list[Any] = []

    def begin() -> None:
        from twisted.internet.task import LoopingCall  # imports the reactor, which Scrapy must have chosen before

        def write() -> None:
            frontier.call_or(0, partial(write_segments, frontier, folder))

        timers: list[tuple[float, Callable[[], object]]] = [(SEGMENT_SECONDS, write), (TICK_SECONDS, frontier.renew)]
        if progress is not None:
            timers.append((TICK_SECONDS, lambda: progress(crawler.stats.get_stats() | frontier.counts())))
        for seconds, call in timers:
            running.append(LoopingCall(call))
            running[-1].start(seconds, now=False)

    def end() -> None:
        for timer in running:
            timer.stop()

    crawler.signals.connect(begin, signals.spider_opened, weak=False)
    crawler.signals.connect(end, signals.spider_closed, weak=False)
