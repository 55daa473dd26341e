"""From a page to a raw item: what the product is, and the size that the page states of it."""

from __future__ import annotations

from datetime import UTC, datetime

from crawler.items import RawItem
from crawler.page.page import Page
from crawler.page.page import source_id as hashed_url
from crawler.page.product import Product, product
from crawler.page.size_statements import PROSE, SCRIPT, Statement, best_statement, statements
from crawler.text.sizes import Size

__all__ = ["raw_item"]

#: Most letters of a title or a statement, and of an id, a brand or a category, that an item keeps: a page may have
#: megabytes of them, shops have a hundred.
LONGEST_TEXT, LONGEST_WORD = 1000, 200


def raw_item(page: Page, source: str, own: Product | None = None, now: datetime | None = None) -> RawItem:
    """The raw item of a page; `extents_mm` is None where the page states no product size.

    Parameters
    ----------
    source : the name of the spider that owns the page's site.
    own : what the site's own rules say of the product; what they leave out is read from the page's structured data.
    """
    known = product(page) if own is None else own
    best = best_statement(statements(page, known.sizes, known.title))
    flags = _flags(best)
    return RawItem(
        source=source,
        source_id=known.id if known.id and len(known.id) <= LONGEST_WORD else hashed_url(page.url),
        url=page.url,
        title=known.title[:LONGEST_TEXT],
        category_path=tuple(step[:LONGEST_WORD] for step in known.category_path),
        brand=known.brand and known.brand[:LONGEST_WORD],
        dimensions_text=best.text[:LONGEST_TEXT] if best else None,
        dimensions_mm=_words(best.size) if best else {},
        extents_mm=best.size.extents_mm() if best else None,
        images=known.images,
        retrieved_at=(now or datetime.now(UTC)).isoformat(timespec="seconds"),
        flags=flags,
    )


def _words(size: Size) -> dict[str, float | None]:
    named = size.dimensions_mm()
    return {axis: named.get(axis) for axis in ("length", "width", "height", "diameter", "depth")} if named else {}


def _flags(best: Statement | None) -> tuple[str, ...]:
    if best is None:
        return ("no_size",)
    low = ("low_trust",) if best.trust == PROSE else ()
    script = ("from_script",) if best.trust == SCRIPT else ()
    return (*low, *script, *best.size.flags)
