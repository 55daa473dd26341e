"""Rules of a site for a crawl, and their maximum size."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import pytest
import scrapy
from scrapy.settings import Settings
from twisted.internet.defer import ensureDeferred, succeed
from twisted.internet.testing import StringTransport
from twisted.web._newclient import Request
from twisted.web.http_headers import Headers

from crawler.fetch import network_limits
from crawler.fetch.middlewares import BoundedRobotParser
from crawler.fetch.network_limits import HeaderLimitFactory
from crawler.fetch.settings import crawl_settings
from crawler.sites.registry import GENERIC

# Published values, written out so that a changed rule fails a test.
HEADER_BYTES = 256 * 1024
ROBOTS_BYTES = 500 * 1024


@pytest.mark.parametrize(("chosen", "seconds"), [({}, 1.0), ({"delay": 0.4}, 0.4)])
def test_the_declared_delay_is_the_minimum_between_two_requests(chosen: dict[str, float], seconds: float) -> None:
    """One second by default; Scrapy would multiply it by a random number from 0.5 to 1.5."""
    settings = crawl_settings(contact="tests@example.org", **chosen)
    assert settings["DOWNLOAD_DELAY"] == seconds
    assert settings["RANDOMIZE_DOWNLOAD_DELAY"] is False
    assert settings["AUTOTHROTTLE_ENABLED"]
    assert GENERIC.delay_s == 1.0


@pytest.mark.parametrize(("delay", "waits"), [(0.4, [0.8]), (0.0, [])])
def test_a_request_waits_for_the_moment_that_the_workers_reserve(
    monkeypatch: pytest.MonkeyPatch, delay: float, waits: list[float]
) -> None:
    found: list[float] = []
    monkeypatch.setattr(network_limits, "deferLater", lambda _, seconds: found.append(seconds) or succeed(None))
    monkeypatch.setattr(network_limits.HTTP11DownloadHandler, "download_request", lambda _, request: succeed(request))
    monkeypatch.setattr(network_limits.HTTP11DownloadHandler, "__init__", lambda *_: None)
    monkeypatch.setattr(network_limits.HTTP11DownloadHandler, "_pool", SimpleNamespace(), raising=False)
    frontier = SimpleNamespace(reserve=lambda host, seconds: 2 * seconds if host == "a.example" else 0.0)
    settings = Settings(crawl_settings(contact="tests@example.org", delay=delay))
    crawler: Any = SimpleNamespace(frontier=frontier, settings=settings)
    handler = network_limits.LimitedHandler(crawler)
    for url in ("http://a.example/1", "http://b.example/1"):
        done = ensureDeferred(handler.download_request(scrapy.Request(url)))
        assert done.result.url == url
    assert found == waits


def test_a_crawl_has_the_components_of_scrapy_that_it_needs_and_no_others() -> None:
    """A component that Scrapy renames would be missing without a message."""
    settings = crawl_settings(contact="tests@example.org")
    extensions = {name.rpartition(".")[2] for name in settings["EXTENSIONS_BASE"]}
    middlewares = {name.rpartition(".")[2] for name in settings["DOWNLOADER_MIDDLEWARES_BASE"]}
    assert extensions == {"CoreStats", "LogCount", "CloseSpider", "SpiderState", "AutoThrottle"}
    assert {"RobotsTxtMiddleware", "RetryMiddleware", "RedirectMiddleware", "HttpCacheMiddleware"} <= middlewares
    assert not {"OffsiteMiddleware", "CookiesMiddleware", "HttpAuthMiddleware"} & middlewares


def test_half_a_megabyte_of_rules_is_read() -> None:
    crawler: Any = SimpleNamespace(spider=None)
    rules = b"User-agent: *\nDisallow: /private\n" + b"".join(b"Disallow: /%d\n" % k for k in range(100_000))
    started = time.process_time()
    parser = BoundedRobotParser.from_crawler(crawler, rules)
    assert len(rules) > 2 * ROBOTS_BYTES
    assert not parser.allowed("https://shop.example/private/x", "metric-tree")
    assert not parser.allowed("https://shop.example/7", "metric-tree")
    assert parser.allowed("https://shop.example/public", "metric-tree")
    assert time.process_time() - started < 10


@pytest.mark.parametrize("lines", [100, HEADER_BYTES])
def test_headers_without_end_end_the_connection(lines: int) -> None:
    connection = HeaderLimitFactory(lambda _: None, "test").buildProtocol(None)
    transport = StringTransport()
    connection.makeConnection(transport)
    answers: list[Any] = []
    asked = connection.request(Request(b"GET", b"/", Headers({b"host": [b"shop.example"]}), None))
    asked.addBoth(answers.append)
    connection.dataReceived(b"HTTP/1.1 200 OK\r\n")
    piece = b"x: y\r\n" * 100
    for _ in range(lines // 100):
        connection.dataReceived(piece)
    many = lines > 100
    assert transport.disconnecting or transport.disconnected if many else not transport.disconnecting
    connection.dataReceived(b"content-length: 0\r\n\r\n")
    assert many or answers[0].code == 200
    assert "LimitedHandler" in crawl_settings(contact="tests@example.org")["DOWNLOAD_HANDLERS"]["https"]


@pytest.mark.parametrize(("end", "is_read"), [(ROBOTS_BYTES, True), (ROBOTS_BYTES + 1, False)])
def test_the_last_rule_within_500_kibibytes_is_read(end: int, is_read: bool) -> None:
    crawler: Any = SimpleNamespace(spider=None)
    rules, last = b"User-agent: *\nDisallow: /private\n", b"Disallow: /last\n"
    rules += b"#" + b"x" * (end - len(rules) - len(last) - 2) + b"\n" + last
    assert len(rules) == end
    parser = BoundedRobotParser.from_crawler(crawler, rules + b"Disallow: /never\n")
    assert parser.allowed("https://shop.example/last", "metric-tree") != is_read
    assert parser.allowed("https://shop.example/never", "metric-tree")


@pytest.mark.parametrize(("size", "is_read"), [(HEADER_BYTES, True), (HEADER_BYTES + 1, False)])
def test_headers_before_the_last_piece_have_at_most_256_kibibytes(size: int, is_read: bool) -> None:
    connection = HeaderLimitFactory(lambda _: None, "test").buildProtocol(None)
    transport = StringTransport()
    connection.makeConnection(transport)
    connection.request(Request(b"GET", b"/", Headers({b"host": [b"shop.example"]}), None)).addBoth(lambda _: None)
    start = b"HTTP/1.1 200 OK\r\n"
    lines = b"x: y\r\n" * 2000
    connection.dataReceived(start)
    count = len(start)
    while count < size:
        piece = lines[: min(len(lines), size - count)]
        connection.dataReceived(piece)
        count += len(piece)
    connection.dataReceived(b"y\r\n")
    assert (transport.disconnecting or transport.disconnected) != is_read


def test_the_limits_of_a_crawl() -> None:
    settings = crawl_settings(contact="tests@example.org", delay=0.0)
    limits = ("DEPTH_LIMIT", "DOWNLOAD_TIMEOUT", "DOWNLOAD_MAXSIZE", "URLLENGTH_LIMIT", "RETRY_TIMES")
    assert [settings[name] for name in limits] == [120, 30, 32_000_000, 2000, 3]
    assert (settings["AUTOTHROTTLE_ENABLED"], settings["CONCURRENT_REQUESTS_PER_DOMAIN"]) == (False, 16)
    assert crawl_settings(contact="tests@example.org", delay=0.1)["CONCURRENT_REQUESTS_PER_DOMAIN"] == 4
