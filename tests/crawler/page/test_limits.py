"""Each limit of the readers of pages, on both sides: the size is used at the limit and not beyond it."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest

from crawler.items import RawItem
from crawler.page.page import BadPage, page
from crawler.sites.listing import listed_items
from crawler.sites.registry import item_of
from crawler.sites.site import Site
from crawler.text import sizes
from tests.support.processor_time import processor_seconds

# Published values, written out so that a changed rule fails a test.
CONTEXT_WORDS = 5
MIN_NUMBERS_OF_PROSE = 3


def item(body: str, head: str = "") -> RawItem:
    text = f'<html lang="en"><head>{head}</head><body><h1>Lamp</h1>{body}</body></html>'
    return item_of(page(text.encode(), "https://shop.example/p/1"))


def words(count: int, unit: str = "a") -> str:
    """Return a text of `count` characters in words of five letters."""
    return (f"{unit * 5} " * count)[:count]


def nested(count: int, inner: str) -> str:
    return "<div>" * count + inner + "</div>" * count


def label(count: int) -> str:
    """Return a label of a height with `count` characters, and no words for other objects."""
    return "height" + " of" * (count % 2) + " a" * ((count - 6 - 3 * (count % 2)) // 2)


def linked(products: object) -> str:
    return f'<script type="application/ld+json">{json.dumps(products)}</script>'


#: limit, and a page with n of the limited parts
SIZE_LIMITS: dict[str, tuple[int, Callable[[int], str]]] = {
    "characters of a label": (
        70,
        lambda n: f"<div><div>{label(n)}</div><div>30 cm</div></div>",
    ),
    "characters of a boxed value": (
        260,
        lambda n: f"<div><div>Width</div><div>{f'30 cm {words(n)}'[: n - 1]}b</div></div>",
    ),
    "characters of a value": (
        520,
        lambda n: f"<table><tr><td>Size</td><td>{f'3 x 4 x 5 cm {words(n)}'[: n - 1]}b</td></tr></table>",
    ),
    "cells of a row": (
        40,
        lambda n: f"<table><tr><td>Width</td>{'<td>30 cm</td>' * (n - 2)}<td>300 mm</td></tr></table>",
    ),
    "boxes in a row": (
        12,
        lambda n: f"<div>{'<i>-</i>' * (n - 2)}<b>Width</b><span>30 cm</span></div>",
    ),
    "elements before a value": (
        8,
        lambda n: f"<dl><dt>Width</dt>{'<dd>blue</dd>' * (n - 1)}<dd>30 cm</dd></dl>",
    ),
    "levels between a label and its value": (
        5,
        lambda n: f"<div><div>Width</div>{nested(n, '30 cm')}</div>",
    ),
    "levels below a heading": (
        8,
        lambda n: (
            f"<h2>Dimensions</h2>{nested(n, '<table><tr><td>Lamp</td><td>30 x 40 cm</td></tr></table>')}<h3>Other</h3>"
        ),
    ),
    "characters of a box with a heading": (
        70,
        lambda n: (
            f"<div><h2>Dimensions</h2> {words(n - 12)}b</div><table><tr><td>Lamp</td><td>30 x 40 cm</td></tr></table>"
        ),
    ),
    "texts of a cell": (
        80,
        lambda n: f"<table><tr><td>Size</td><td>{'<i>a</i>' * (n - 1)}<i>3 x 4 cm</i></td></tr></table>",
    ),
    "objects of linked data": (
        200,
        lambda n: linked([{}] * (n - 1) + [{"@type": "Product", "width": "30 cm"}]),
    ),
}


@pytest.mark.parametrize(("limit", "body"), SIZE_LIMITS.values(), ids=SIZE_LIMITS)
def test_a_size_is_read_up_to_a_limit(limit: int, body: Callable[[int], str]) -> None:
    assert item(body(limit)).extents_mm is not None
    assert item(body(limit + 1)).extents_mm is None


#: limit, and a page with n of the limited parts whose size is trusted up to the limit
TRUST_LIMITS: dict[str, tuple[int, Callable[[int], str]]] = {
    "characters of a line": (90, lambda n: f"<div>Width: 30 cm<br>{words(n - 1)}b</div>"),
    "levels of a list entry": (
        2,
        lambda n: f"<ul><li>{'<span>' * n}Width: 30 cm{'</span>' * n}</li></ul>",
    ),
}


@pytest.mark.parametrize(("limit", "body"), TRUST_LIMITS.values(), ids=TRUST_LIMITS)
def test_a_size_is_trusted_up_to_a_limit(limit: int, body: Callable[[int], str]) -> None:
    assert (item(body(limit)).extents_mm, item(body(limit)).flags) == ((300,), ())
    assert "low_trust" in item(body(limit + 1)).flags or item(body(limit + 1)).extents_mm is None


def test_prose_without_a_word_for_sizes_needs_three_numbers() -> None:
    assert MIN_NUMBERS_OF_PROSE == 3
    assert item("<p>30 W x 40 D x 50 H cm</p>").extents_mm == (500, 400, 300)
    assert item("<p>30 W x 40 D cm</p>").extents_mm is None


@pytest.mark.parametrize("excess", [0, 1])
def test_long_texts_are_cut_and_long_ids_replaced(excess: int) -> None:
    data = {
        "@type": "Product",
        "name": "a" * (1000 + excess),
        "sku": "b" * (200 + excess),
    }
    read = item("", linked({**data, "brand": "c" * (200 + excess)}))
    assert read.title == "a" * 1000
    assert read.brand == "c" * 200
    assert (read.source_id == "b" * 200) is (excess == 0)


def test_images_beyond_a_maximum_are_left_out() -> None:
    for count, expected in ((12, 12), (13, 12)):
        data = {"@type": "Product", "image": [f"https://shop.example/{i}.jpg" for i in range(count)]}
        assert len(item("", linked(data)).images) == expected


@pytest.mark.parametrize(("position", "extents"), [(50 - 1, None), (50, (300,))])
def test_a_size_must_be_common_to_the_first_variants(position: int, extents: tuple[float, ...] | None) -> None:
    variants = [{"@type": "Product", "width": "30 cm"} for _ in range(50 + 1)]
    variants[position]["width"] = "40 cm"
    assert item("", linked({"@type": "Product", "hasVariant": variants})).extents_mm == extents


@pytest.mark.parametrize("excess", [0, 1])
def test_a_breadcrumb_is_in_one_of_the_first_boxes(excess: int) -> None:
    boxes = '<div class="breadcrumb"></div>' * (3 - 1 + excess)
    path = item(f'{boxes}<div class="breadcrumb"><a href="/l">Lamps</a></div>').category_path
    assert path == (() if excess else ("Lamps",))


CARS = Site(name="cars", hosts=("cars.example",), product_page="/car/", listed_order="L x W x H")


@pytest.mark.parametrize(
    ("limit", "body"),
    [
        (
            5,
            lambda n: f"<div>4 x 2 x 1 m {nested(n - 1, '<a href=/car/1>One</a>')}</div>",
        ),
        (
            600,
            lambda n: f"<div><a href='/car/1'>One</a>{f' 4 x 2 x 1 m {words(n)}'[: n - 4]}b</div>",
        ),
    ],
    ids=["levels of an entry", "characters of an entry"],
)
def test_an_entry_of_a_listing_has_limits(limit: int, body: Callable[[int], str]) -> None:
    for count, expected in ((limit, [(4000, 2000, 1000)]), (limit + 1, [])):
        text = f"<html><body><section><p>{words(700)}</p>{body(count)}</section></body></html>"
        listed = listed_items(page(text.encode(), "https://cars.example/list"), CARS)
        assert [entry.extents_mm for entry in listed] == expected


@pytest.mark.parametrize(
    ("text", "flags"),
    [
        ("0.3 mm", set()),
        ("0.2 mm", {"absurd_size"}),
        ("60 m", set()),
        ("60.1 m", {"absurd_size"}),
        ("1 x 1 x 1 cm", {"placeholder"}),
        ("0.1 x 0.1 x 0.1 m", {"placeholder"}),
        ("1 x 1 cm", set()),
        ("1 x 1 x 2 cm", set()),
    ],
)
def test_implausible_sizes_are_flagged(text: str, flags: set[str]) -> None:
    body = (
        f"<table><tr><td>Overall width</td><td>{text}</td></tr></table>"
        if "x" not in text
        else f"<li>Size: {text}</li>"
    )
    assert {"absurd_size", "placeholder"} & set(item(body).flags) == flags


@pytest.mark.parametrize(
    ("text", "contradicts"),
    [
        ("100 cm / 1060 mm", False),  # 5.7 % of the larger
        ("100 cm / 1070 mm", True),  # 6.5 %
        ("10 mm / 1.6 cm", False),  # 6 mm
        ("10 mm / 1.7 cm", True),
    ],
)
def test_two_systems_of_units_agree_within_their_rounding(text: str, contradicts: bool) -> None:
    size = sizes.consensus(sizes.sizes(text, "Width"))
    assert ("contradicts_itself" in size.flags) is contradicts


def test_the_last_words_before_a_length_name_its_part() -> None:
    assert CONTEXT_WORDS == 5
    for n_words, meaning in ((4, "component"), (5, "whole")):
        (size,) = sizes.sizes(f"seat {'blue ' * n_words}30 x 40 cm")
        assert size.meaning == meaning


def test_a_size_of_structured_data_yields_to_the_table_of_the_page() -> None:
    data = linked({"@type": "Product", "size": "50 x 60 cm"})
    assert item("<ul><li>Size: 30 x 40 cm</li></ul>", data).extents_mm == (400, 300)
    assert item("<ul><li>Size: 30 x 40 cm</li></ul>", data).flags == ()
    assert item("", data).extents_mm == (600, 500)


def test_microdata_completes_linked_data_without_a_product() -> None:
    crumbs = linked({"@type": "BreadcrumbList", "itemListElement": [{"name": "Lamps"}]})
    desk = '<div itemscope itemtype="https://schema.org/Product"><b itemprop="name">Desk</b></div>'
    assert (item(desk, crumbs).title, item(desk, crumbs).category_path) == ("Desk", ("Lamps",))
    both = linked(
        [{"@type": "Product", "name": "Shelf"}, {"@type": "BreadcrumbList", "itemListElement": [{"name": "Lamps"}]}]
    )
    assert item(desk, both).title == "Shelf"


@pytest.mark.parametrize(
    "tag", ["<p {}>", "<HTML {}>", "<svg><script {}>", "<p title='>' {}>", '<a b="c"{}>', "<p/{}>"]
)
def test_tag_with_more_attributes_than_the_limit_is_refused_quickly(tag: str) -> None:
    def parse(count: int) -> None:
        names = "/".join(f"a{number}" for number in range(count))
        page(f"<html lang=en><body>{tag.format(names)}</body>".encode(), "https://shop.example/p/1")

    parse(200)

    def parse_many() -> None:
        with pytest.raises(BadPage, match="expected at most 250 attributes of a tag"):
            parse(30_000)  # 5 s in the parser of trees

    assert processor_seconds(parse_many, 1) < 1


def test_attributes_of_repeated_root_tags_count_together() -> None:
    def parse(count: int) -> None:
        page("".join(f"<html a{number}=1>" for number in range(count)).encode(), "https://shop.example/p/1")

    parse(250)
    with pytest.raises(BadPage, match="expected at most 250 attributes of a tag"):
        parse(251)


@pytest.mark.parametrize("codec", ["idna", "rot13", "zlib_codec", "punycode", "undefined"])
@pytest.mark.parametrize("header", [None, "text/html; charset={}"])
def test_codec_that_is_no_encoding_of_pages_is_ignored(codec: str, header: str | None) -> None:
    text = f"<html><head><meta charset={codec}></head><body><p>stra\u00dfe</p></body></html>"
    read = page(text.encode(), "https://shop.example/p/1", header and header.format(codec))
    assert read.root.findtext(".//p") == "stra\u00dfe"
