"""A crawl as one call: a frontier, a spider, its manners, and a summary at the end.

A crawl's items on disk: JSON Lines in segments that are written whole, named by the range they hold.

The frontier has the items first (with the page, in one transaction); a segment is written from there under a temporary
name and renamed. A kill between the two costs nothing: the next write begins behind the last whole segment.
"""

from __future__ import annotations

import gc
import os
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias

from crawler.fetch.frontier import OFF_SITE, PRIVATE, FailFastFrontier, Frontier, has_no_result, storage_errors
from crawler.fetch.sqlite_frontier import SqliteFrontier, stored_counts
from crawler.page.urls import web_address
from crawler.sites.registry import GENERIC, SITES, use_site
from crawler.sites.site import Site
from metric_base.errors import InputError
from metric_base.files import whole_file

if TYPE_CHECKING:
    from scrapy import Spider

#: Items of one segment: some megabytes, so that a build streams them and a copy of a crawl is a matter of files.
SEGMENT_ITEMS = 5_000
Kind: TypeAlias = Literal["items", "pictures"]
_NAME = re.compile(r"(?P<kind>items|pictures)-(?P<first>\d{9})-(?P<last>\d{9})\.jsonl")
#: Seconds between two writes of segments: the longest wait for the items of a running crawl.
SEGMENT_SECONDS = 60.0
#: Seconds after which another worker takes up a page, for crawls of sites that answer fast.
LEASE_VARIABLE = "METRIC_TREE_LEASE_SECONDS"
#: Names that `metric-tree crawl` takes; each site has one, Wikidata has its own interface.
SPIDERS = (*(site.name for site in SITES), "wikidata", GENERIC.name)


class _Lines(Protocol):
    def lines(self, after: int = 0, kind: Kind = "items") -> Iterable[tuple[int, str]]: ...


def last_written(folder: Path, kind: Kind = "items") -> int:
    """The number of the last item, or picture, that a whole segment holds."""
    matches = (_NAME.fullmatch(path.name) for path in folder.glob(f"{kind}-*.jsonl"))
    return max((int(match["last"]) for match in matches if match), default=0)


def write_segments(frontier: _Lines, folder: Path) -> int:
    """Write all items and pictures that no segment holds yet; the number of items."""
    _write_kind(frontier, folder, "pictures")
    return _write_kind(frontier, folder, "items")


def _write_kind(frontier: _Lines, folder: Path, kind: Kind) -> int:
    count = 0
    lines = iter(frontier.lines(last_written(folder, kind), kind))
    while batch := list(islice(lines, SEGMENT_ITEMS)):
        span = f"{batch[0][0]:09d}-{batch[-1][0]:09d}"
        _replace(folder / f"{kind}-{span}.jsonl", [line for _, line in batch])
        count += len(batch)
    return count


