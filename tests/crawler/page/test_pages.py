"""Pages in the markup of each site, written by ourselves, and pages that mean harm."""

from __future__ import annotations

import gzip
import json
import re
from contextlib import nullcontext, suppress
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crawler.items import RawItem
from crawler.page.page import BadPage, other_content, page, saved_page
from crawler.page.urls import canonical_url
from crawler.sites.registry import SITES, item_of, site_of
from crawler.sites.site import Site
from metric_cli.subcommands import main
from tests.support.processor_time import processor_seconds

# Published values, written out so that a changed rule fails a test.
MAX_BYTES = 32000000


def item(body: str, url: str = "https://shop.example/p/1", head: str = "") -> RawItem:
    return item_of(page(f'<html lang="en"><head>{head}</head><body>{body}</body></html>'.encode(), url))


@pytest.mark.parametrize(
    ("head", "crumbs"),
    [
        ('{"@type": "Product", "name": "Vase", "category": "Home & Living < Decor < Vases"}', ""),
        (
            '{"@type": "BreadcrumbList", "itemListElement": [{"name": "Home"}, {"name": "Shop"}, {"name": "Vase"}]}',
            '<nav data-test="breadCrumbs"><a>Home</a><a>Home & Living</a><a>Decor</a><a>Vases</a> Vase</nav>',
        ),
    ],
    ids=["angles", "data without a category"],
)
def test_a_category_is_found_where_the_page_shows_it(head: str, crumbs: str) -> None:
    found = item(f"{crumbs}<h1>Vase</h1>", head=f'<script type="application/ld+json">{head}</script>')
    assert found.category_path == ("Home & Living", "Decor", "Vases")


def test_what_holds_the_title_is_the_product_whatever_its_class() -> None:
    row = "<tr><th>Dimensions</th><td>80 &times; 24 &times; 15.5 cm</td></tr>"
    body = '<div class="product instock {}">{}<table class="shop_attributes">' + row + "</table></div>"
    assert item(body.format("shipping-taxable purchasable", "<h1>Oak shelf</h1>")).extents_mm == (800.0, 240.0, 155.0)
    assert item("<h1>Oak shelf</h1>" + body.format("shipping", "")).extents_mm is None, "the size of a parcel"


def test_amazon_table_and_breadcrumb() -> None:
    body = """
    <span id="productTitle"> Oak stool </span>
    <div id="wayfinding-breadcrumbs_feature_div"><ul><li><a>Home &amp; Kitchen</a></li><li>›</li>
    <li><a>Stools</a></li></ul></div>
    <table id="productDetails_techSpec_section_1">
      <tr><th>Product Dimensions</th><td>\u200e16"D x 17"W x 29"H</td></tr>
      <tr><th>Item Weight</th><td>9.5 pounds</td></tr></table>
    <table><tr><th>Package Dimensions</th><td>40 x 20 x 10 inches</td></tr></table>
    """
    found = item(body, "https://www.amazon.com/Oak-Stool/dp/B0ABCDEFGH?th=1")
    assert (found.source, found.source_id) == ("amazon", "B0ABCDEFGH")
    assert (found.title, found.category_path) == ("Oak stool", ("Home & Kitchen", "Stools"))
    assert found.dimensions_mm == {"length": None, "width": 431.8, "height": 736.6, "diameter": None, "depth": 406.4}
    assert found.flags == ()


def test_amazon_bullets_in_french() -> None:
    body = """<div id="detailBullets_feature_div"><ul><li><span><b>Dimensions du produit (L x l x h) \u200f : \u200e</b>
    <span>120 x 60 x 75 cm; 18,5 Kilogrammes</span></span></li></ul></div>"""
    found = item(body.replace("<html", "<html"), "https://www.amazon.fr/dp/B0ABCDEFGH")
    assert found.extents_mm == (1200, 750, 600)


def test_amazon_package_alone_is_no_size() -> None:
    found = item("<table><tr><th>Package Dimensions</th><td>10 x 7 x 5 inches</td></tr></table>")
    assert found.extents_mm is None
    assert found.flags == ("no_size",)


def test_prose_alone_is_low_trust() -> None:
    found = item("<div><p>Product size: 200mm*115mm*85mm. Comes with screws.</p></div>")
    assert found.extents_mm == (200, 115, 85)
    assert found.flags == ("low_trust",)


