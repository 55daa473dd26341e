"""Product of a page from schema.org data (JSON-LD, microdata), Open Graph, breadcrumbs and headings."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import islice
from typing import Any

from lxml.etree import XPath

from crawler.page.page import Element, Page, squeeze
from crawler.page.urls import absolute_url

#: Maximum number of images of a product.
MAX_IMAGES = 12

#: Tags of breadcrumbs, and number of boxes with such a class that are examined.
_BREADCRUMB_TAGS, _BREADCRUMB_BOXES = ("nav", "ol", "ul", "div"), 3

_BREADCRUMB_MARKS = ("readcrumb", "readCrumb")

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
    """A product: the site's own id, title, breadcrumb, brand, images, and sizes as (label, text) pairs."""

    id: str | None = None
    title: str = ""
    category_path: tuple[str, ...] = ()
    brand: str | None = None
    images: tuple[str, ...] = ()
    sizes: tuple[tuple[str, str], ...] = ()


def product(page: Page, own: Product | None = None) -> Product:
    """The product of a page of any site; what `own`, the site's own rules, has found already is not looked for."""
    known = own or Product()
    nodes = _nodes(page, bool(known.category_path))
    product = next((node for node in nodes if _is(node, *_PRODUCT_TYPES)), {})
    title = known.title or _title(page, product)
    return Product(
        id=known.id or _first(product.get("sku"), product.get("productID"), product.get("mpn"), product.get("gtin13")),
        title=title,
        category_path=known.category_path or _breadcrumb(page, nodes, title) or _category(product),
        brand=known.brand or _name(product.get("brand")),
        images=known.images or _images(page, product),
        sizes=tuple(_sizes(product)),
    )


def _nodes(page: Page, has_category: bool) -> list[Mapping[str, Any]]:
    """The page's objects: JSON-LD, and microdata where JSON-LD does not name the item or its place."""
    nodes = [node for text in page.linked_data for node in _objects(_parse_json(text))]
    named = any(_is(node, *_PRODUCT_TYPES) for node in nodes)
    placed = has_category or any(_is(node, "BreadcrumbList") for node in nodes)
    return nodes if named and placed else nodes + list(_microdata(page))


def _microdata(page: Page) -> Iterator[Mapping[str, Any]]:
    if "itemtype" not in page.text or not _USEFUL_TYPE.search(page.text):
        return
    try:
        objects = _microdata_reader().extract_items(page.root, page.url)
    except (ValueError, TypeError, RecursionError):  # broken markup costs its microdata, not the page
        return
    for item in objects:
        properties = item.get("properties")
        if isinstance(properties, dict):
            yield {"@type": str(item.get("type", "")).rpartition("/")[2], **properties}


@cache
def _microdata_reader() -> Any:
    from extruct.w3cmicrodata import MicrodataExtractor

    wanted = [f"contains(@itemtype, 'schema.org/{kind}')" for kind in (*_PRODUCT_TYPES, "BreadcrumbList")]

    class Reader(MicrodataExtractor):  # type: ignore[misc]  # extruct has no types
        """Extruct's, for the items that are of use, without what they hold of opinions and offers.

        It would read every item of a page, and copy and clean each property of a page that is clean already.
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
        try:
            return json.loads(attempt, strict=False)
        except (ValueError, RecursionError):
            continue
    return None


def _objects(value: Any) -> Iterator[Mapping[str, Any]]:
    """The objects of a JSON-LD value: itself, its graph, the members of its list."""
    pending = [value]
    while pending:
        here = pending.pop()
        if isinstance(here, list):
            pending.extend(reversed(here[:MAX_OBJECTS]))
        elif isinstance(here, dict):
            yield here
            pending.extend(part for key in ("mainEntity", "@graph") if (part := here.get(key)))


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
    """An object of JSON-LD as it is, of microdata without the box around its properties."""
    return value.get("properties", value) if isinstance(value, dict) else value


def _quantity(value: Any) -> str | None:
    value = _flat(value[0] if isinstance(value, list) and value else value)
    if isinstance(value, dict):
        code = str(value.get("unitCode") or value.get("unitText") or "")
        amount = value.get("value")
        return (
            None
            if not isinstance(amount, str | int | float)
            else f"{amount} {_UNIT_CODES.get(code.upper(), code)}".strip()
        )
    return str(value) if isinstance(value, str | int | float) and str(value).strip() else None


def _breadcrumb(page: Page, nodes: list[Mapping[str, Any]], title: str) -> tuple[str, ...]:
    """Return the breadcrumb of the structured data, or the visible one."""
    declared: tuple[str, ...] = ()
    for node in nodes:
        if _is(node, "BreadcrumbList"):
            steps = [step for step in _list(node.get("itemListElement")) if isinstance(step, dict)]
            declared = _path([_step_name(step) for step in steps])
            break
    if any(step not in {title, "Shop"} for step in declared):
        return declared
    for box in islice(_breadcrumb_boxes(page), _BREADCRUMB_BOXES):
        path = _path([_text(link) for link in box.iter("a")])
        if path:
            return path
    return declared


def _breadcrumb_boxes(page: Page) -> Iterator[Element]:
    """Return boxes with a mark of breadcrumbs in class, id or label, then those with it in any attribute."""
    if not any(mark in page.text for mark in _BREADCRUMB_MARKS):
        return
    for names in (("class", "id", "aria-label"), None):
        for box in page.root.iter(*_BREADCRUMB_TAGS):
            said = box.values() if names is None else [box.get(name) or "" for name in names]
            if any(mark in value for value in said for mark in _BREADCRUMB_MARKS):
                yield box


def _step_name(step: Mapping[str, Any]) -> str | None:
    item = step.get("item")
    return _name(step) or (_name(item) if isinstance(item, dict) else None)


def _path(steps: list[str | None]) -> tuple[str, ...]:
    kept = [squeeze(step) for step in steps if step and squeeze(step)]
    return tuple(step for step in kept if step.lower() not in {"home", "startseite", "accueil", "inicio", "início"})[:8]


def _category(product: Mapping[str, Any]) -> tuple[str, ...]:
    text = product.get("category")
    if isinstance(text, list):
        text = text[0] if text else None
    return _path(_CATEGORY_MARKS.split(text)) if isinstance(text, str) else ()


def _images(page: Page, product: Mapping[str, Any]) -> tuple[str, ...]:
    listed = [_name(image, "url") or _name(image, "contentUrl") for image in _list(product.get("image"))]
    listed = listed or [_meta(page, "og:image")]
    addresses = [absolute_url(page.url, address) for address in listed if address]
    return tuple(dict.fromkeys(address for address in addresses if address))[:MAX_IMAGES]


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


def _title(page: Page, product: Mapping[str, Any]) -> str:
    heading, title = (next(page.root.iter(tag), None) for tag in ("h1", "title"))
    own = _first(product.get("name"), _meta(page, "og:title"))
    return own or _text(heading) or _text(title)


def _text(element: Element | None) -> str:
    return "" if element is None else squeeze(" ".join(element.itertext()))


def _meta(page: Page, name: str) -> str | None:
    named = (meta for meta in page.root.iter("meta") if name in {meta.get("property"), meta.get("name")})
    content = next((meta.get("content") for meta in named if meta.get("content") is not None), None)
    return None if content is None else squeeze(content)


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [] if value is None else [value]
