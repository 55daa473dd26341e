"""Ten questions of users, answered through the site of the shipped release as a visitor does: search, links, pages."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator

import pytest

import metric_tree
from tests.explorer.conftest import WEB, running
from tests.support.browser import Browser


@pytest.fixture(scope="module")
def shipped() -> Iterator[str]:
    with running([metric_tree.open()]) as address:
        yield address


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with Browser(tmp_path_factory.mktemp("profile")) as one:
        one.call("Page.enable")
        yield one


def searched(browser: Browser, base: str, query: str) -> str:
    """Type a question into the search of the home page, press Enter, and return the answer on the page of results."""
    browser.open(f"{base}/index.html")
    browser.run("document.getElementById('search').focus()")
    browser.type(query)
    browser.press("Enter")
    browser.wait("document.querySelector('#results li')")
    return str(browser.run("document.getElementById('search-answer').textContent"))


@pytest.mark.parametrize(
    ("query", "low_cm", "high_cm", "word"),
    [
        ("office chair height", 80, 130, "high"),
        ("standard door width", 70, 100, "wide"),
        ("car length", 400, 500, "long"),
        ("queen size bed", 190, 225, "long"),
        ("a4", 29.7, 29.7, "long"),
    ],
)
def test_a_size_is_the_first_line(
    shipped: str, browser: Browser, query: str, low_cm: float, high_cm: float, word: str
) -> None:
    answer = searched(browser, shipped, query)
    match = re.search(rf"([\d.]+) (cm|m) {word}", answer)
    assert match is not None, answer
    assert low_cm <= float(match[1]) * (100 if match[2] == "m" else 1) <= high_cm


def test_a_search_has_12_results(shipped: str, browser: Browser) -> None:
    searched(browser, shipped, "chair")
    assert browser.run("document.querySelectorAll('#results li').length") == 12


@pytest.mark.parametrize(
    ("page", "link", "columns", "min_rows"),
    [
        ("nodes/chair.n.01.html", "CSV", {"title", "length_mm", "source", "licence"}, 100),
        ("vocabularies/coco_80.html", "As CSV", {"label", "node_id", "height_q50_mm"}, 80),
        ("index.html", "CSV", {"node_id", "tier", "length_q05_mm", "height_q95_mm"}, 4000),
    ],
)
def test_a_table_is_a_link_of_its_page(
    shipped: str, browser: Browser, page: str, link: str, columns: set[str], min_rows: int
) -> None:
    browser.open(f"{shipped}/{page}")
    links = f"[...document.querySelectorAll('main a')].filter(one => one.textContent === '{link}').map(one => one.href)"
    tables = [list(csv.DictReader(io.StringIO(WEB.get(address).text))) for address in browser.run(links)]
    assert any(len(rows) >= min_rows and columns <= set(rows[0]) for rows in tables)


def test_a_category_without_shipped_items_names_its_sources(shipped: str, browser: Browser) -> None:
    browser.open(f"{shipped}/nodes/mt-office_chair.html")
    text = browser.run("document.getElementById('main').textContent")
    assert "IKEA Saudi Arabia furniture, April 2020" in text
    assert "because the licence in brackets is copyleft, missing or restricts redistribution" in text


def test_a_sofa_passes_a_door_or_not(shipped: str, browser: Browser) -> None:
    browser.open(f"{shipped}/nodes/sofa.n.01.html")
    address = "[...document.querySelectorAll('main a')].find(one => one.textContent === 'does it fit?').href"
    browser.open(browser.run(address))
    browser.run("document.getElementById('fit-object').value = '210 x 95 x 75 cm'")
    browser.run("document.getElementById('fit').requestSubmit()")
    browser.wait("document.getElementById('fit-answer').textContent.startsWith('210 x 95 x 75 cm through door')")
    assert "% of the pairs" in browser.run("document.getElementById('fit-answer').textContent")
    assert "shortest side" in browser.run("document.getElementById('fit-reason').textContent")


def test_the_address_of_a_prior_is_a_link_of_its_page(shipped: str, browser: Browser) -> None:
    browser.open(f"{shipped}/nodes/chair.n.01.html")
    links = "[...document.querySelectorAll('#h-sizes ~ p a')].filter(one => one.textContent === 'JSON')"
    records = [WEB.get(address).json()["schema"] for address in browser.run(f"{links}.map(one => one.href)")]
    assert "metric-tree/prior/1" in records


#: The words of a page, with its parts open, whose letters are on several lines.
BROKEN_WORDS = """(() => {
  for (const part of document.querySelectorAll("details.part")) part.open = true;
  const walk = document.createTreeWalker(document.getElementById("main"), NodeFilter.SHOW_TEXT);
  const range = document.createRange();
  const broken = [];
  while (walk.nextNode()) {
    const text = walk.currentNode;
    if (!text.parentElement.offsetParent || text.parentElement.closest("code, script, svg")) continue;
    for (const word of text.data.matchAll(/[A-Za-z]{3,}/g)) {
      range.setStart(text, word.index);
      range.setEnd(text, word.index + word[0].length);
      if (new Set([...range.getClientRects()].map((box) => Math.round(box.top))).size > 1) broken.push(word[0]);
    }
  }
  return broken;
})()"""


@pytest.mark.parametrize(
    "page",
    [
        "nodes/sofa.n.01.html",
        "nodes/entity.n.01.html",
        "nodes/cellular_telephone.n.01.html",
        "nodes/vehicle.n.01.html",
        "sources/index.html",
    ],
)
def test_a_page_on_a_phone_is_short_and_hides_no_column(shipped: str, browser: Browser, page: str) -> None:
    browser.call("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=True)
    browser.open(f"{shipped}/{page}")
    summaries = "document.querySelectorAll('details.part > summary')"
    for part in range(browser.run(f"{summaries}.length") + 1):
        assert browser.run("document.documentElement.scrollHeight") < 4000
        assert browser.run("document.documentElement.scrollWidth") <= 390
        browser.run(f"{summaries}[{part}]?.click()")
    hidden = "[...document.querySelectorAll('tbody tr:not([hidden]) > *')].filter(one => one.textContent && "
    hidden += "getComputedStyle(one).display === 'none').length"
    assert browser.run(hidden) == 0
    assert browser.run(BROKEN_WORDS) == []
    browser.call("Emulation.clearDeviceMetricsOverride")
