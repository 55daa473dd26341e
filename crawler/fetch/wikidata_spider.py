"""Wikidata through its SPARQL service, in pages: items of a class with height, width, length, diameter, thickness."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Iterable, Iterator, Mapping
from datetime import UTC, datetime
from typing import Any
from urllib.parse import quote, urlsplit

import scrapy
from scrapy.http import Response

from crawler.items import RawItem
from crawler.text.units import millimetres

ENDPOINT = "https://query.wikidata.org/sparql"

#: Number of rows of a page, for which the service stays within its limit of one minute.
PAGE_ROWS = 500

#: Property to the axis word of a raw item.
PROPERTIES = {"P2048": "height", "P2049": "width", "P2043": "length", "P2386": "diameter", "P2610": "depth"}

#: Units of length among Wikidata's items.
UNITS = {
    "Q11573": "m", "Q174728": "cm", "Q174789": "mm", "Q828224": "km", "Q218593": "in", "Q3710": "ft", "Q482798": "yd",
    "Q200323": "dm",
}  # fmt: skip


def query(class_id: str, offset: int, rows: int = PAGE_ROWS) -> str:
    """Return the SPARQL query of a page of items of a class and its subclasses, in a fixed order."""
    parts = "\n".join(
        f"  OPTIONAL {{ ?item p:{p}/psv:{p} [wikibase:quantityAmount ?a{p}; wikibase:quantityUnit ?u{p}] . }}"
        for p in PROPERTIES
    )
    columns = " ".join(f"(SAMPLE(CONCAT(STR(?a{p}), ' ', STR(?u{p}))) AS ?{p})" for p in PROPERTIES)
    some = " || ".join(f"BOUND(?a{p})" for p in PROPERTIES)
    return (
        f"SELECT ?item (SAMPLE(?name) AS ?label) (SAMPLE(?kind) AS ?class) {columns} WHERE {{\n"
        f"  ?item wdt:P31/wdt:P279* wd:{class_id} .\n{parts}\n  FILTER ({some})\n"
        '  OPTIONAL { ?item rdfs:label ?name . FILTER (LANG(?name) = "en") }\n'
        '  OPTIONAL { ?item wdt:P31/rdfs:label ?kind . FILTER (LANG(?kind) = "en") }\n'
        f"}} GROUP BY ?item ORDER BY ?item LIMIT {rows} OFFSET {offset}"
    )


def items(answer: Mapping[str, Any], now: datetime | None = None) -> Iterator[RawItem | str]:
    """The raw items of an answer; a row without a size that can be read is yielded as its reason."""
    for row in answer.get("results", {}).get("bindings", []):
        values = {name: str(cell.get("value", "")) for name, cell in row.items()}
        item_id = values.get("item", "").rpartition("/")[2]
        sizes = {axis: _mm(values.get(name, "")) for name, axis in PROPERTIES.items()}
        known = {axis: mm for axis, mm in sizes.items() if mm is not None}
        if not item_id or not known:
            yield "no_size"
            continue
        yield RawItem(
            source="wikidata",
            source_id=item_id,
            url=f"https://www.wikidata.org/wiki/{item_id}",
            title=values.get("label", item_id),
            category_path=(values["class"],) if values.get("class") else (),
            dimensions_text="; ".join(f"{PROPERTIES[p]} {values[p]}" for p in PROPERTIES if values.get(p)),
            dimensions_mm=sizes,
            extents_mm=_extents(known),
            retrieved_at=(now or datetime.now(UTC)).isoformat(timespec="seconds"),
            licence="CC0-1.0",
        )


class WikidataSpider(scrapy.Spider):
    """A crawl of one class: `category` is its id (`Q11442`, bicycle), `start` another endpoint (a mirror, a test)."""

    name = "wikidata"

    def __init__(self, start: Iterable[str] = (), category: str = "", query: str = "", **named: Any) -> None:
        named.pop("pictures", None)  # Wikidata is asked for sizes alone
        super().__init__(**named)
        self._endpoint = next(iter(start), ENDPOINT)
        self._class = category or query

    @classmethod
    def origins(cls, query: str = "", category: str = "", **_: object) -> list[str]:
        """Return the class to start with, as a list of at most one."""
        return [name for name in (category or query,) if name]

    @classmethod
    def required_options(cls) -> str:
        """The options of which one must be given."""
        return "--category"

    def allows(self, url: str) -> bool:
        """Only the endpoint's host."""
        return urlsplit(url).hostname == urlsplit(self._endpoint).hostname

    async def start(self) -> AsyncIterator[scrapy.Request]:
        """The first page of the class."""
        yield self._page(0)

    def parse(self, response: Response, **_: Any) -> Iterator[Any]:
        """The items of a page, and the next page where this one was full."""
        answer = json.loads(response.body)
        outcomes = list(items(answer))
        offset = int(response.url.rpartition("&offset=")[2] or 0)
        yield from outcomes
        last = offset + PAGE_ROWS
        if len(outcomes) == PAGE_ROWS:
            yield self._page(last)

    def _page(self, offset: int) -> scrapy.Request:
        # The offset is in the query; it is repeated in the address because an answer does not say which page it is.
        return scrapy.Request(
            f"{self._endpoint}?format=json&query={quote(query(self._class, offset))}&offset={offset}",
            callback=self.parse,
        )


def _mm(text: str) -> float | None:
    amount, _, unit = text.partition(" ")
    key = UNITS.get(unit.rpartition("/")[2])
    try:
        value = millimetres(float(amount), key) if key else 0.0
    except ValueError:
        return None
    return round(value, 2) if value > 0 else None


def _extents(known: Mapping[str, float]) -> tuple[float, ...]:
    sides = [mm for axis, mm in known.items() if axis != "diameter"]
    if "diameter" in known:
        sides += [known["diameter"]] * min(2, max(0, 3 - len(sides)))
    return tuple(sorted(sides, reverse=True)[:3])
