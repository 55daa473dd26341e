"""Filler text for product pages of a realistic size: tiles of other products, scripts and styles.

Its density is similar to sixteen saved real pages: per megabyte about 3,000 visible elements, 270 links and 170 texts
with a digit, half of which belong to other products and reviews. The remainder is scripts and attributes.
"""

from __future__ import annotations

from functools import cache

__all__ = ["REAL_SIZES", "filler"]

#: Sizes of the sixteen saved real pages in kB: median 959, mean 1,087.
REAL_SIZES = (235, 282, 310, 359, 362, 454, 654, 769, 1149, 1397, 1428, 1430, 1506, 1589, 2325, 3149)

#: Size of a block in bytes, and its number of links.
BLOCK_BYTES, LINKS = 10_000, 3

_TILE = """<div class="tile grid__cell grid__cell--third" data-component="tile" data-index="7"><a class="tile__link"
 href="/item/%d" title="A made chair of solid oak"><div class="tile__media"><img class="tile__image" loading="lazy"
 src="/images/tile.jpg" alt="A made chair of solid oak, seen from the front"></div>
 <span class="tile__title">A made chair of solid oak</span></a>
 <div class="%s"><span class="price__currency">EUR</span> <span class="price__amount">%s</span></div>
 <ul class="tile__tags"><li>Oak</li><li>Oiled</li></ul><p class="tile__text">Comes in many colours.</p></div>
"""

_STATE = (
    '{"id":"a1b2c3","kind":"chair","colour":"natural oak","inStock":true,"price":{"amount":129.0,"currency":"EUR"}},'
)


@cache
def _block() -> list[str]:
    """Return the parts of a block before, between and after the numbers of its links."""
    boxes = (("tile__price", "129.00"), ("tile__rating", "4.5"), ("tile__price", "on request"))
    tiles = "".join(_TILE.replace("%s", name, 1).replace("%s", text, 1) for name, text in boxes)
    tiles = f'<section class="shelf"><h3>More to see</h3>{tiles}</section>'
    style = "<style>" + ".tile__media{display:flex;margin:0 auto}" * 20 + "</style>"
    left = BLOCK_BYTES - len(tiles) - len(style) - 40
    script = "<script>window.__STATE__=[" + _STATE * (left // len(_STATE)) + "null];</script>\n"
    return (tiles + style + script).split("%d")


def filler(number: int, size: int, products: int) -> str:
    """Return about `size` bytes of HTML for the page of product `number`, with links to other products."""
    block = _block()
    parts: list[str] = []
    for index in range(max(0, round(size / BLOCK_BYTES))):
        for hole, text in enumerate(block):
            parts.append(text)
            if hole < LINKS:
                parts.append(str((number * 7919 + (LINKS * index + hole) * 104_729) % products))
    return "".join(parts)
