"""Scrapy components of a polite crawl: address guard, ban detection and a bounded robots.txt parser."""

from __future__ import annotations

import re
import time
from email.utils import parsedate_to_datetime
from urllib.parse import urlsplit

from scrapy import Request, Spider
from scrapy.crawler import Crawler
from scrapy.exceptions import IgnoreRequest
from scrapy.http import Response, TextResponse
from scrapy.robotstxt import ProtegoRobotParser

from crawler.fetch.frontier import OFF_SITE, PRIVATE
from crawler.fetch.network_limits import REFUSED, is_literal, is_public

#: First pause after a ban in seconds; it doubles with each further ban.
BAN_SECONDS = 30.0
#: Maximum pause after a ban in seconds.
MAX_BAN_SECONDS = 1800.0
#: Maximum number of consecutive bans that only pause the crawl; the next one ends it.
MAX_BANS = 6
#: Number of bytes of robots.txt that are read; RFC 9309 demands at least 500 KiB.
ROBOTS_BYTES = 500 * 1024
#: Maximum number of characters of the date of a `Retry-After` header.
MAX_DATE = 64
#: Texts of pages for suspected robots.
_BAN_PAGE = re.compile(
    rb"captcha|robot check|are you a (?:human|robot)|unusual traffic|access denied|verify you are human"
    rb"|automated access",
    re.IGNORECASE,
)
#: Maximum size of a ban page in bytes; product pages that mention captchas are larger.
BAN_PAGE_BYTES = 20_000


class GuardMiddleware:
    """Reject requests to other sites, other schemes, this machine and its network."""

    def __init__(self, crawler: Crawler) -> None:
        self._private: bool = crawler.settings.getbool("METRIC_TREE_PRIVATE")
        self._crawler = crawler

    @classmethod
    def from_crawler(cls, crawler: Crawler) -> GuardMiddleware:
        """Return the middleware of a crawler."""
        return cls(crawler)

    def process_request(self, request: Request) -> None:
        """Raise IgnoreRequest for other addresses, also after redirects."""
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
    """Reject names that resolve to an address of this machine or its network, without a retry."""

    def process_exception(self, request: Request, exception: Exception) -> None:  # noqa: ARG002 - Scrapy passes it
        """Raise IgnoreRequest if the resolver refused the host."""
        if urlsplit(request.url).hostname in REFUSED:
            raise IgnoreRequest(f"{PRIVATE}: {request.url}")


class BanMiddleware:
    """Detect and count bans, return their pages to the frontier, and pause the crawl or end it after `MAX_BANS` bans.

    Refused requests that were sent before a ban belong to the same ban: four requests in flight are not four bans.
    """

    def __init__(self, crawler: Crawler) -> None:
        self._crawler = crawler
        self._in_a_row = 0
        self._refused_at = 0.0

    @classmethod
    def from_crawler(cls, crawler: Crawler) -> BanMiddleware:
        """Return the middleware of a crawler."""
        return cls(crawler)

    def process_response(self, request: Request, response: Response) -> Response | Request:
        """Return the response, or the request if the response is a ban."""
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

    def _pause(self, requested: float | None) -> None:
        """Pause the crawl for the requested or default time, or end it."""
        from twisted.internet import reactor

        engine = self._crawler.engine
        if engine is None:
            return
        if self._in_a_row > MAX_BANS:
            self._crawler.spider.banned = True
            from scrapy.utils.defer import deferred_from_coro

            deferred_from_coro(engine.close_spider_async(reason="banned"))
            return
        first = self._crawler.settings.getfloat("METRIC_TREE_BAN_SECONDS", BAN_SECONDS)
        # the header determines the pause of the first ban; the default pause doubles with each further ban
        default = first * 2 ** (self._in_a_row - 1)
        seconds = max(requested or 0.0, default) if requested is None or self._in_a_row > 1 else requested
        seconds = min(seconds, MAX_BAN_SECONDS)
        engine.pause()
        reactor.callLater(seconds, engine.unpause)


def is_ban(response: Response) -> bool:
    """Return True if a response is a ban of robots: status 429 or 503, or a short page with a captcha."""
    if response.status in {429, 503}:
        return True
    short = isinstance(response, TextResponse) and len(response.body) < BAN_PAGE_BYTES
    return short and bool(_BAN_PAGE.search(response.body))


def _retry_after(response: Response) -> float | None:
    """Return the seconds of a `Retry-After` header, a number or a date; None for other values."""
    after = (response.headers.get("Retry-After") or b"").strip()[:MAX_DATE]
    if after.isdigit():
        return float(after)
    try:
        until = parsedate_to_datetime(after.decode("latin-1")).timestamp()
    except (ValueError, TypeError, OverflowError):
        return None
    return max(0.0, until - time.time())


class BoundedRobotParser(ProtegoRobotParser):
    """Rules of `robots.txt`, limited to the size that RFC 9309 demands and cut at a line."""

    @classmethod
    def from_crawler(cls, crawler: Crawler, robotstxt_body: bytes) -> BoundedRobotParser:
        """Return the parser of the bytes of a file."""
        if len(robotstxt_body) > ROBOTS_BYTES:
            robotstxt_body = robotstxt_body[: robotstxt_body.rfind(b"\n", 0, ROBOTS_BYTES) + 1]
        return cls(robotstxt_body, crawler.spider)
