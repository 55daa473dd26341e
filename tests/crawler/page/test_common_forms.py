"""Forms of sizes that are frequent on pages of shops: units and parts in headings, ranges, sizes without packaging.

No page of `shops` has these forms. Without their rules, the size of a package or a seat becomes that of
the item.
"""

from __future__ import annotations

import pytest

from crawler.page.page import page
from crawler.page.product import product
from crawler.page.statements import page_item


def _table(width: str, depth: str, height: str) -> str:
    rows = (("Width", width), ("Depth", depth), ("Height", height))
    return "<table>" + "".join(f"<tr><td>{label}</td><td>{size}</td></tr>" for label, size in rows) + "</table>"


def _heading(text: str) -> str:
    return f'<div class="spec-title">{text}</div>'


SEAT = "<ul><li>Width: 45 cm</li><li>Depth: 44 cm</li><li>Height: 46 cm</li></ul>"
PACKAGE = _heading("Package dimensions") + _table("130 cm", "70 cm", "20 cm")


@pytest.mark.parametrize(
    ("title", "body", "extents_mm"),
    [
        ("Oak desk", "<h3>Dimensions (cm)</h3>" + _table("120", "60", "75"), [1200, 750, 600]),
        ("Oak desk", _heading("Dimensions (cm)") + _table("120", "60", "75"), [1200, 750, 600]),
        (
            "Oak desk",
            f"<div>{PACKAGE}{_heading('Product dimensions')}{_table('120 cm', '60 cm', '75 cm')}</div>",
            [1200, 750, 600],
        ),
        ("Oak chair", _heading("Seat") + SEAT, []),
        (
            "Lift desk",
            "<ul><li>Width: 120 cm</li><li>Depth: 60 cm</li><li>Height: 65 to 125 cm</li></ul>",
            [1200, 950, 600],
        ),
        ("Lamp", "<ul><li>Size without packaging: 30 x 20 x 50 cm</li></ul>", [500, 300, 200]),
        ("Sofa", "<ul><li>Width: 6' 11</li><li>Depth: 3'</li><li>Height: 2' 10\"</li></ul>", [2108.2, 914.4, 863.6]),
    ],
    ids=["unit in h3", "unit in a heading by class", "package above", "part", "range", "unpacked", "feet"],
)
def test_size_of_a_frequent_form(title: str, body: str, extents_mm: list[float]) -> None:
    text = f'<html lang="en"><head><title>{title}</title></head><body><h1>{title}</h1>{body}</body></html>'
    read = page(text.encode(), "https://shop.example/p/1")
    item = page_item(read, "generic", product(read))
    assert list(item.extents_mm or ()) == pytest.approx(extents_mm)
