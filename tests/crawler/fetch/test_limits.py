"""Limits of a crawl and of its items, on both sides."""

from __future__ import annotations

import sys
import time
from email.utils import formatdate
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import twisted.internet
from PIL import Image
from scrapy import Request
from scrapy.http import HtmlResponse, Response

from crawler.fetch import item_images
from crawler.fetch.crawl import spider_class
from crawler.fetch.item_images import Picture, picture
from crawler.fetch.middlewares import BanMiddleware, is_ban
from crawler.imports import table_files
from crawler.items import BadRawItem, RawItem, raw_items

# Published values, written out so that a changed rule fails a test.
BAN_PAGE_BYTES = 20000
MAX_BANS = 6
MAX_BAN_SECONDS = 1800.0
MAX_LEAVES = 100000
MAX_LINE = 1 << 20
MAX_PIXELS = 40000000
MAX_REPEATED_PARTS = 3
MAX_URL = 2000

START = "https://shop.example/"


def links(address: str) -> list[str]:
    """Return the addresses that the generic spider follows from a page with one link."""
    body = f'<html><body><a href="{address}">a</a></body></html>'.encode()
    response = HtmlResponse(START, body=body, request=Request(START), headers={"Content-Type": "text/html"})
    return [part.url for part in spider_class("generic")(start=[START]).parse(response) if isinstance(part, Request)]


def test_links_of_crawler_traps_are_not_followed() -> None:
    assert MAX_REPEATED_PARTS == 3
    assert links("/a/b/a/c") == ["https://shop.example/a/b/a/c"]
    assert links("/a/b/a/c/a") == []


@pytest.mark.parametrize("excess", [0, 1])
def test_long_addresses_are_not_followed(excess: int) -> None:
    address = START + "a" * (MAX_URL - len(START) + excess)
    assert links(address) == ([] if excess else [address])


@pytest.mark.parametrize("excess", [-1, 0])
def test_only_short_pages_with_a_captcha_are_bans(excess: int) -> None:
    body = b"captcha".ljust(BAN_PAGE_BYTES + excess)
    assert is_ban(HtmlResponse(START, body=body)) is (excess < 0)


