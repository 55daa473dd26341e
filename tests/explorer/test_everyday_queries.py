"""Everyday queries: the browser finds what the server finds, in the shipped release."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import metric_tree
from explorer.catalogue import ReleaseCatalogue
from explorer.queries import search_response, searched_text
from explorer.routes import render
from explorer.schemas import SearchQuery
from explorer.urls import slug
from tests.support.browser import Browser

QUERIES = {
    "how tall is a door": "door.n.01", "tv 55 inch": "television_receiver.n.01", "how wide is a sofa": "sofa.n.01",
    "office chair height": "mt:office_chair", "queen size bed": "mt:queen_size_bed", "a4 paper size": "mt:a4_sheet",
    "car length": "car.n.01", "standard door width": "door.n.01", "dining table height": "dining_table.n.01",
    "how big is a football": "football.n.02", "average height of a man": "man.n.01", "how long is a bus": "bus.n.01",
    "washing machine dimensions": "washer.n.03", "bike length": "bicycle.n.01", "coffee mug": "coffee_mug.n.01",
    "laptop 15 inch": "laptop.n.01", "black wooden chairs": "chair.n.01", "two chairs": "chair.n.01",
    "what is the size of a basketball": "basketball.n.02", "big dog": "dog.n.01", "grey tyre": "tire.n.01",
    "kids bicycle": "bicycle.n.01", "wardrobe width": "wardrobe.n.01", "toilet height": "toilet.n.02",
    "park bench": "park_bench.n.01", "trash can": "ashcan.n.01", "piano": "piano.n.01", "couch": "sofa.n.01",
    "pickup truck length": "pickup.n.01", "parking meter": "parking_meter.n.01",
}  # fmt: skip


@pytest.fixture(scope="module")
def shipped() -> ReleaseCatalogue:
    return ReleaseCatalogue([metric_tree.open()])


def test_the_server_finds_everyday_queries(shipped: ReleaseCatalogue) -> None:
    found = {query: search_response(shipped, SearchQuery(query)) for query in QUERIES}
    assert {query: answer.hits[0].node for query, answer in found.items()} == QUERIES
    door = found["how tall is a door"]
    assert door.answer is not None
    assert door.answer.startswith("door and doorframe: about ")
    assert set(door.hits[0].median_mm) == {"length", "height"}
    assert search_response(shipped, SearchQuery("zzqx")).answer is None


def test_a_name_keeps_its_words_about_sizes(shipped: ReleaseCatalogue) -> None:
    assert searched_text(shipped, "How tall is a Standard lamp?") == "standard lamp"
    assert searched_text(shipped, "high chair height") == "high chair"
    assert searched_text(shipped, "size of the tv 140 cm") == "tv"
    assert searched_text(shipped, "height") == "height"


def test_the_browser_finds_the_same(shipped: ReleaseCatalogue, tmp_path: Path) -> None:
    addresses = ("search.html", *(f"assets/{name}" for name in ("page.js", "style.css", "names.js", "search.js")))
    (tmp_path / "assets").mkdir()
    for address in addresses:
        made = render(shipped, address)
        assert made is not None
        (tmp_path / address).write_bytes(made.body)
    with Browser(tmp_path / "profile") as browser:
        browser.call("Page.enable")
        browser.open((tmp_path / "search.html").as_uri() + "?q=how+tall+is+a+door")
        browser.wait("document.querySelector('#results li')")
        assert browser.run("document.getElementById('search-answer').textContent").startswith(
            "door and doorframe: about "
        )
        first = f"{json.dumps(list(QUERIES))}.map(query => (metricTree.search(query)[0] || {{}}).slug)"
        assert dict(zip(QUERIES, browser.run(first), strict=True)) == {
            query: slug(node) for query, node in QUERIES.items()
        }
