"""Manners and safety of a crawl: the settings, the guard on addresses, the pause on a ban."""

from __future__ import annotations

import re
import time
from email.utils import parsedate_to_datetime
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from scrapy import Request, Spider
from scrapy.crawler import Crawler
from scrapy.exceptions import IgnoreRequest
from scrapy.http import Response, TextResponse
from scrapy.robotstxt import ProtegoRobotParser
from scrapy.settings import default_settings

from crawler.fetch import DELAY_SECONDS
from crawler.fetch.addresses import REFUSED, is_literal, is_public
from crawler.fetch.frontier import OFF_SITE, PRIVATE
from crawler.page.page import MAXIMUM_BYTES

__all__ = ["BanMiddleware", "BoundedRobotParser", "GuardMiddleware", "RefusedHostMiddleware", "settings", "user_agent"]

#: Scrapy gave this setting another name.
_RESOLVER_SETTING = "TWISTED_DNS_RESOLVER" if hasattr(default_settings, "TWISTED_DNS_RESOLVER") else "DNS_RESOLVER"

#: A download that takes longer is a trap or a dead server; half a minute serves any honest page.
DOWNLOAD_SECONDS = 30

#: An address so many links deep is a trap; a category of a hundred listing pages, each behind the last, is not.
DEEPEST_LINK = 120

#: First pause after a ban, doubled with each further one up to the longest; so many in a row end the crawl.
BAN_SECONDS, LONGEST_BAN_SECONDS, MOST_BANS = 30.0, 1800.0, 6

#: RFC 9309: at least 500 KiB of robots.txt are read. Longest date of a `Retry-After`.
ROBOTS_BYTES, LONGEST_DATE = 500 * 1024, 64

#: What a page says instead of its product when the site takes us for a robot.
_BAN_PAGE = re.compile(
    rb"captcha|robot check|are you a (?:human|robot)|unusual traffic|access denied|verify you are human"
    rb"|automated access",
    re.IGNORECASE,
)
#: A ban page is short; a product page that mentions captchas is not.
BAN_PAGE_BYTES = 20_000


def user_agent(contact: str) -> str:
    """Who we are and how to reach us."""
    return f"metric-tree/1 (object sizes for research; {contact})"


def settings(
    *, contact: str, cache: Path | None = None, private: bool = False, delay: float = DELAY_SECONDS
) -> dict[str, Any]:
    """Scrapy's settings for a crawl that may be left alone.

    Parameters
    ----------
    contact : an address or a page where a site's owner reaches whoever crawls.
    cache : folder of the HTTP cache; pages are asked for again only if they changed (RFC 9111, conditional requests).
    private : whether addresses of this machine and its network may be fetched (tests, a mirror).
    delay : seconds between two requests to one site, where AutoThrottle does not ask for more.
    """
    guards = {
        "crawler.fetch.settings.GuardMiddleware": 40,
        "crawler.fetch.settings.BanMiddleware": 560,
        "crawler.fetch.settings.RefusedHostMiddleware": 570,  # nearer to the download than Scrapy's retries
    }
    own = {
        "METRIC_TREE_PRIVATE": private,
        "SCHEDULER": "crawler.fetch.scheduler.FrontierScheduler",
        "SPIDER_MIDDLEWARES": {"crawler.fetch.scheduler.CommitMiddleware": 10},
        # The guard knows redirects and addresses that Scrapy's own off-site filter does not.
        "DOWNLOADER_MIDDLEWARES": {**guards, "scrapy.downloadermiddlewares.offsite.OffsiteMiddleware": None},
        **({} if private else {_RESOLVER_SETTING: "crawler.fetch.addresses.PublicResolver"}),
        "EXTENSIONS": {"scrapy.extensions.telnet.TelnetConsole": None, "scrapy.extensions.memusage.MemoryUsage": None},
    }
    manners = {
        "ROBOTSTXT_OBEY": True,
        "ROBOTSTXT_PARSER": "crawler.fetch.settings.BoundedRobotParser",
        "USER_AGENT": user_agent(contact),
        "AUTOTHROTTLE_ENABLED": delay > 0,
        "AUTOTHROTTLE_START_DELAY": delay,
        "AUTOTHROTTLE_MAX_DELAY": 60.0,
        "DOWNLOAD_DELAY": delay,
        "CONCURRENT_REQUESTS": 16,
        "CONCURRENT_REQUESTS_PER_DOMAIN": 4 if delay > 0 else 16,
        "COOKIES_ENABLED": False,
        "RETRY_TIMES": 3,
        "RETRY_HTTP_CODES": [500, 502, 504, 522, 524, 408],
        "REDIRECT_MAX_TIMES": 6,
    }
    bounds = {
        "DOWNLOAD_TIMEOUT": DOWNLOAD_SECONDS,
        "DOWNLOAD_MAXSIZE": MAXIMUM_BYTES,
        "DOWNLOAD_HANDLERS": dict.fromkeys(("http", "https"), "crawler.fetch.header_limit.HeaderLimitHandler"),
        "DOWNLOAD_WARNSIZE": 0,
        "DEPTH_LIMIT": DEEPEST_LINK,
        "URLLENGTH_LIMIT": 2000,
        "LOG_ENABLED": False,
        "LOGSTATS_INTERVAL": 0,
    }
    cached = {
        "HTTPCACHE_ENABLED": cache is not None,
        "HTTPCACHE_DIR": str(cache or ""),
        "HTTPCACHE_GZIP": True,
        "HTTPCACHE_POLICY": "scrapy.extensions.httpcache.RFC2616Policy",
    }
    return {**own, **manners, **bounds, **cached}


