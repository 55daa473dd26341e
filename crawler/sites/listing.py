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
        address = link.get("href") or ""
        url = absolute_url(page.url, address)
        if not url or url in seen or not site.is_product(url):
            continue
        entry = _size_and_text(link, url, page, site)
        if entry is None:
            continue
        seen.add(url)
        size, text = entry
        image = next(link.iter("img"), None)
        link_text = squeeze(" ".join(link.itertext())) or squeeze("" if image is None else image.get("alt") or "")
        own_id = re.search(site.id, url) if site.id else None
        yield RawItem(
            source=site.source(page.url),
            source_id=own_id[1] if own_id else source_id(url),
            url=url,
            title=link_text or re.split(r"[/?]", address.rstrip("/"))[-1],
            dimensions_text=text,
            dimensions_mm=size.dimensions_mm(),
            extents_mm=size.extents_mm(),
            retrieved_at=retrieved,
            flags=size.flags,
        )


def _size_and_text(link: Element, url: str, page: Page, site: Site) -> tuple[Size, str] | None:
    """Return the size in the entry of a link, and the text of the entry; None if there is no such entry."""
    box = link
    for _ in range(MAX_BOX_LEVELS):
        box = box.getparent()
        text = squeeze(" ".join(box.itertext())) if box is not None else ""
        if not text or len(text) > MAX_ENTRY:
            return None
        links = {absolute_url(page.url, other.get("href") or "") for other in box.iter("a")}
        if any(other and other != url and site.is_product(other) for other in links):
            return None
        read = sizes(text, site.listed_order, page.language)
        whole = [size for size in read if size.meaning == "whole" and len(size.lengths) == 3]
        if whole:
            return consensus(whole), text
    return None
