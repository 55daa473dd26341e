"""Contracts: every spider reads a stored page of its site, offline, into the item and the links that stand here."""

from __future__ import annotations

import json
from typing import Any

import pytest
from scrapy import Request
from scrapy.http import HtmlResponse, TextResponse

from crawler.fetch.crawl import SPIDERS, UnknownSpider, spider_class
from crawler.fetch.wikidata_spider import query
from crawler.items import RawItem
from crawler.sites.registry import GENERIC, SITES

# Published values, written out so that a changed rule fails a test.
PAGE_ROWS = 500

#: spider: address of a product, of a listing, of something to leave alone
ADDRESSES = {
    "amazon": ("https://www.amazon.com/dp/B0ABCDEFGH", "https://www.amazon.com/s?k=stool", "https://www.amazon.com/gp/help/x"),
    "automobile_dimension": (
        "https://www.automobiledimension.com/model/made/car", "https://www.automobiledimension.com/made-car-dimensions.html",
        "https://www.automobiledimension.com/privacy",
    ),
    "crate_and_barrel": (
        "https://www.crateandbarrel.com/made-stool/s123456", "https://www.crateandbarrel.com/stools/1",
        "https://www.crateandbarrel.com/stores",
    ),
    "dimensions_com": (
        "https://www.dimensions.com/element/made-stool", "https://www.dimensions.com/collection/stools",
        "https://www.dimensions.com/about",
    ),
    "ikea": ("https://www.ikea.com/gb/en/p/made-stool-00123456/", "https://www.ikea.com/gb/en/cat/stools/", "https://www.ikea.com/gb/en/jobs/"),
    "wayfair": (
        "https://www.wayfair.com/furniture/pdp/made-stool-abc1234.html", "https://www.wayfair.com/furniture/sb0/stools.html",
        "https://www.wayfair.com/help",
    ),
    "wikipedia": (
        "https://en.wikipedia.org/wiki/Made_stool", "https://en.wikipedia.org/wiki/Category:Stools",
        "https://en.wikipedia.org/wiki/Help:Contents",
    ),
    "generic": ("https://shop.example/stool", "https://shop.example/stools", "https://elsewhere.example/x"),
}  # fmt: skip


def _page(product: str, listing: str, other: str) -> HtmlResponse:
    links = "".join(f'<a href="{url}">x</a>' for url in (product, listing, other, "mailto:x@example.org"))
    body = f"""<html lang="en"><body><h1>Made stool</h1>{links}
    <table><tr><th>Product dimensions (W x D x H)</th><td>41 x 38 x 46 cm</td></tr></table></body></html>"""
    return HtmlResponse(product, body=body.encode(), request=Request(product), headers={"Content-Type": "text/html"})


@pytest.mark.parametrize("name", ADDRESSES)
def test_a_site_spider_keeps_its_contract(name: str) -> None:
    product, listing, other = ADDRESSES[name]
    spider = spider_class(name)(start=[product])
    found = list(spider.parse(_page(product, listing, other)))
    items = [part for part in found if isinstance(part, RawItem)]
    source = "shop.example" if name == "generic" else name
    assert [(item.source, item.title, item.extents_mm) for item in items] == [(source, "Made stool", (460, 410, 380))]
    followed = {part.url for part in found if isinstance(part, Request)}
    assert listing in followed
    assert other not in followed


@pytest.mark.parametrize("link", ["http://[link]/x", "http://a.example:port/", "https://a.example:99999/"])
def test_a_bad_link_costs_itself_alone(link: str) -> None:
    product, listing, other = ADDRESSES["generic"]
    answer = _page(product, listing, other)
    body = answer.text.replace("mailto:x@example.org", link).replace("<table>", f'<img src="{link}"><table>')
    spider = spider_class("generic")(start=[product])
    found = list(spider.parse(answer.replace(body=body.encode())))
    assert [part.extents_mm for part in found if isinstance(part, RawItem)] == [(460, 410, 380)]
    assert listing in {part.url for part in found if isinstance(part, Request)}
    assert "bad_link" in found


def test_every_site_has_a_contract() -> None:
    assert set(ADDRESSES) == {site.name for site in (*SITES, GENERIC)}
    assert set(SPIDERS) == {*ADDRESSES, "wikidata"}
    with pytest.raises(UnknownSpider, match="expected one of"):
        spider_class("ebay")


def _row(number: int, **values: str) -> dict[str, Any]:
    row = {"item": f"http://www.wikidata.org/entity/Q{number}", "label": f"item {number}", "class": "ship", **values}
    return {name: {"type": "literal", "value": value} for name, value in row.items()}


def test_wikidata_reads_amounts_with_their_units_and_goes_on() -> None:
    metre, inch = "http://www.wikidata.org/entity/Q11573", "http://www.wikidata.org/entity/Q218593"
    rows = [
        _row(1, P2043=f"+12.5 {metre}", P2049=f"+100 {inch}"),
        _row(2, P2048="+3 http://www.wikidata.org/entity/Q999"),
    ]
    rows += [_row(number, P2386=f"+1 {metre}") for number in range(3, PAGE_ROWS + 1)]
    body = json.dumps({"results": {"bindings": rows}}).encode()
    url = "https://query.wikidata.org/sparql?format=json&query=x&offset=500"
    found = list(spider_class("wikidata")(category="Q11446").parse(TextResponse(url, body=body)))
    items = [part for part in found if isinstance(part, RawItem)]
    assert items[0].dimensions_mm == {"height": None, "width": 2540, "length": 12500, "diameter": None, "depth": None}
    assert items[0].licence == "CC0-1.0"
    assert found.count("no_size") == 1
    assert items[-1].extents_mm == (1000, 1000)
    requests = [part for part in found if isinstance(part, Request)]
    assert [request.url.rpartition("&")[2] for request in requests] == ["offset=1000"]
    assert "wd:Q11446" in query("Q11446", 0)
