"""Synthetic shop pages in `shops`, with the size, the axes and the flags that a reader of the page expects.

The pages are in the markup of common shop platforms, in seven languages, with packages, parts, other products, several
units, ranges, orders of axes and units in headers. The project wrote them, and their expectations before the reader ran
on them. Two known errors are expected as errors: Polish is not supported, and a bed size in words has no axes.

`expected.csv` has one row per page. `extents_mm` is the outer size, longest first, or empty if there is none.
`dimensions_mm` is the size by axis; it is `none` if the page names no axis, and empty if the axes are not checked.
`set` is the series of pages, in the order of writing (docs/evidence/crawling.md and releases.md).
"""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from crawler.page.page import saved_page
from crawler.sites.registry import item_of

FOLDER = Path(__file__).parent / "shops"
EXPECTED = list(csv.DictReader((FOLDER / "expected.csv").read_text(encoding="utf-8").splitlines()))

#: Flags that concern the trust in a size.
TRUST = {"low_trust", "from_script", "contradicts_itself", "range", "no_size", "absurd_size", "placeholder"}


@pytest.mark.parametrize("expected", EXPECTED, ids=[row["page"].removesuffix(".html") for row in EXPECTED])
def test_the_size_of_a_shop_page(expected: dict[str, str]) -> None:
    item = item_of(saved_page(FOLDER / expected["page"], "https://shop.example/p/1"))
    extents = tuple(float(part) for part in expected["extents_mm"].split(" x ") if part)
    assert item.extents_mm == (pytest.approx(extents, abs=0.15) if extents else None)
    assert set(item.flags) & TRUST == set(expected["flags"].split())
    if expected["dimensions_mm"]:
        pairs = (part.rpartition(" ") for part in expected["dimensions_mm"].split("; ") if part != "none")
        stated = {axis: mm for axis, mm in item.dimensions_mm.items() if mm is not None}
        assert stated == pytest.approx({axis: float(mm) for axis, _, mm in pairs}, abs=0.15)


def test_each_page_has_one_expectation() -> None:
    assert [row["page"] for row in EXPECTED] == sorted(path.name for path in FOLDER.glob("*.html"))