class Crawl:
    """A crawler that records its pauses in seconds, and the reasons for its end."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.stats, self.spider, self.engine, self.settings = None, SimpleNamespace(), self, self
        self.pauses: list[float] = []
        self.ends: list[str] = []
        reactor = SimpleNamespace(callLater=lambda seconds, _: self.pauses.append(seconds))
        monkeypatch.setattr(twisted.internet, "reactor", reactor, raising=False)
        monkeypatch.setitem(sys.modules, "twisted.internet.reactor", reactor)
        monkeypatch.setattr("scrapy.utils.defer.deferred_from_coro", self.ends.append)

    def getfloat(self, _: str, default: float) -> float:
        return default

    def pause(self) -> None:
        """The engine stops."""

    unpause = pause

    def close_spider_async(self, reason: str) -> str:
        return reason


def ban(middleware: BanMiddleware, latency: float = 0.0, header: str = "") -> None:
    refused = Response(START, status=503, headers={"Retry-After": header} if header else {})
    request = Request(START, meta={"download_latency": latency})
    assert isinstance(middleware.process_response(request, refused), Request)


def test_the_pause_doubles_with_each_ban_until_the_crawl_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    crawl: Any = Crawl(monkeypatch)
    middleware = BanMiddleware(crawl)
    for _ in range(MAX_BANS):
        ban(middleware)
    assert crawl.pauses == [30, 60, 120, 240, 480, 960]
    assert crawl.ends == []
    ban(middleware)
    assert crawl.ends == ["banned"]
    middleware.process_response(Request(START), Response(START))
    ban(middleware)
    assert crawl.pauses[6:] == [30]  # a page in between


def test_the_header_states_the_first_pause(monkeypatch: pytest.MonkeyPatch) -> None:
    crawl: Any = Crawl(monkeypatch)
    middleware = BanMiddleware(crawl)
    for header in ("5", "5", "500"):
        ban(middleware, header=header)
    assert crawl.pauses == [5, 60, 500]
    for header, pause in (("1800", 1800), ("1801", 1800)):
        middleware = BanMiddleware(crawl)
        ban(middleware, header=header)
        assert crawl.pauses[-1] == pause == MAX_BAN_SECONDS


@pytest.mark.parametrize(
    ("header", "pause"), [("120", 120), ("soon", 30), ("-5", 30), ("nan", 30), ("", 30), ("9" * 400, 1800)]
)
def test_the_header_is_a_number(header: str, pause: float, monkeypatch: pytest.MonkeyPatch) -> None:
    crawl: Any = Crawl(monkeypatch)
    ban(BanMiddleware(crawl), header=header)
    assert crawl.pauses == [pause]


def test_the_header_is_a_date(monkeypatch: pytest.MonkeyPatch) -> None:
    crawl: Any = Crawl(monkeypatch)
    ban(BanMiddleware(crawl), header=formatdate(time.time() + 900))
    assert crawl.pauses == [pytest.approx(900, abs=600)]  # the test may be slow


def test_requests_in_flight_at_a_ban_are_the_same_ban(monkeypatch: pytest.MonkeyPatch) -> None:
    crawl: Any = Crawl(monkeypatch)
    middleware = BanMiddleware(crawl)
    for latency in (60.0, 60.0, 60.0, 0.0, 60.0):
        ban(middleware, latency)
    assert crawl.pauses == [30, 60]


@pytest.mark.parametrize(
    ("size", "refusal"),
    [
        ((64, 64), None),
        ((63, 64), "too_small"),
        ((12_000, 64), None),
        ((12_001, 64), "too_large"),
        ((8_000, 5_000), None),
        ((8_000, 5_001), "too_large"),
    ],
)
def test_images_have_a_minimum_and_a_maximum_size(size: tuple[int, int], refusal: str | None, tmp_path: Path) -> None:
    assert (item_images.SIDE_RANGE_PX, MAX_PIXELS) == ((64, 12_000), 40_000_000)
    file = BytesIO()
    Image.new("1", size).save(file, "PNG")
    outcome = picture(file.getvalue(), START + "a.png", "shop:1", tmp_path)
    assert (None if isinstance(outcome, Picture) else outcome) == refusal


def test_a_line_of_raw_items_has_a_maximum_length(tmp_path: Path) -> None:
    line = RawItem(source="shop", source_id="1").line()
    path = tmp_path / "items.jsonl"
    path.write_text(line.ljust(MAX_LINE - 1) + "\n", encoding="utf-8")
    assert [item.source_id for item in raw_items(path)] == ["1"]
    path.write_text(line.ljust(MAX_LINE) + "\n", encoding="utf-8")
    with pytest.raises(BadRawItem, match="line: expected less than"):
        list(raw_items(path))


@pytest.mark.parametrize(("year", "is_valid"), [(9_999, True), (-9_999, True), (10_000, False)])
def test_a_year_has_at_most_four_digits(year: int, is_valid: bool) -> None:
    if is_valid:
        assert RawItem(source="shop", source_id="1", year=year).year == year
    else:
        with pytest.raises(ValueError, match="four digits"):
            RawItem(source="shop", source_id="1", year=year)


@pytest.mark.parametrize(("region", "is_valid"), [("NO", True), ("no", False), ("NOR", False), ("", False)])
def test_a_region_is_a_country_code_or_a_known_region(region: str, is_valid: bool) -> None:
    if is_valid:
        assert RawItem(source="shop", source_id="1", region=region).region == region
    else:
        with pytest.raises(ValueError, match="two letters of ISO 3166"):
            RawItem(source="shop", source_id="1", region=region)


def test_a_record_has_a_maximum_number_of_values() -> None:
    assert len(table_files.flat([0] * MAX_LEAVES)) == MAX_LEAVES
    with pytest.raises(ValueError, match="a record of more than 100,000 values"):
        table_files.flat([0] * (MAX_LEAVES + 1))


@pytest.mark.parametrize(("size", "refusal"), [(20_000_000, "no_picture"), (20_000_001, "too_many_bytes")])
def test_an_image_has_at_most_20_megabytes(size: int, refusal: str) -> None:
    class Long(bytes):
        def __len__(self) -> int:
            return size

    assert item_images.decode_image(Long(b"no picture")) == refusal
