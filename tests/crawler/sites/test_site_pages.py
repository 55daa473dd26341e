"""Contracts of the site spiders: each reads stored pages in every layout of its site, offline."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from scrapy import Request
from scrapy.http import HtmlResponse

from crawler.fetch.crawl import SPIDERS, spider_class
from crawler.items import RawItem
from crawler.page.urls import source_id
from crawler.sites.registry import GENERIC, SITES, site_of
from tests.crawler.sites.site_pages import PAGES, Stored, stored


@pytest.mark.parametrize("case", PAGES, ids=[f"{case.spider}: {case.layout}" for case in PAGES])
def test_a_stored_page_keeps_its_contract(case: Stored) -> None:
    assert site_of(case.url).name == case.spider
    headers = {"Content-Type": "text/html; charset=utf-8"}
    response = HtmlResponse(case.url, body=stored(case), request=Request(case.url), headers=headers)
    found = list(spider_class(case.spider)(start=[case.url]).parse(response))
    items = [part for part in found if isinstance(part, RawItem)]
    if case.extents is None:
        assert (items, found.count("no_size")) == ([], 1)
        return
    (item,) = items
    source = site_of(case.url).source(case.url)
    assert source == ("shop.example" if case.spider == "generic" else case.spider)
    assert (item.source, item.title, item.category_path) == (source, case.title, case.category)
    assert item.source_id == (case.id or source_id(case.url))
    assert item.extents_mm == pytest.approx(case.extents, abs=0.15)
    assert not {"contradicts_itself", "absurd_size"} & set(item.flags)
    assert ("low_trust" in item.flags) == (case.layout == "text")
    if case.words is not None:
        assert {axis: mm for axis, mm in item.dimensions_mm.items() if mm} == pytest.approx(case.words, abs=0.15)


def test_every_spider_of_pages_has_stored_ones() -> None:
    assert {case.spider for case in PAGES} == {site.name for site in (*SITES, GENERIC)}
    amazon = {case.layout.rpartition(" ")[2] for case in PAGES if case.spider == "amazon"}
    assert amazon == {"com", "co.uk", "de", "fr", "it", "es"}


def test_the_terms_of_every_spider_s_site_are_written_down() -> None:
    text = (Path(__file__).resolve().parents[3] / "data" / "sources" / "SITES.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^## (\w+)$", text, re.MULTILINE)) == set(SPIDERS)
    assert "not fetched; check before crawling" in text
    stores = {site.name for site in (*SITES, GENERIC) if site.pictures is not None}
    assert stores == {"wikipedia", "generic"}  # what SITES.md states of images


def test_a_listing_of_cars_is_an_item_a_car() -> None:
    tiles = "".join(
        f"""<div class="unit"><a href="/model/made/{name}"><img src="{name}.jpg" alt="Made {name}"></a>
        <h2><a href="/model/made/{name}">Made {name}</a></h2><p>{text}</p></div>"""
        for name, text in (
            ("one", "4055 x 1745 x 1430 mm. Boot space 309 dm3"),
            ("two", "Length x width x height: 4,284 x 1,789 x 1,452 mm"),
            ("three", "Length: 4500 mm, Width: 1800 mm, Height: 1500 mm"),
            ("four", "Not yet on sale"),
        )
    )
    body = f"<html lang='en'><body><h1>Made cars</h1>{tiles}<p>From 4055 to 4500 mm</p></body></html>".encode()
    url = "https://www.automobiledimension.com/made-car-dimensions.html"
    response = HtmlResponse(url, body=body, request=Request(url), headers={"Content-Type": "text/html"})
    found = list(spider_class("automobile_dimension")(start=[url]).parse(response))
    read = {item.title: item.dimensions_mm for item in found if isinstance(item, RawItem)}
    assert read == {
        "Made one": {"length": 4055, "width": 1745, "height": 1430},
        "Made two": {"length": 4284, "width": 1789, "height": 1452},
        "Made three": {"length": 4500, "width": 1800, "height": 1500},
    }
    ids = [item.source_id for item in found if isinstance(item, RawItem)]
    assert ids == ["made/one", "made/two", "made/three"]
    assert sum(isinstance(part, Request) for part in found) == 4
