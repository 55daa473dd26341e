"""Made-up pages of many shops: what a person reads on each is what the reader reads."""

from __future__ import annotations

import pytest

from crawler.page.page import page
from crawler.sites.registry import item_of
from tests.crawler.page.shop_pages import MADE, Made, document
from tests.crawler.page.shop_pages_fifty import FIFTY
from tests.crawler.page.shop_pages_found import FOUND
from tests.crawler.page.shop_pages_later import LATER, THIRD
from tests.crawler.page.shop_pages_more import MORE
from tests.crawler.page.shop_pages_stated import STATED

PAGES = [*MADE, *LATER, *THIRD, *FOUND, *STATED, *FIFTY, *MORE]

#: Flags that say how far a size may be trusted; a page states them or not.
TRUST = {"low_trust", "from_script", "contradicts_itself", "range", "no_size", "absurd_size", "placeholder"}


@pytest.mark.parametrize("made", PAGES, ids=[made.platform for made in PAGES])
def test_a_shop_reads_as_a_person_reads_it(made: Made) -> None:
    item = item_of(page(document(made), "https://shop.example/p/1"))
    assert item.extents_mm == (None if made.extents is None else pytest.approx(made.extents, abs=0.15))
    assert set(item.flags) & TRUST == set(made.flags)
    if made.words is not None:
        found = {axis: mm for axis, mm in item.dimensions_mm.items() if mm is not None}
        assert found == pytest.approx(made.words, abs=0.15)
