"""Spider of a declared site: it follows listings and reads product pages by the rules of the site."""

from __future__ import annotations

import re
from collections.abc import AsyncIterator, Iterable, Iterator
from typing import Any, ClassVar
from urllib.parse import urlsplit

import scrapy
from scrapy.http import Response

from crawler.fetch.item_images import Picture, picture
from crawler.page.page import Page, page
from crawler.page.time_limit import processor_budget
from crawler.page.urls import absolute_url
from crawler.sites.listing import listed_items
from crawler.sites.site import Site

#: Priorities: product pages first, so that an interrupted crawl has items and not addresses.
PRODUCT, LISTING, PICTURE = 20, 10, 0

#: Minimum number of repetitions of a path segment in addresses of crawler traps (calendars, recursive menus).
MAX_REPEATED_PARTS = 3

#: Maximum number of characters of an address; longer ones are generated without end.
MAX_URL = 2000

_NO_PAGE = re.compile(r"\.(?:jpe?g|png|gif|webp|svg|pdf|zip|css|js|ico|mp4|woff2?)(?:$|\?)", re.IGNORECASE)


class SiteSpider(scrapy.Spider):
    """Spider of one site, or of any site by the generic rules.

    Parameters
    ----------
    start : iterable of str
        Start addresses.
    query, category : str
        Values for the templates of start addresses of the site.
    pictures : Path, optional
        Folder for images of items, if the terms of the site permit to store them; by default only links are stored.
    **named
        Arguments of `scrapy.Spider`.
    """

    name = "site"
    site: ClassVar[Site]

    def __init__(
        self, start: Iterable[str] = (), query: str = "", category: str = "", pictures: Any = None, **named: Any
    ) -> None:
        super().__init__(**named)
        self._start = self.origins(start, query, category)
        self._hosts = {urlsplit(url).hostname for url in self._start}
        self._pictures = pictures
        #: Addresses that the frontier contains (`CommitMiddleware`).
        self.known: set[str] = set()

    @classmethod
    def origins(cls, start: Iterable[str] = (), query: str = "", category: str = "") -> list[str]:
        """Return the start addresses: the given ones, and the filled templates of the site."""
        return [*start, *cls.site.addresses(query=query, category=category)]

    @classmethod
    def required_options(cls) -> str:
        """Return the options of which one is required."""
        fields = [name for name in ("query", "category") if any(f"{{{name}}}" in url for url in cls.site.templates)]
        return " or ".join(f"--{name}" for name in ("start-url", *fields))

    def allows(self, url: str) -> bool:
        """Return True if an address belongs to the site; checked before downloads and after redirects."""
        host = urlsplit(url).hostname
        return self.site.owns(url) or host in self._hosts or (self._pictures is not None and bool(_NO_PAGE.search(url)))

    async def start(self) -> AsyncIterator[scrapy.Request]:
        """Yield the start addresses."""
        for url in self._start:
            yield scrapy.Request(url, priority=LISTING)

    def parse(self, response: Response, **_: Any) -> Iterator[Any]:
        """Yield the item of a product page and the links of a page; dropped parts are yielded as their reason."""
        if b"html" not in (response.headers.get("Content-Type") or b"html"):
            yield "no_html"
            return
        with processor_budget():
            read = page(response.body, response.url, (response.headers.get("Content-Type") or b"").decode("latin-1"))
            parts = [*self._item(read), *self._links(read)]
        yield from parts

    def picture(self, response: Response, **_: Any) -> Iterator[Any]:
        """Yield the stored image of an item, or the reason to reject it."""
        outcome = picture(response.body, response.url, response.meta["item"], self._pictures)
        yield outcome if isinstance(outcome, Picture) else f"picture_{outcome}"

    def _item(self, read: Page) -> Iterator[Any]:
        if not self.site.is_product(read.url):
            if self.site.listed_order:
                yield from listed_items(read, self.site)
            return
        item = self.site.item(read)
        if item.extents_mm is None:
            yield "no_size" if item.title else "no_product"
            return
        yield item
        for url in item.images if self._pictures is not None else ():
            if self.site.may_store(url):
                yield _request(url, callback=self.picture, priority=PICTURE, meta={"item": item.identity})
            else:
                yield "picture_link_only"

    def _links(self, read: Page) -> Iterator[scrapy.Request | str]:
        seen: set[str] = set()
        for address in dict.fromkeys(read.links):
            url = absolute_url(read.url, address)
            if not url and address.strip().startswith("http"):
                yield "bad_link"
            if not url or url in seen or url in self.known:
                continue
            seen.add(url)
            parts = [part for part in urlsplit(url).path.split("/") if part] if len(url) <= MAX_URL else []
            is_trap = len(url) > MAX_URL or any(parts.count(part) >= MAX_REPEATED_PARTS for part in parts)
            if is_trap or _NO_PAGE.search(url) or not self.allows(url):
                continue
            if self.site.is_product(url):
                yield _request(url, callback=self.parse, priority=PRODUCT)
            elif self.site.is_listing(url):
                yield _request(url, callback=self.parse, priority=LISTING)


def _request(url: str, **named: Any) -> scrapy.Request | str:
    """Return the request of a link, or `bad_link` if Scrapy rejects the address."""
    try:
        return scrapy.Request(url, **named)
    except ValueError:
        return "bad_link"