def _replace(path: Path, lines: list[str]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as work:
        work.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


@dataclass(frozen=True, slots=True, kw_only=True)
class Crawl:
    """What to crawl and where to.

    `site` is the declaration of a site outside the package, `redis` shares the frontier, `worker` keeps workers' items
    apart in `out`.
    """

    spider: str
    out: Path
    start: Sequence[str] = ()
    query: str = ""
    category: str = ""
    limit: int = 0
    resume: bool = False
    pictures: bool = False
    contact: str
    cache: Path | None = None
    private: bool = False
    delay: float | None = None
    redis: str = ""
    worker: str = ""
    site: Path | None = None
    overrides: Mapping[str, Any] = field(default_factory=dict)

    @property
    def folder(self) -> Path:
        """Where this worker's files go."""
        return self.out / self.worker if self.worker else self.out


@dataclass(frozen=True, slots=True)
class Summary:
    """What a crawl did in this run, and what its frontier holds after it."""

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

    @property
    def error(self) -> str | None:
        """Why no items were collected, where that is so; None for a crawl that did its work, or was interrupted."""
        refused = PRIVATE in self.failed
        if self.pages or self.reason == "shutdown" or (self.frontier["done"] and not refused):
            return None
        why = ", ".join(f"{reason} {count}" for reason, count in self.failed.items()) or self.reason
        hint = ": --private allows addresses of this machine and its network" if refused else ""
        return f"expected pages; found none ({why}){hint}"

    def record(self) -> dict[str, Any]:
        """The summary as JSON."""
        rate = self.pages / self.seconds if self.seconds else 0.0
        values = {name: getattr(self, name) for name in self.__slots__}
        return {"schema": "metric-tree/crawl/1", **values, "pages_per_second": round(rate, 2)}


def run_crawl(crawl: Crawl, progress: Callable[[Mapping[str, Any]], None] | None = None) -> Summary:
    """Run a crawl to its end.

    Raises
    ------
    StorageError
        The frontier, a segment or a picture can no longer be written, or the server of a shared frontier is gone.
    InputError
        The folder holds a crawl already and `resume` was not asked for, the spider is unknown, or nothing says where
        to begin. Nothing is written then.
    """
    from scrapy.crawler import CrawlerProcess

    from crawler.fetch.scheduler import LIMIT_SETTING, close_crawl
    from crawler.fetch.settings import settings

    spider = spider_class(crawl.spider, use_site(crawl.site) if crawl.site else None)
    for url in crawl.start:
        web_address(url, "--start-url")
    place = crawl.redis or str(crawl.folder / "frontier.sqlite")
    with storage_errors(place):
        frontier = FailFastFrontier(_frontier(crawl, spider), place)
    delay = getattr(spider, "site", GENERIC).delay_s if crawl.delay is None else crawl.delay
    options = settings(contact=crawl.contact, cache=crawl.cache, private=crawl.private, delay=delay)
    options |= {"LOG_INSTALL_ROOT_HANDLER": False, LIMIT_SETTING: crawl.limit}
    process = CrawlerProcess(options | dict(crawl.overrides))
    crawler = process.create_crawler(spider)
    crawler.frontier = frontier
    frontier.on_error = partial(close_crawl, crawler, "storage")
    started = time.monotonic()
    _heartbeat(frontier, crawl.folder, crawler, progress)
    failures: list[Any] = []
    running = process.crawl(
        crawler, **frontier.origin(), pictures=crawl.folder / "pictures" if crawl.pictures else None
    )
    running.addErrback(failures.append)
    # What the libraries brought along stays; the collector need not walk over it again after every few pages.
    gc.collect()
    gc.freeze()
    process.start()
    gc.unfreeze()
    if failures:
        failures[0].raiseException()
    _write(frontier, crawl.folder)
    summary = _summary(crawler.stats.get_stats(), frontier, time.monotonic() - started)
    frontier.close()
    if frontier.error is not None:
        raise frontier.error
    return summary


def _frontier(crawl: Crawl, spider: Any) -> Any:
    """The crawl's frontier, which knows where to begin; what was refused and may be allowed now waits again."""
    path = crawl.folder / "frontier.sqlite"
    if path.exists() and not crawl.resume and not has_no_result(stored_counts(path)):
        raise InputError(f"{crawl.folder}: expected a free folder, or --resume; found a crawl")
    if not path.exists() and not crawl.redis:
        _expect_free(crawl)
        _origin_of(crawl, spider, {})  # an error is found before a file is made
    frontier = _open_frontier(crawl, path)
    try:
        _begin(frontier, crawl, spider)
    except InputError:
        frontier.close()
        raise
    return frontier


def _expect_free(crawl: Crawl) -> None:
    """See that a folder without a frontier has no file that the crawl would replace."""
    for name in ("items-*", "pictures-*", "pictures"):
        taken = next(crawl.folder.glob(name), None)
        if taken is not None:
            raise InputError(f"--out: expected a folder without a crawl's files, or with its frontier; found {taken}")


def _begin(frontier: Any, crawl: Crawl, spider: Any) -> None:
    before, counts = frontier.origin(), frontier.counts()
    if counts["failed"] and has_no_result(counts):
        before = before if crawl.resume else {}
        frontier.start_over()
    frontier.remember(_origin_of(crawl, spider, before))
    if crawl.resume:
        frontier.reopen(OFF_SITE)
    if crawl.resume and crawl.private:
        frontier.reopen(PRIVATE)


def _origin_of(crawl: Crawl, spider: Any, before: Mapping[str, Any]) -> dict[str, Any]:
    """What the crawl begins with: what is given and, of a crawl that is gone on with, what was given before."""
    begun = {
        "start": list(dict.fromkeys([*crawl.start, *before.get("start", ())])),
        "query": crawl.query or before.get("query", ""),
        "category": crawl.category or before.get("category", ""),
    }
    if not spider.origins(**begun):
        raise InputError(f"{crawl.spider}: expected {spider.required_options()}, to begin with; found none")
    return begun


def _open_frontier(crawl: Crawl, path: Path) -> Any:
    if crawl.redis:
        from crawler.fetch.redis_frontier import LEASE_SECONDS, RedisFrontier

        lease = float(os.environ.get(LEASE_VARIABLE, LEASE_SECONDS))
        return RedisFrontier(crawl.redis, crawl.out.name or "crawl", crawl.folder, lease)
    return SqliteFrontier(path)


def _heartbeat(
    frontier: FailFastFrontier, folder: Path, crawler: Any, progress: Callable[[Mapping[str, Any]], None] | None
) -> None:
    """Once a second the progress, once a minute a segment, while the reactor runs."""
    from scrapy import signals

    running: list[Any] = []

    def begin() -> None:
        from twisted.internet.task import LoopingCall  # asks for the reactor, which Scrapy must have chosen first

        beats: list[tuple[float, Callable[[], object]]] = [(SEGMENT_SECONDS, partial(_write, frontier, folder))]
        if progress is not None:
            beats.append((1.0, lambda: progress(crawler.stats.get_stats() | frontier.counts())))
        for seconds, beat in beats:
            running.append(LoopingCall(beat))
            running[-1].start(seconds, now=False)

    def end() -> None:
        for beat in running:
            beat.stop()

    crawler.signals.connect(begin, signals.spider_opened, weak=False)
    crawler.signals.connect(end, signals.spider_closed, weak=False)


def _write(frontier: FailFastFrontier, folder: Path) -> None:
    frontier.watch(partial(write_segments, frontier, folder), 0)


def _summary(stats: Mapping[str, Any], frontier: Frontier, seconds: float) -> Summary:
    def below(prefix: str) -> dict[str, int]:
        return {name.removeprefix(prefix): value for name, value in stats.items() if name.startswith(prefix)}

    return Summary(
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
        sites=_sites(stats, seconds),
    )


def _sites(stats: Mapping[str, Any], seconds: float) -> dict[str, dict[str, float]]:
    """What was counted by host: pages, items, drops and failures by reason, bytes as unpacked, and the rate."""
    from crawler.fetch.scheduler import SITES

    sites: dict[str, dict[str, float]] = {}
    for name, value in stats.items():
        if name.startswith(SITES):
            host, _, what = name.removeprefix(SITES).partition("/")
            sites.setdefault(host, {})[what] = value
    for counts in sites.values():
        counts["pages_per_second"] = round(counts.get("pages", 0) / seconds, 2) if seconds else 0.0
    return sites


class UnknownSpider(InputError):
    """A name that no spider has."""


def spider_class(name: str, given: Site | None = None) -> type[Spider]:
    """The spider of a name, or of the site of a declaration; Scrapy is loaded only here."""
    if name == "wikidata":
        from crawler.fetch.wikidata_spider import WikidataSpider

        return WikidataSpider
    from crawler.fetch.site_spider import SiteSpider

    for site in (*([given] if given else []), *SITES, GENERIC):
        if site.name == name:
            return type(f"{name.title()}Spider", (SiteSpider,), {"name": name, "site": site})
    known = ", ".join([*([given.name] if given else []), *SPIDERS])
    raise UnknownSpider(f"spider: expected one of {known}; found {name!r}")
