"""The rules of a site, as data: where its title, breadcrumb, brand and pictures are, and what its ids look like."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from functools import cache
from urllib.parse import quote, quote_plus, urlsplit

import msgspec
from lxml.etree import HTMLParser, XPath, XPathError, fromstring

from crawler.page.page import Element, Page, squeeze
from crawler.page.product import MAXIMUM_IMAGES, Product, product
from crawler.page.urls import absolute_url, canonical_url
from metric_base.errors import expect


class Site(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A site's rules; every XPath may be empty, then schema.org data and headings serve.

    hosts : regular expressions of whole host names, without `www.`.
    product_page, listing_page : regular expressions on addresses; empty ones match all.
    templates : addresses to begin with, with `{query}` or `{category}` to be filled in.
    id : a regular expression on the address whose first group is the site's own id of the product.
    category, images : XPaths that yield texts and addresses; title, brand : XPaths of an element or text.
    listed_order : the order of axes (`L x W x H`) of sizes beside links on listing pages; empty where
        listings state none.
    pictures : a regular expression of the pictures' addresses that the site's terms allow to store; None where they
        allow none: then the links alone are kept. `data/sources/SITES.md` says why.
    ignored_parameters : a regular expression of the names of query parameters that do not change a page of this site.
    """

    name: str
    hosts: tuple[str, ...]
    id: str = ""
    product_page: str = ""
    listing_page: str = ""
    templates: tuple[str, ...] = ()
    title: str = ""
    category: str = ""
    brand: str = ""
    images: str = ""
    listed_order: str = ""
    pictures: str | None = None
    ignored_parameters: str = ""

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
        """Whether an address belongs to the site."""
        return self.owns_host(urlsplit(url).hostname or "")

    def owns_host(self, host: str) -> bool:
        """Whether a host, with or without `www.`, belongs to the site."""
        return any(re.fullmatch(pattern, host.removeprefix("www.")) for pattern in self.hosts)

    def source(self, url: str) -> str:
        """The source of items of a page: the site's name; of any other site its host, so that two shops are two."""
        return self.name if self.hosts else (urlsplit(url).hostname or self.name).removeprefix("www.")

    def canonical_url(self, url: str) -> str:
        """The address by which the site's page is known, `crawler.page.page.canonical_url`."""
        return canonical_url(url, self.ignored_parameters)

    def is_product(self, url: str) -> bool:
        """Whether an address is a product's page."""
        return bool(re.search(self.product_page, url))

    def is_listing(self, url: str) -> bool:
        """Whether an address lists products or categories."""
        return bool(re.search(self.listing_page, url))

    def may_store(self, picture_url: str) -> bool:
        """Whether a picture may be stored, by what is known of the site's terms."""
        return self.pictures is not None and bool(re.search(self.pictures, picture_url))

    def addresses(self, query: str = "", category: str = "") -> Iterator[str]:
        """Addresses to begin with: the templates that what is given fills."""
        given = {"query": quote_plus(query), "category": quote(category.strip("/"))}
        for template in self.templates:
            wanted = _FIELD.findall(template)
            if wanted and all(given[name[1:-1]] for name in wanted):
                yield _FIELD.sub(lambda field: given[field[0][1:-1]], template)

    def product(self, page: Page) -> Product:
        """The product of one of the site's pages; what its rules do not find is read as on any site."""
        own_id = re.search(self.id, page.url) if self.id else None
        images = filter(None, (absolute_url(page.url, address) for address in _texts(page, self.images)))
        own = Product(
            id=own_id[1] if own_id else None,
            title=next(_texts(page, self.title), ""),
            category_path=tuple(_texts(page, self.category)),
            brand=next(_texts(page, self.brand), None),
            images=tuple(dict.fromkeys(images))[:MAXIMUM_IMAGES],
        )
        return product(page, own)


#: What a template of addresses may hold.
_FIELD = re.compile(r"\{query\}|\{category\}")
#: An XPath is tried on pages of so many elements and may take so much processor time on each: libxml2 cannot be
#: interrupted while it looks, so one that takes the square of a page would keep a crawl from the next.
_TRIED_ON, _TRIAL_SECONDS = (4, 16, 64, 256, 1024), 0.05
#: Longest XPath; a longer one could nest so deep that even the smallest trial would not end.
_LONGEST_XPATH = 300


def _expect_pattern(field: str, pattern: str) -> None:
    try:
        re.compile(pattern)
    except re.error as error:
        expect(False, field, f"a regular expression ({error})", pattern)


def _expect_xpath(field: str, xpath: str) -> None:
    if not xpath:
        return
    expect(len(xpath) <= _LONGEST_XPATH and xpath.count("[") < 6, field, "a short XPath", xpath)
    try:
        for count in _TRIED_ON:
            began = time.process_time()
            answer = _compiled(xpath)(_trial_page(count))
            seconds = time.process_time() - began
            expect(isinstance(answer, list), field, "an XPath of elements, attributes or texts", xpath)
            expect(seconds < _TRIAL_SECONDS, field, "an XPath that is quick on a large page", xpath)
    except XPathError as error:
        expect(False, field, f"an XPath ({error})", xpath)


@cache
def _trial_page(count: int) -> Element:
    """A page of so many elements: lists of links and texts in each other."""
    rows = "".join(f'<li class="x"><a href="/{n}">a <b>1</b></a></li>' for n in range(count // 3))
    page: Element = fromstring(f"<html><body><div><h1>a</h1><ul>{rows}</ul></div></body></html>", HTMLParser())
    return page


_compiled = cache(XPath)


def _texts(page: Page, xpath: str) -> Iterator[str]:
    for node in _compiled(xpath)(page.root) if xpath else ():
        text = squeeze(node if isinstance(node, str) else " ".join(node.itertext()))
        if text and text not in {"›", "/", ">"}:
            yield text