class GuardMiddleware:
    """Refuses what a crawl must not fetch: other sites, other schemes, this machine and its network."""

    def __init__(self, crawler: Crawler) -> None:
        self._private: bool = crawler.settings.getbool("METRIC_TREE_PRIVATE")
        self._crawler = crawler

    @classmethod
    def from_crawler(cls, crawler: Crawler) -> GuardMiddleware:
        """The middleware of a crawler."""
        return cls(crawler)

    def process_request(self, request: Request) -> None:
        """Raise IgnoreRequest where the address is refused; redirects pass here again."""
        parts = urlsplit(request.url)
        host = parts.hostname or ""
        if parts.scheme not in {"http", "https"}:
            raise IgnoreRequest(f"scheme refused: {request.url}")
        spider: Spider | None = self._crawler.spider
        allowed = getattr(spider, "allows", None)
        if allowed is not None and not allowed(request.url):
            raise IgnoreRequest(f"{OFF_SITE}: {request.url}")
        if not self._private and is_literal(host) and not is_public(host):
            raise IgnoreRequest(f"{PRIVATE}: {request.url}")


class RefusedHostMiddleware:
    """Says of a name that leads to an address of this machine or its network what it is: it is not asked again."""

    def process_exception(self, request: Request, exception: Exception) -> None:  # noqa: ARG002 - Scrapy passes it
        """Raise IgnoreRequest where the resolver refused the request's host."""
        if urlsplit(request.url).hostname in REFUSED:
            raise IgnoreRequest(f"{PRIVATE}: {request.url}")


class BanMiddleware:
    """Recognises a ban, counts it, puts the page back and pauses the crawl; gives up after several in a row.

    What was asked for before a ban and is refused as well is the same ban: four requests in flight are not four bans.
    """

    def __init__(self, crawler: Crawler) -> None:
        self._crawler = crawler
        self._in_a_row = 0
        self._refused_at = 0.0

    @classmethod
    def from_crawler(cls, crawler: Crawler) -> BanMiddleware:
        """The middleware of a crawler."""
        return cls(crawler)

    def process_response(self, request: Request, response: Response) -> Response | Request:
        """The response, or the request again where the response is a ban."""
        if not is_ban(response):
            self._in_a_row = 0
            return response
        if self._crawler.stats is not None:
            self._crawler.stats.inc_value("metric_tree/bans")
        now = time.monotonic()
        if self._in_a_row == 0 or now - request.meta.get("download_latency", 0.0) >= self._refused_at:
            self._in_a_row += 1
            self._refused_at = now
            self._pause(_retry_after(response))
        return request.replace(dont_filter=True, priority=request.priority - 1)

    def _pause(self, asked: float | None) -> None:
        from twisted.internet import reactor

        engine = self._crawler.engine
        if engine is None:
            return
        if self._in_a_row > MOST_BANS:
            self._crawler.spider.banned = True
            from scrapy.utils.defer import deferred_from_coro

            deferred_from_coro(engine.close_spider_async(reason="banned"))
            return
        first = self._crawler.settings.getfloat("METRIC_TREE_BAN_SECONDS", BAN_SECONDS)
        # A first refusal that names its end is believed; after that it is our own patience that grows.
        own = first * 2 ** (self._in_a_row - 1)
        seconds = asked if asked is not None and self._in_a_row == 1 else max(asked or 0.0, own)
        seconds = min(seconds, LONGEST_BAN_SECONDS)
        engine.pause()
        reactor.callLater(seconds, engine.unpause)


def is_ban(response: Response) -> bool:
    """Whether a site answers that it takes us for a robot: 429, 503, or a short page with a captcha."""
    if response.status in {429, 503}:
        return True
    short = isinstance(response, TextResponse) and len(response.body) < BAN_PAGE_BYTES
    return short and bool(_BAN_PAGE.search(response.body))


def _retry_after(response: Response) -> float | None:
    """Seconds that a site asks for, stated as such or as a date; None for what is neither."""
    after = (response.headers.get("Retry-After") or b"").strip()[:LONGEST_DATE]
    if after.isdigit():
        return float(after)
    try:
        until = parsedate_to_datetime(after.decode("latin-1")).timestamp()
    except (ValueError, TypeError, OverflowError):
        return None
    return max(0.0, until - time.time())


class BoundedRobotParser(ProtegoRobotParser):
    """The rules of `robots.txt` as far as RFC 9309 asks for them: half a megabyte, cut at a line."""

    @classmethod
    def from_crawler(cls, crawler: Crawler, robotstxt_body: bytes) -> BoundedRobotParser:
        """The parser of a file's bytes."""
        if len(robotstxt_body) > ROBOTS_BYTES:
            robotstxt_body = robotstxt_body[: robotstxt_body.rfind(b"\n", 0, ROBOTS_BYTES) + 1]
        return cls(robotstxt_body, crawler.spider)