def test_ikea_size_and_packages() -> None:
    body = """<h1>BJORK Table</h1>
    <div class="pip-product-dimensions"><dl><dt>Width:</dt><dd>90 cm</dd><dt>Length:</dt><dd>180 cm</dd>
    <dt>Height:</dt><dd>74 cm</dd></dl></div>
    <div id="SEC_product-details-packaging"><h3>Packaging</h3><span>Width: 53 cm</span><span>Height: 5 cm</span>
    <span>Length: 242 cm</span></div>"""
    found = item(body, "https://www.ikea.com/gb/en/p/bjork-table-oak-00293772/")
    assert (found.source, found.source_id) == ("ikea", "00293772")
    assert found.extents_mm == (1800, 900, 740)


def test_wayfair_overall_among_parts() -> None:
    body = """<h1>Chair</h1><dl><dt>Overall Dimensions</dt><dd>41'' H X 27'' W X 28'' D</dd>
    <dt>Seat Height</dt><dd>20'' H</dd><dt>Minimum Overall Height - Top to Bottom</dt><dd>41'' H</dd></dl>"""
    found = item(body, "https://www.wayfair.com/furniture/pdp/some-chair-abc12345.html")
    assert (found.source, found.source_id) == ("wayfair", "abc12345")
    assert found.extents_mm == (1041.4, 711.2, 685.8)


def test_schema_org_linked_data() -> None:
    data = {
        "@context": "https://schema.org",
        "@graph": [
            {
                "@type": "Product", "name": "Lamp", "sku": "L-7", "brand": {"name": "Glow"}, "image": ["/lamp.jpg"],
                "width": {"@type": "QuantitativeValue", "value": 30, "unitCode": "CMT"},
                "height": {"@type": "QuantitativeValue", "value": 1.5, "unitCode": "MTR"},
            },
            {"@type": "BreadcrumbList", "itemListElement": [{"name": "Home"}, {"item": {"name": "Lamps"}}]},
        ],
    }  # fmt: skip
    found = item(f'<script type="application/ld+json">{json.dumps(data)}</script>')
    assert (found.source_id, found.title, found.brand, found.category_path) == ("L-7", "Lamp", "Glow", ("Lamps",))
    assert (found.dimensions_mm["width"], found.dimensions_mm["height"]) == (300, 1500)
    assert found.images == ("https://shop.example/lamp.jpg",)


def test_microdata() -> None:
    body = """<div itemscope itemtype="https://schema.org/Product"><h1 itemprop="name">Vase</h1>
    <span itemprop="height">25 cm</span><span itemprop="width">12 cm</span></div>"""
    found = item(body)
    assert (found.title, found.extents_mm) == ("Vase", (250, 120))


def test_embedded_json_is_said_to_be() -> None:
    sizes = {"Width": "4.3 cm", "Height": "11.7 cm", "Depth": "2.5 cm"}
    state = json.dumps({"specs": [{"name": axis, "value": text} for axis, text in sizes.items()]})
    found = item(f"<h1>Bell</h1><script>window.__STATE__ = {state};</script>")
    assert (found.extents_mm, found.flags) == ((117, 43, 25), ("from_script",))


@pytest.mark.parametrize(
    ("pair", "extents_mm"),
    [
        ('"name":"Dimensions","value":"30 x 40 x 50 cm"', (500, 400, 300)),
        ('"name":"Size","value":"30 x 40 cm without stand"', (400, 300)),
        ('"name":"Height","value":"tall"', None),
        ('"name":"Colour","value":"30 x 40 x 50 cm"', None),
        ('"name":"Seat height","value":"45 cm"', None),
        ('"name":"Package dimensions","value":"30 x 40 x 50 cm"', None),
    ],
)
def test_a_pair_of_a_script_is_a_size_if_its_label_is_one(pair: str, extents_mm: tuple[float, ...] | None) -> None:
    found = item(f"<h1>Bell</h1><script>[{{{pair}}}]</script>")
    assert (found.extents_mm, found.flags) == (extents_mm, ("from_script",) if extents_mm else ("no_size",))
    table = item(f"<h1>Bell</h1><ul><li>Size: 1 x 2 m</li></ul><script>[{{{pair}}}]</script>")
    assert (table.extents_mm, table.flags) == ((2000, 1000), ()), "a table of the page is used first"


