"""Product of a page from schema.org data (JSON-LD, microdata), Open Graph, breadcrumbs and headings."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import islice
from typing import Any

from lxml.etree import XPath

from crawler.page.page import Element, Page, squeeze
from crawler.page.urls import absolute_url

#: Maximum number of images of a product.
MAX_IMAGES = 12

#: Number of boxes that are examined for a breadcrumb.
MAX_BREADCRUMB_BOXES = 3
_BREADCRUMB_TAGS = ("nav", "ol", "ul", "div")
_BREADCRUMB_MARKS = ("readcrumb", "readCrumb")
_BREADCRUMB_ATTRIBUTES = ("class", "id", "aria-label")

#: Separators of the steps of a category; shops also write `Home & Living < Vases`, in the same order.
_CATEGORY_MARKS = re.compile("[/<>]")

#: Types of schema.org that are items with a size.
_PRODUCT_TYPES = ("Product", "ProductGroup", "IndividualProduct", "ProductModel", "Book")
_USEFUL_TYPE = re.compile(rf"schema\.org/(?:{'|'.join(_PRODUCT_TYPES)}|BreadcrumbList)\b")

#: Long properties without information on the item.
_UNREAD = frozenset({"review", "reviews", "offers", "aggregateRating", "isRelatedTo", "isSimilarTo"})

_AXES = ("width", "height", "depth", "length", "diameter", "size")

#: Maximum number of variants of a product that are compared.
MAX_VARIANTS = 50

#: Maximum number of objects of a list that are examined.
MAX_OBJECTS = 200

#: UN/CEFACT codes that schema.org's QuantitativeValue uses.
_UNIT_CODES = {"MMT": "mm", "CMT": "cm", "MTR": "m", "INH": "in", "FOT": "ft"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Product:
    """A product of a page."""

    id: str | None = None
    title: str = ""
    category_path: tuple[str, ...] = ()  #: Breadcrumb.
    brand: str | None = None
    images: tuple[str, ...] = ()  #: Addresses.
    sizes: tuple[tuple[str, str], ...] = ()  #: Labels and texts of structured data.


def product(page: Page, known: Product | None = None) -> Product:
    """Return the product of a page.

    Parameters
    ----------
    page : Page
    known : Product, optional
        Fields that the rules of the site have determined; only the others are searched.
    """
    known = known or Product()
    nodes = _structured_data(page, bool(known.category_path))
    data = next((node for node in nodes if _is(node, *_PRODUCT_TYPES)), {})
    heading, page_title = (next(page.root.iter(tag), None) for tag in ("h1", "title"))
    title = known.title or _first(data.get("name"), _meta(page, "og:title")) or _text(heading) or _text(page_title)
    category_path = known.category_path or _breadcrumb(page, nodes, title)
    if not category_path:
        category = data.get("category")
        category = category[0] if isinstance(category, list) and category else category
        category_path = _path(_CATEGORY_MARKS.split(category)) if isinstance(category, str) else ()
    images = known.images
    if not images:
        listed = [_name(image, "url") or _name(image, "contentUrl") for image in _list(data.get("image"))]
        addresses = (absolute_url(page.url, url) for url in listed or [_meta(page, "og:image")] if url)
        images = tuple(dict.fromkeys(filter(None, addresses)))[:MAX_IMAGES]
    return Product(
        id=known.id or _first(data.get("sku"), data.get("productID"), data.get("mpn"), data.get("gtin13")),
        title=title,
        category_path=category_path,
        brand=known.brand or _name(data.get("brand")),
        images=images,
        sizes=tuple(_sizes(data)),
    )


def _structured_data(page: Page, has_category: bool) -> list[Mapping[str, Any]]:
    """Return the objects of the JSON-LD, and those of the microdata if the product or its breadcrumb is missing."""
    nodes: list[Mapping[str, Any]] = []
    for text in page.linked_data:
        pending = [_parse_json(text)]
        while pending:
            value = pending.pop()
            if isinstance(value, list):
                pending.extend(reversed(value[:MAX_OBJECTS]))
            elif isinstance(value, dict):
                nodes.append(value)
                pending.extend(part for key in ("mainEntity", "@graph") if (part := value.get(key)))
    has_product = any(_is(node, *_PRODUCT_TYPES) for node in nodes)
    has_category = has_category or any(_is(node, "BreadcrumbList") for node in nodes)
    if (has_product and has_category) or "itemtype" not in page.text or not _USEFUL_TYPE.search(page.text):
        return nodes
    # invalid markup makes the microdata useless, but not the page
    with suppress(ValueError, TypeError, RecursionError):
        for item in _microdata_reader().extract_items(page.root, page.url):
            properties = item.get("properties")
            if isinstance(properties, dict):
                nodes.append({"@type": str(item.get("type", "")).rpartition("/")[2], **properties})
    return nodes


@cache
def _microdata_reader() -> Any:
    from extruct.w3cmicrodata import MicrodataExtractor

    wanted = [f"contains(@itemtype, 'schema.org/{kind}')" for kind in (*_PRODUCT_TYPES, "BreadcrumbList")]

    class Reader(MicrodataExtractor):  # type: ignore[misc]  # extruct has no types
        """Extractor of products and breadcrumbs without reviews and offers.

        The base class reads all items of a page, and copies and cleans each property, although the page is clean.
        """

        _xp_item = XPath(f"descendant-or-self::*[@itemscope][{' or '.join(wanted)}]")

        def get_docid(self, node: Element, _: object) -> Element:
            return node

        def _extract_property(self, node: Element, **named: Any) -> list[Any]:
            return [] if node.get("itemprop") in _UNREAD else super()._extract_property(node, **named)

        def _extract_textContent(self, node: Element) -> str:  # noqa: N802 - extruct's name
            return _text(node)

    return Reader(strict=False)


def _parse_json(text: str) -> Any:
    text = text.strip().removeprefix("<!--").removesuffix("-->").strip().rstrip(";")
    for attempt in (text, html.unescape(text)):
        with suppress(ValueError, RecursionError):
            return json.loads(attempt, strict=False)
    return None


def _is(node: Mapping[str, Any], *names: str) -> bool:
    types = node.get("@type")
    return any(str(kind).rpartition("/")[2] in names for kind in (types if isinstance(types, list) else [types]))


def _sizes(product: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Return label and text of the sizes in the data of an item; of variants only common ones."""
    for axis in _AXES:
        if text := _quantity(product.get(axis)):
            yield axis, text
    for extra in _list(product.get("additionalProperty")):
        known = _flat(extra)
        label = known.get("name") if isinstance(known, dict) else None
        if isinstance(label, str) and (text := _quantity(known)):
            yield squeeze(label), text
    variants = [
        tuple(_sizes(part)) for part in _list(product.get("hasVariant"))[:MAX_VARIANTS] if isinstance(part, dict)
    ]
    if variants and all(sizes == variants[0] for sizes in variants):
        yield from variants[0]


