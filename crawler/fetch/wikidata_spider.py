"""Spider of the SPARQL service of Wikidata: items of a class with height, width, length, diameter or thickness."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Iterable, Iterator, Mapping
from datetime import UTC, datetime
from typing import Any
from urllib.parse import quote, urlsplit

import scrapy
from scrapy.http import Response

from crawler.items import RawItem
from crawler.text.cell_lengths import extents_mm
from metric_base.length_units import millimetres

ENDPOINT = "https://query.wikidata.org/sparql"

#: Number of rows of a page; the service has a time limit of one minute.
PAGE_ROWS = 500

#: Axes by property.
PROPERTIES = {"P2048": "height", "P2049": "width", "P2043": "length", "P2386": "diameter", "P2610": "depth"}

#: Units of length by item.
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
    """Return the raw items of a response; `no_size` for rows without a valid size."""
    for row in answer.get("results", {}).get("bindings", []):
        values = {name: str(cell.get("value", "")) for name, cell in row.items()}
        item_id = values.get("item", "").rpartition("/")[2]
        sizes: dict[str, float | None] = {}
        for name, axis in PROPERTIES.items():
            amount, _, unit = values.get(name, "").partition(" ")
            key = UNITS.get(unit.rpartition("/")[2])
            try:
                mm = millimetres(float(amount), key) if key else 0.0
            except ValueError:
                mm = 0.0
            sizes[axis] = round(mm, 2) if mm > 0 else None
        extents = extents_mm(sizes)
        if not item_id or extents is None:
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
            extents_mm=extents,
            retrieved_at=(now or datetime.now(UTC)).isoformat(timespec="seconds"),
            licence="CC0-1.0",
        )


class WikidataSpider(scrapy.Spider):
    """Spider of a class: `category` is the id of the class (`Q11442`, bicycle), `start` an alternative endpoint."""

    name = "wikidata"

    def __init__(self, start: Iterable[str] = (), category: str = "", query: str = "", **named: Any) -> None:
        named.pop("pictures", None)  # queries are for sizes only
        super().__init__(**named)
        self._endpoint = next(iter(start), ENDPOINT)
        self._class = category or query

    @classmethod
    def origins(cls, query: str = "", category: str = "", **_: object) -> list[str]:
        """Return the class to start with, as a list of at most one."""
        return [name for name in (category or query,) if name]

    @classmethod
    def required_options(cls) -> str:
        """Return the required option."""
        return "--category"

    def allows(self, url: str) -> bool:
        """Return True if an address is of the host of the endpoint."""
        return urlsplit(url).hostname == urlsplit(self._endpoint).hostname

    async def start(self) -> AsyncIterator[scrapy.Request]:
        """Yield the first page of the class."""
        yield self._page(0)

    def parse(self, response: Response, **_: Any) -> Iterator[Any]:
        """Yield the items of a page, and the next page if this one is full."""
        answer = json.loads(response.body)
        outcomes = list(items(answer))
        offset = int(response.url.rpartition("&offset=")[2] or 0)
        yield from outcomes
        if len(outcomes) == PAGE_ROWS:
            yield self._page(offset + PAGE_ROWS)

    def _page(self, offset: int) -> scrapy.Request:
        # the address repeats the offset, because the response does not contain it
        return scrapy.Request(
            f"{self._endpoint}?format=json&query={quote(query(self._class, offset))}&offset={offset}",
            callback=self.parse,
        )