@pytest.mark.parametrize(
    ("text", "title", "brand"),
    [
        ('<!--{"@type": "Product", "name": "Lamp", "brand": [{"name": "Glow"}]};-->', "Lamp", "Glow"),
        ("{&quot;@type&quot;: &quot;Product&quot;, &quot;name&quot;: &quot;Lamp&quot;}", "Lamp", None),
        ('[3, null, ["@type"], {"@type": ["Thing", "Product"], "name": ["Lamp"], "brand": []}]', "Lamp", None),
        ('{"mainEntity": {"@type": "http://schema.org/Product", "name": "Lamp", "brand": 3}}', "Lamp", None),
        ('{"@type": "Product", "name": "Lamp"', "Bell", None),
        ('{"@type": "Thing", "name": "Lamp"}', "Bell", None),
    ],
)
def test_linked_data_as_shops_write_it(text: str, title: str, brand: str | None) -> None:
    found = item(f'<h1>Bell</h1><script type="application/ld+json">{text}</script>')
    assert (found.title, found.brand) == (title, brand)


def test_separators_are_no_categories() -> None:
    site = Site(name="shop", hosts=("shop",), category="//ul/li")
    body = "<h1>Lamp</h1><ul><li>Home</li><li>\u203a</li><li> / </li><li></li><li>Lamps</li><li>&gt;</li></ul>"
    read = page(body.encode(), "https://shop.example/p", "text/html; charset=utf-8")
    assert site.product(read).category_path == ("Home", "Lamps")


@pytest.mark.parametrize(("excess", "is_read"), [(0, True), (1, False)])
def test_a_page_in_memory_has_at_most_32_megabytes(excess: int, is_read: bool) -> None:
    class Long(bytes):
        def __len__(self) -> int:
            return 32_000_000 + excess

    with nullcontext() if is_read else pytest.raises(BadPage, match="expected at most 32000000 bytes"):
        assert page(Long(b"<p>a</p>"), "https://www.shop.example:80/p").host == "shop.example"


def test_other_products_are_left_out() -> None:
    body = """<h1>Cup</h1><table><tr><th>Model</th><th>This</th><th>Other</th></tr>
    <tr><th>Dimensions</th><td>9 x 9 x 9 cm</td><td>8 x 8 x 8 cm</td></tr></table>
    <div class="related-products"><dl><dt>Dimensions</dt><dd>7 x 7 x 7 cm</dd></dl></div>
    <section id="customerReviews"><p>Dimensions: 6 x 6 x 6 cm</p></section>"""
    assert item(body).extents_mm is None


def test_wikipedia_infobox() -> None:
    body = """<h1 id="firstHeading">Made Car</h1><table class="infobox"><tr><th>Class</th><td>Small car</td></tr>
    <tr><th colspan="2">Dimensions</th></tr><tr><th>Length</th><td>4,284 mm (168.7 in)</td></tr>
    <tr><th>Width</th><td>1,789&nbsp;mm (70.4&nbsp;in)</td></tr><tr><th>Height</th><td>1,452 mm (57.2 in)</td></tr>
    <tr><th>Curb weight</th><td>1,301 kg</td></tr></table>
    <div id="mw-normal-catlinks"><ul><li><a>Compact cars</a></li></ul></div>"""
    found = item(body, "https://en.wikipedia.org/wiki/Made_Car")
    assert (found.source, found.source_id, found.category_path) == ("wikipedia", "Made_Car", ("Compact cars",))
    assert found.extents_mm == (4284, 1789, 1452)


def test_every_site_owns_its_own_addresses_alone() -> None:
    for site, url in [
        ("amazon", "https://www.amazon.co.uk/dp/B000000000"), ("ikea", "https://www.ikea.com/us/en/p/x-1/"),
        ("crate_and_barrel", "https://www.crateandbarrel.com/x/s123456"), ("generic", "https://amazon.com.evil.example/dp/1"),
        ("wikipedia", "https://de.wikipedia.org/wiki/Stuhl"), ("dimensions_com", "https://www.dimensions.com/element/chair"),
        ("automobile_dimension", "https://www.automobiledimension.com/model/x"), ("wayfair", "https://www.wayfair.co.uk/x/pdp/y.html"),
    ]:  # fmt: skip
        assert site_of(url).name == site
    assert len({site.name for site in SITES}) == len(SITES)


