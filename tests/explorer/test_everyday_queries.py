"""Everyday queries: the browser finds what the server finds, in the shipped release."""

from __future__ import annotations

import json
import random
from pathlib import Path

import pytest

import metric_tree
from explorer.catalogue import ReleaseCatalogue
from explorer.queries import search_response, searched_meaning
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


#: Names with a size, in a sentence or not: variants, rules for numbers, and numbers out of the range of their rule.
STATED = (
    "A5", "20 ft container", "what is the size of a 240 L bin?", "king size mattress dimensions", "EUR-pallet size",
    "330 ml can", "CR2032", "LP", "US license plate", "100 x 200 cm mattress", "tv 55 inch", "how wide is a 65 inch TV",
    "27-inch monitor", "14 inch laptop", "20 inch bicycle", "1.5 l bottle height", "0,75 l wine bottle", "4-seat sofa",
    "size 42 shoes", "8 ft ladder", "54 l aquarium", "14 inch snare drum", "30 cm pizza", "60 cm wide fridge",
    "55 inch monitor", "tv 3 inch", "ofice chair", "wardrob", "pair of scissors", "cup of coffee",
)  # fmt: skip


def test_a_stated_size_is_the_answer(shipped: ReleaseCatalogue) -> None:
    television = search_response(shipped, SearchQuery("how wide is a 55 inch TV?"))
    assert television.answer == "television, 55 inch: about 1.23 m wide and 73 cm high (measured)."
    assert television.hits[0].median_mm["length"] == pytest.approx(55 * 25.4 * 0.88, rel=1e-3)
    bin_240 = search_response(shipped, SearchQuery("size of a 240 L bin"))
    assert bin_240.answer == "wheelie bin, 240 l: about 73 cm long, 58 cm wide and 1.07 m high (norm)."
    assert bin_240.hits[0].node == "mt:wheelie_bin"
    assert "inch" not in str(search_response(shipped, SearchQuery("television")).answer)


def test_words_that_no_name_contains_have_no_answer(shipped: ReleaseCatalogue) -> None:
    for query in ("ikea billy", "parking lot", "eiffel tower", "cat food", "football field"):
        assert search_response(shipped, SearchQuery(query)).answer is None, query
    answers = {
        query: str(search_response(shipped, SearchQuery(query)).answer) for query in ("blue whale", "human", "stove")
    }
    assert answers["blue whale"].startswith("Taken as whale: about ")
    assert answers["human"] == "human: sizes differ by more than 10 times; choose a narrower category."
    assert " Narrower: " in answers["stove"]
    assert "gas range 88.1 cm, hob 6.2 cm, electric range 90.2 cm high." in answers["stove"]
    for query in ("car", "door"):  # doors of cabinets are none of buildings
        assert "Narrower" not in str(search_response(shipped, SearchQuery(query)).answer)


def test_a_name_keeps_its_words_about_sizes(shipped: ReleaseCatalogue) -> None:
    def text(query: str) -> str:
        return searched_meaning(shipped, query)[0]

    assert text("How tall is a Standard lamp?") == "Standard lamp"
    assert text("high chair height") == "high chair"
    assert text("size of the sofa 999 cm") == "sofa"
    assert text("height") == "height"


def test_the_browser_finds_the_same(shipped: ReleaseCatalogue, tmp_path: Path) -> None:
    addresses = ("search.html", *(f"assets/{name}" for name in ("page.js", "style.css", "names.js", "search.js")))
    (tmp_path / "assets").mkdir()
    for address in addresses:
        made = render(shipped, address)
        assert made is not None
        (tmp_path / address).write_bytes(made)
    names = random.Random(46).sample([name for name, _ in shipped.tree.names()], 60)
    queries = [
        *QUERIES,
        *STATED,
        "ikea billy",
        "eiffel tower",
        "blue whale",
        "human",
        "door",
        "bottle",
        *names,
        *(f"how wide is the {name}?" for name in names[:20]),
    ]
    expected = {}
    for query in queries:
        answer = search_response(shipped, SearchQuery(query))
        expected[query] = [slug(answer.hits[0].node), answer.answer or ""]
    with Browser(tmp_path / "profile") as browser:
        browser.call("Page.enable")
        browser.open((tmp_path / "search.html").as_uri() + "?q=how+tall+is+a+door")
        browser.wait("document.querySelector('#results li')")
        assert browser.run("document.getElementById('search-answer').textContent") == expected["how tall is a door"][1]
        first = "[(metricTree.search(query)[0] || {}).slug, metricTree.searchAnswer(query)]"
        found = browser.run(f"{json.dumps(queries)}.map(query => {first})")
        assert dict(zip(queries, found, strict=True)) == expected
