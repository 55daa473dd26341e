"""Items of listing pages that state the size of each item next to its link, such as tables and tiles of cars."""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import UTC, datetime

from crawler.items import RawItem
from crawler.page.page import Element, Page, squeeze
from crawler.page.urls import absolute_url, source_id
from crawler.sites.site import Site
from crawler.text.sizes import Size, consensus, sizes

#: Number of ancestors of a link that are searched for the box of its entry.
MAX_BOX_LEVELS = 5

#: Maximum number of characters of an entry; longer texts are the list itself or an article.
MAX_ENTRY = 600


def listed_items(page: Page, site: Site, now: datetime | None = None) -> Iterator[RawItem]:
    """Return an item for each link to a product next to which its three outer lengths are.

    The lengths belong to the link if the smallest box with both contains no link to another product.
    """
    retrieved = (now or datetime.now(UTC)).isoformat(timespec="seconds")
    seen: set[str] = set()
    for link in page.root.iter("a"):
        url = absolute_url(page.url, link.get("href") or "")
        if not url or url in seen or not site.is_product(url):
            continue
        entry = _entry(link, url, page, site)
        if entry is None:
            continue
        seen.add(url)
        size, text = entry
        yield RawItem(
            source=site.source(page.url),
            source_id=_own_id(site, url),
            url=url,
            title=_title(link),
            dimensions_text=text,
            dimensions_mm=size.dimensions_mm(),
            extents_mm=size.extents_mm(),
            retrieved_at=retrieved,
            flags=size.flags,
        )


def _entry(link: Element, url: str, page: Page, site: Site) -> tuple[Size, str] | None:
    here = link
    for _ in range(MAX_BOX_LEVELS):
        here = here.getparent()
        text = squeeze(" ".join(here.itertext())) if here is not None else ""
        if not text or len(text) > MAX_ENTRY or _leads_elsewhere(here, url, page, site):
            return None
        read = [size for size in sizes(text, site.listed_order, page.language) if len(size.lengths) == 3]
        size = consensus([size for size in read if size.meaning == "whole"])
        if size is not None:
            return size, text
    return None


def _leads_elsewhere(box: Element, url: str, page: Page, site: Site) -> bool:
    links = {absolute_url(page.url, link.get("href") or "") for link in box.iter("a")}
    return any(other and other != url and site.is_product(other) for other in links)


def _title(link: Element) -> str:
    """Return the text of the link, or that of its image, or the last part of its address."""
    picture = next(link.iter("img"), None)
    words = squeeze(" ".join(link.itertext())) or squeeze("" if picture is None else picture.get("alt") or "")
    return words or re.split(r"[/?]", (link.get("href") or "").rstrip("/"))[-1]


def _own_id(site: Site, url: str) -> str:
    match = re.search(site.id, url) if site.id else None
    return match[1] if match else source_id(url)