def _flat(value: Any) -> Any:
    """Return the properties of an object of JSON-LD or microdata."""
    return value.get("properties", value) if isinstance(value, dict) else value


def _quantity(value: Any) -> str | None:
    value = _flat(value[0] if isinstance(value, list) and value else value)
    if isinstance(value, dict):
        code = str(value.get("unitCode") or value.get("unitText") or "")
        amount = value.get("value")
        known = isinstance(amount, str | int | float)
        return f"{amount} {_UNIT_CODES.get(code.upper(), code)}".strip() if known else None
    return str(value) if isinstance(value, str | int | float) and str(value).strip() else None


def _breadcrumb(page: Page, nodes: Sequence[Mapping[str, Any]], title: str) -> tuple[str, ...]:
    """Return the breadcrumb of the structured data, or the visible one if the former has no category."""
    declared: tuple[str, ...] = ()
    if (breadcrumb := next((node for node in nodes if _is(node, "BreadcrumbList")), None)) is not None:
        steps = [step for step in _list(breadcrumb.get("itemListElement")) if isinstance(step, dict)]
        items = ((step, step.get("item")) for step in steps)
        declared = _path([_name(step) or (_name(item) if isinstance(item, dict) else None) for step, item in items])
    is_empty = all(step in {title, "Shop"} for step in declared)
    if not is_empty or not any(mark in page.text for mark in _BREADCRUMB_MARKS):
        return declared
    boxes = (
        box
        for names in (_BREADCRUMB_ATTRIBUTES, None)  # then any attribute
        for box in page.root.iter(*_BREADCRUMB_TAGS)
        for values in (box.values() if names is None else [box.get(name) or "" for name in names],)
        if any(mark in value for value in values for mark in _BREADCRUMB_MARKS)
    )
    paths = (_path([_text(link) for link in box.iter("a")]) for box in islice(boxes, MAX_BREADCRUMB_BOXES))
    return next(filter(None, paths), declared)


def _path(steps: list[str | None]) -> tuple[str, ...]:
    kept = [squeeze(step) for step in steps if step and squeeze(step)]
    return tuple(step for step in kept if step.lower() not in {"home", "startseite", "accueil", "inicio", "início"})[:8]


def _name(value: Any, key: str = "name") -> str | None:
    if isinstance(value, list):
        value = value[0] if value else None
    if isinstance(value, dict):
        value = value.get(key) or value.get("properties", {}).get(key)
    return squeeze(html.unescape(value)) if isinstance(value, str) and value.strip() else None


def _first(*values: Any) -> str | None:
    for value in values:
        text = str(value[0] if isinstance(value, list) and value else value or "")
        if squeeze(text):
            return squeeze(html.unescape(text))
    return None


def _text(element: Element | None) -> str:
    return "" if element is None else squeeze(" ".join(element.itertext()))


def _meta(page: Page, name: str) -> str | None:
    named = (meta for meta in page.root.iter("meta") if name in {meta.get("property"), meta.get("name")})
    content = next((meta.get("content") for meta in named if meta.get("content") is not None), None)
    return None if content is None else squeeze(content)


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [] if value is None else [value]
