"""Declaration of a site: addresses of its pages, XPaths of title, breadcrumb, brand and images, and its politeness."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from functools import cache
from urllib.parse import quote, quote_plus, urlsplit

import msgspec
from lxml.etree import HTMLParser, XPath, XPathError, fromstring

from crawler.items import RawItem
from crawler.page.page import Element, Page, squeeze
from crawler.page.product import MAX_IMAGES, Product, product
from crawler.page.statements import page_item
from crawler.page.urls import absolute_url, canonical_url
from metric_base.errors import expect

#: Default delay between two requests to a site in seconds: the pace of a person who browses.
DELAY_SECONDS = 1.0


class Site(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Rules of a site. If an XPath is empty, schema.org data and headings are used."""

    name: str
    hosts: tuple[str, ...]  #: Regular expressions of whole host names, without `www.`.
    id: str = ""  #: Regular expression on the address whose first group is the id of the product.
    product_page: str = ""  #: Regular expression on addresses of products; empty: all.
    listing_page: str = ""  #: Regular expression on addresses of listings; empty: all.
    templates: tuple[str, ...] = ()  #: Start addresses with `{query}` or `{category}`.
    title: str = ""  #: XPath of an element or a text.
    category: str = ""  #: XPath of texts.
    brand: str = ""  #: XPath of an element or a text.
    images: str = ""  #: XPath of addresses.
    #: Order of the axes (`L x W x H`) of sizes next to links on listing pages; empty if listings state none.
    listed_order: str = ""
    #: Regular expression on addresses of images that the terms of the site allow to store; None if they allow none, so
    #: that only links are kept (reasons: `data/sources/SITES.md`).
    pictures: str | None = None
    ignored_parameters: str = ""  #: Regular expression on names of query parameters that do not change a page.
    delay_s: float = DELAY_SECONDS  #: Minimum delay between two requests.

    def __post_init__(self) -> None:
        expect(bool(re.fullmatch(r"[a-z0-9_]+", self.name)), "name", "small letters, digits and _", self.name)
        for name in ("product_page", "listing_page", "id", "pictures", "ignored_parameters"):
            _expect_pattern(name, getattr(self, name) or "")
        for pattern in self.hosts:
            _expect_pattern("hosts", pattern)
        for name in ("title", "category", "brand", "images"):
            _expect_xpath(name, getattr(self, name))
        expect(not self.id or re.compile(self.id).groups > 0, "id", "an expression with a group", self.id)
        for template in self.templates:
            parts = _FIELD.split(template)
            expect(not set("{}") & set("".join(parts)), "templates", "no fields but {query} and {category}", template)

    def owns(self, url: str) -> bool:
        """Return True if an address belongs to the site."""
        return self.owns_host(urlsplit(url).hostname or "")

    def owns_host(self, host: str) -> bool:
        """Return True if a host, with or without `www.`, belongs to the site."""
        return any(re.fullmatch(pattern, host.removeprefix("www.")) for pattern in self.hosts)

    def source(self, url: str) -> str:
        """Return the source of the items of a page: the name of the site, or the host if no site is declared."""
        return self.name if self.hosts else (urlsplit(url).hostname or self.name).removeprefix("www.")

    def canonical_url(self, url: str) -> str:
        """Return the canonical address of a page of the site (`crawler.page.urls.canonical_url`)."""
        return canonical_url(url, self.ignored_parameters)

    def is_product(self, url: str) -> bool:
        """Return True if an address is the page of a product."""
        return bool(re.search(self.product_page, url))

    def is_listing(self, url: str) -> bool:
        """Return True if an address lists products or categories."""
        return bool(re.search(self.listing_page, url))

    def may_store(self, image_url: str) -> bool:
        """Return True if the terms of the site allow to store an image."""
        return self.pictures is not None and bool(re.search(self.pictures, image_url))

    def addresses(self, query: str = "", category: str = "") -> Iterator[str]:
        """Return the start addresses: the templates filled with the query or the category."""
        given = {"query": quote_plus(query), "category": quote(category.strip("/"))}
        for template in self.templates:
            wanted = _FIELD.findall(template)
            if wanted and all(given[name[1:-1]] for name in wanted):
                yield _FIELD.sub(lambda field: given[field[0][1:-1]], template)

    def product(self, page: Page) -> Product:
        """Return the product of a page; fields without a rule are read from structured data and headings."""
        own_id = re.search(self.id, page.url) if self.id else None
        images = filter(None, (absolute_url(page.url, address) for address in _texts(page, self.images)))
        own = Product(
            id=own_id[1] if own_id else None,
            title=next(_texts(page, self.title), ""),
            category_path=tuple(_texts(page, self.category)),
            brand=next(_texts(page, self.brand), None),
            images=tuple(dict.fromkeys(images))[:MAX_IMAGES],
        )
        return product(page, own)

    def item(self, page: Page) -> RawItem:
        """Return the raw item of a product page of the site."""
        return page_item(page, self.source(page.url), self.product(page))


#: Fields of a template of addresses.
_FIELD = re.compile(r"\{query\}|\{category\}")
#: Numbers of elements of the pages on which an XPath is tried: libxml2 cannot be interrupted during a search, so an
#: XPath of quadratic cost would block a crawl.
_TRIAL_ELEMENTS = (4, 16, 64, 256, 1024)
#: Maximum processor time of a trial in seconds.
_TRIAL_SECONDS = 0.05
#: Maximum number of characters of an XPath; a deeply nested one might not end on the smallest trial.
_MAX_XPATH = 300


def _expect_pattern(field: str, pattern: str) -> None:
    try:
        re.compile(pattern)
    except re.error as error:
        expect(False, field, f"a regular expression ({error})", pattern)


def _expect_xpath(field: str, xpath: str) -> None:
    if not xpath:
        return
    expect(len(xpath) <= _MAX_XPATH and xpath.count("[") < 6, field, "a short XPath", xpath)
    try:
        for count in _TRIAL_ELEMENTS:
            began = time.process_time()
            answer = _compiled(xpath)(_trial_page(count))
            seconds = time.process_time() - began
            expect(isinstance(answer, list), field, "an XPath of elements, attributes or texts", xpath)
            expect(seconds < _TRIAL_SECONDS, field, "an XPath that is quick on a large page", xpath)
    except XPathError as error:
        expect(False, field, f"an XPath ({error})", xpath)


@cache
def _trial_page(count: int) -> Element:
    """Return a page with about `count` elements."""
    rows = "".join(f'<li class="x"><a href="/{n}">a <b>1</b></a></li>' for n in range(count // 3))
    page: Element = fromstring(f"<html><body><div><h1>a</h1><ul>{rows}</ul></div></body></html>", HTMLParser())
    return page


_compiled = cache(XPath)


def _texts(page: Page, xpath: str) -> Iterator[str]:
    for node in _compiled(xpath)(page.root) if xpath else ():
        text = squeeze(node if isinstance(node, str) else " ".join(node.itertext()))
        if text and text not in {"›", "/", ">"}:
            yield text