def test_extract_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "page.html.gz"
    path.write_bytes(
        gzip.compress(b"<html><h1>Box</h1><table><tr><td>Dimensions</td><td>1 x 2 x 3 m</td></tr></table>")
    )
    assert main(["extract", str(path), "--url", "https://shop.example/p/1", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert (record["schema"], record["extents_mm"], record["source"]) == (
        "metric-tree/raw/1",
        [3000, 2000, 1000],
        "shop.example",
    )
    assert main(["extract", str(tmp_path / "none.html"), "--url", "https://x.example"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_addresses_that_mean_one_page_are_one() -> None:
    assert canonical_url("HTTP://Shop.Example:80/p?utm_source=a&id=3#top") == canonical_url(
        "http://shop.example/p?id=3"
    )


@pytest.mark.parametrize(
    "body",
    [b"", b" \n", b"\x00\x01", gzip.compress(b"x")[:9], b"\xff\xfe\x00", b"<" * 50_000, b"<html>" + b"<div>" * 200_000],
    ids=["empty", "blank", "binary", "cut gzip", "utf-16 mark", "angles", "deep"],
)  # fmt: skip
def test_hostile_pages_cost_one_page(body: bytes) -> None:
    def extract() -> None:
        with suppress(BadPage):
            item_of(page(body, "https://shop.example/p/1"))

    assert processor_seconds(extract, 5) < 5


def test_a_bomb_is_not_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "bomb.html"
    path.write_bytes(gzip.compress(b"0" * (MAX_BYTES + 10)))
    with pytest.raises(BadPage, match="expected at most"):
        saved_page(path, "https://shop.example/p/1")


_TAGS = "<table> <tr> <td> </td> <dl> <dt> <dd> <script> </script> <!-- <div > </html>"
_TEXTS = ("Width", "3 x 4 cm", "&nbsp;", "é", '{"name":"Width","value":"')
_PIECES = [*re.findall(r"\S+", _TAGS), *_TEXTS]


@settings(max_examples=150, deadline=None)
@given(st.lists(st.sampled_from(_PIECES), max_size=60).map("".join))
def test_broken_markup_never_crashes_the_reader(body: str) -> None:
    found = item(body)
    assert found.extents_mm is None or all(mm > 0 for mm in found.extents_mm)


def test_what_a_page_says_cannot_steer_a_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "page.html"
    title = "Box \x1b]0;x\x9b31m \u202egnirts"
    path.write_text(f"<html><h1>{title}</h1><table><tr><td>Size</td><td>1 x 2 x 3 m</td></tr></table></html>", "utf-8")
    for more in ([], ["--json"]):
        assert main(["extract", str(path), "--url", "https://shop.example/p/1", *more]) == 0
        shown = capsys.readouterr().out
        assert not {"\x1b", "\x9b", "\u202e"} & set(shown)
    assert json.loads(shown)["extents_mm"] == [3000, 2000, 1000]


def test_a_title_of_megabytes_or_with_controls_is_cut_and_cleaned() -> None:
    long = item(f"<h1>{'x' * 1_000_000}</h1>")
    assert len(long.title) == 1000
    data = {"@type": "Product", "name": "\x1b[31mOak&#27; stool\u202e", "sku": "9" * 1_000_000, "brand": "b" * 5000}
    hostile = item("", head=f'<script type="application/ld+json">{json.dumps(data)}</script>')
    assert hostile.title == "[31mOak stool"
    assert len(hostile.source_id) < 100
    assert hostile.brand is not None
    assert len(hostile.brand) == 200


@pytest.mark.parametrize(
    ("heading", "label", "is_used"),
    [
        ("Dimensions", "Oak", True),
        ("Seat dimensions", "Oak", False),
        ("Seat dimensions", "Overall dimensions", True),
        ("Dimensions", "Seat size", False),
        ("Package", "Dimensions", False),
    ],
)
def test_a_size_under_the_heading_of_a_part_needs_a_label_of_its_own(heading: str, label: str, is_used: bool) -> None:
    found = item(f"<h1>Bench</h1><h2>{heading}</h2><table><tr><th>{label}</th><td>50 x 40 x 10 cm</td></tr></table>")
    assert found.extents_mm == ((500.0, 400.0, 100.0) if is_used else None)


@pytest.mark.parametrize(
    ("body", "kind"),
    [
        (b" \n", "nothing"),
        (b"%PDF-1.7", "a PDF"),
        (b"\x00<p>a</p>", "binary data"),
        (b"a" * 1444 + b"\x00<p>a</p>", "binary data"),
        (b"a" * 1445 + b"\x00<p>a</p>", None),
        (b"\xff\xfe<\x00p\x00>\x00", None),
        (b' {"a": "<p>"}', "JSON"),
        (b" [1]", "JSON"),
        (b"just text < more", "no element of HTML"),
        (b"<TABLE border=1>", None),
    ],
)
def test_the_content_of_a_body_that_is_no_page(body: bytes, kind: str | None) -> None:
    assert other_content(body) == kind
