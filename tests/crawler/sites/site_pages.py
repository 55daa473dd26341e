"""Stored pages of the sites that have a spider, written by us in each site's markup, and the item that each contract expects."""

# ruff: noqa: E501 - markup stands as sites write it

from __future__ import annotations

from typing import NamedTuple


class Stored(NamedTuple):
    """A page of a spider's site: layout, address, language, head and body, and the expected item."""

    spider: str
    layout: str
    url: str
    language: str
    body: str
    extents: tuple[float, ...] | None
    words: dict[str, float] | None = None
    id: str | None = None
    title: str = "Made item"
    category: tuple[str, ...] = ()
    head: str = ""


def rows(cells: dict[str, str], row: str) -> str:
    """Return a row of markup with `{k}` and `{v}` for each label and value."""
    return "".join(row.replace("{k}", key).replace("{v}", value) for key, value in cells.items())


def whd(width: float, height: float, depth: float) -> dict[str, float]:
    return {"width": width, "height": height, "depth": depth}


_CRUMBS = """<div id="wayfinding-breadcrumbs_feature_div"><ul class="a-unordered-list a-horizontal"><li><span class="a-list-item">
<a class="a-link-normal a-color-tertiary" href="/b?node=1">{one}</a></span></li><li class="a-breadcrumb-divider"><span>›</span></li>
<li><span class="a-list-item"><a class="a-link-normal a-color-tertiary" href="/b?node=2">{two}</a></span></li></ul></div>"""

_AMAZON_TITLE = '<div id="titleSection"><h1 id="title"><span id="productTitle" class="a-size-large">   Made item  </span></h1></div>'


def amazon(one: str, two: str, rest: str) -> str:
    """An Amazon page: breadcrumb, title, a layout, a comparison and reviews."""
    others = """<div id="HLCXComparisonWidget_feature_div"><table id="HLCXComparisonTable"><tr><th>Item Dimensions</th>
    <td>9 x 9 x 9 inches</td><td>8 x 8 x 8 inches</td></tr></table></div><div id="reviewsMedley"><p>Size: 1 x 2 x 3 cm</p></div>
    <div class="a-carousel-card"><span>Dimensions: 7 x 7 x 7 cm</span></div>"""
    return _CRUMBS.format(one=one, two=two) + _AMAZON_TITLE + rest + others


def tech_table(cells: dict[str, str]) -> str:
    row = '<tr><th class="a-color-secondary a-size-base prodDetSectionEntry"> {k} </th><td class="a-size-base prodDetAttrValue"> \u200e{v} </td></tr>'
    return f'<div id="prodDetails"><table id="productDetails_techSpec_section_1" class="a-keyvalue prodDetTable">{rows(cells, row)}</table></div>'


def detail_bullets(cells: dict[str, str]) -> str:
    row = '<li><span class="a-list-item"><span class="a-text-bold">{k} \u200f : \u200e </span><span>{v}</span></span></li>'
    return f'<div id="detailBullets_feature_div"><ul class="a-unordered-list a-nostyle a-vertical detail-bullet-list">{rows(cells, row)}</ul></div>'


def overview(cells: dict[str, str]) -> str:
    row = '<tr class="a-spacing-small"><td class="a-span3"><span class="a-size-base a-text-bold">{k}</span></td><td class="a-span9"><span class="a-size-base po-break-word">{v}</span></td></tr>'
    return f'<div id="productOverview_feature_div"><table class="a-normal a-spacing-micro">{rows(cells, row)}</table></div>'


def book_cards(cells: dict[str, str]) -> str:
    row = """<li class="a-carousel-card rpi-carousel-attribute-card"><div class="a-section rpi-attribute-content"><div class="rpi-attribute-label">
    <span>{k}</span></div><div class="rpi-attribute-value"><span>{v}</span></div></div></li>"""
    return f'<div id="rich_product_information"><ol class="a-carousel">{rows(cells, row)}</ol></div>'


def infobox(cells: dict[str, str]) -> str:
    row = '<tr><th scope="row" class="infobox-label">{k}</th><td class="infobox-data">{v}</td></tr>'
    return f"""<h1 id="firstHeading" class="firstHeading"><span class="mw-page-title-main">Made item</span></h1>
    <div class="mw-parser-output"><table class="infobox vcard"><tbody><tr><th colspan="2" class="infobox-above">Made item</th></tr>
    {rows(cells, row)}</tbody></table><p>It was made in 1999 and is 12 km from the town.</p></div>
    <div id="catlinks"><div id="mw-normal-catlinks"><a href="/wiki/Help:Category">Categories</a>: <ul><li><a>Made items</a></li></ul></div></div>"""


PAGES = [
    Stored(
        "amazon", "table, com", "https://www.amazon.com/Made-Item/dp/B0ABCDEF01/ref=sr_1_1?th=1", "en-us",
        amazon("Home & Kitchen", "Stools", tech_table({"Product Dimensions": '16"D x 17"W x 29"H', "Item Weight": "9.5 pounds", "Seat Height": "24 Inches", "Package Dimensions": "30 x 20 x 8 inches"})),
        (736.6, 431.8, 406.4), whd(431.8, 736.6, 406.4), "B0ABCDEF01", category=("Home & Kitchen", "Stools"),
    ),
    Stored(
        "amazon", "overview and bullets, com", "https://www.amazon.com/gp/product/B0ABCDEF02", "en-us",
        amazon("Grocery", "Chips", overview({"Brand": "Made", "Item Dimensions LxWxH": "9.25 x 3 x 14.85 inches"}) + detail_bullets({"Product Dimensions": "9.25 x 3 x 14.85 inches; 10.56 Ounces", "UPC": "012345678905"})),
        (377.2, 234.9, 76.2), {"length": 235, "width": 76.2, "height": 377.2}, "B0ABCDEF02", category=("Grocery", "Chips"),
    ),
    Stored(
        "amazon", "book, com", "https://www.amazon.com/Made-Book/dp/0735211299", "en-us",
        amazon("Books", "Self-Help", book_cards({"Print length": "320 pages", "Dimensions": "6.24 x 1.08 x 9.3 inches", "ISBN-10": "0735211299"}) + detail_bullets({"Hardcover": "320 pages", "Item Weight": "1.1 pounds", "Dimensions": "6.24 x 1.08 x 9.3 inches"})),
        (236.2, 158.5, 27.4), None, "0735211299", category=("Books", "Self-Help"),
    ),
    Stored(
        "amazon", "package alone, com", "https://www.amazon.com/dp/B0ABCDEF03", "en-us",
        amazon("Tools", "Lights", tech_table({"Package Dimensions": "10.3 x 6.7 x 5.5 inches", "Item Weight": "2 pounds"})),
        None, None, "B0ABCDEF03", category=("Tools", "Lights"),
    ),
    Stored(
        "amazon", "table, co.uk", "https://www.amazon.co.uk/dp/B0ABCDEF04", "en-gb",
        amazon("Toys & Games", "Dolls", tech_table({"Product Dimensions": "31.2 x 16.3 x 10.2 cm; 500 Grams", "Item model number": "FRN64"}) + overview({"Item dimensions L x W x H": "31.2 x 16.3 x 10.2 centimetres"})),
        (312, 163, 102), {"length": 312, "width": 163, "height": 102}, "B0ABCDEF04", category=("Toys & Games", "Dolls"),
    ),
    Stored(
        "amazon", "table, de", "https://www.amazon.de/dp/B0ABCDEF05", "de-de",
        amazon("Küche", "Heizgeräte", tech_table({"Produktabmessungen": "26,5T x 80B x 63,2H cm", "Artikelgewicht": "9,07 Kilogramm", "Verpackungsabmessungen": "85 x 70 x 30 cm"})),
        (800, 632, 265), whd(800, 632, 265), "B0ABCDEF05", category=("Küche", "Heizgeräte"),
    ),
    Stored(
        "amazon", "bullets, de", "https://www.amazon.de/dp/B0ABCDEF06", "de-de",
        amazon("Bücher", "Romane", detail_bullets({"Taschenbuch": "352 Seiten", "Abmessungen": "12.5 x 2.8 x 19 cm"})),
        (190, 125, 28), None, "B0ABCDEF06", category=("Bücher", "Romane"),
    ),
    Stored(
        "amazon", "table, fr", "https://www.amazon.fr/dp/B0ABCDEF07", "fr-fr",
        amazon("Cuisine", "Tables", tech_table({"Dimensions du produit (L x l x h)": "120L x 60l x 75H centimètres", "Poids de l'article": "18,5 Kilogrammes", "Dimensions de l'emballage": "125 x 65 x 12 cm"})),
        (1200, 750, 600), {"length": 1200, "width": 600, "height": 750}, "B0ABCDEF07", category=("Cuisine", "Tables"),
    ),
    Stored(
        "amazon", "overview, fr", "https://www.amazon.fr/dp/B0ABCDEF08", "fr-fr",
        amazon("Maison", "Lampes", overview({"Marque": "Fait", "Dimensions de l'article L x L x H": "30 x 30 x 45 centimètres"})),
        (450, 300, 300), None, "B0ABCDEF08", category=("Maison", "Lampes"),
    ),
    Stored(
        "amazon", "bullets, it", "https://www.amazon.it/dp/B0ABCDEF09", "it-it",
        amazon("Elettronica", "Radio", detail_bullets({"Dimensioni prodotto": "16 x 5,5 x 2,8 cm; 228 grammi", "Pile": "1 Polimero di litio"})),
        (160, 55, 28), None, "B0ABCDEF09", category=("Elettronica", "Radio"),
    ),
    Stored(
        "amazon", "table, es", "https://www.amazon.es/dp/B0ABCDEF10", "es-es",
        amazon("Hogar", "Sillas", tech_table({"Dimensiones del producto": "45P x 52An x 88Al cm", "Peso del producto": "6 Kilogramos", "Dimensiones del paquete": "60 x 55 x 30 cm"})),
        (880, 520, 450), whd(520, 880, 450), "B0ABCDEF10", category=("Hogar", "Sillas"),
    ),
    Stored(
        "amazon", "bullets, es", "https://www.amazon.es/dp/B0ABCDEF11", "es-es",
        amazon("Libros", "Novela", detail_bullets({"Tapa dura": "400 páginas", "Dimensiones": "15.5 x 3.1 x 23.4 cm"})),
        (234, 155, 31), None, "B0ABCDEF11", category=("Libros", "Novela"),
    ),
    Stored(
        "crate_and_barrel", "list below a heading", "https://www.crateandbarrel.com/made-item/s445123", "en",
        """<h1 class="shop-bar-product-title">Made item</h1><div class="dimension-measurements"><h3>Dimensions</h3><div class="dimension-row"><h4>Overall Dimensions</h4><ul class="dimension-list">
        <li><span>Width: </span><span>88"</span></li><li><span>Depth: </span><span>40"</span></li><li><span>Height: </span><span>34"</span></li></ul></div>
        <div class="dimension-row"><h4>Seat Dimensions</h4><ul><li><span>Width: </span><span>72"</span></li><li><span>Depth: </span><span>24"</span></li><li><span>Height: </span><span>17"</span></li></ul></div></div>""",
        (2235.2, 1016, 863.6), whd(2235.2, 863.6, 1016), "445123",
        head='<script type="application/ld+json">{"@type":"Product","name":"Made item","sku":"445123","image":"https://cb.scene7.com/x"}</script>',
    ),
    Stored(
        "ikea", "measurements of 2020", "https://www.ikea.com/gb/en/p/made-item-oak-00293772/", "en-gb",
        """<h1><div class="range-revamp-header-section__title--big notranslate">Made item</div></h1><div class="range-revamp-product-dimensions"><h3>Product size</h3><dl class="range-revamp-product-dimensions__list">
        <dt class="range-revamp-product-dimensions__label">Length:</dt><dd>235 cm</dd><dt class="range-revamp-product-dimensions__label">Width:</dt><dd>100 cm</dd><dt>Height:</dt><dd>74 cm</dd></dl></div>
        <div class="range-revamp-product-details__packaging"><h3>Packaging</h3><span>Width: 53 cm</span><span>Height: 5 cm</span><span>Length: 242 cm</span></div>""",
        (2350, 1000, 740), {"length": 2350, "width": 1000, "height": 740}, "00293772",
    ),
    Stored(
        "ikea", "measurements of 2025", "https://www.ikea.com/us/en/p/made-item-white-s80275887/", "en-us",
        """<h1>Made item</h1><div class="pipf-measurements-modal"><h2>Measurements</h2><ul class="pipf-measurements-modal__list"><li><span class="pipf-measurements-modal__name">Width:</span> <span>30 1/8 "</span></li>
        <li><span>Depth:</span> <span>15 3/8 "</span></li><li><span>Height:</span> <span>57 5/8 "</span></li><li><span>Max load/shelf:</span> <span>29 lb</span></li></ul>
        <div class="pipf-packaging"><h3>Packaging</h3><ul><li><span>Width:</span> <span>16 "</span></li><li><span>Height:</span> <span>6 1/2 "</span></li><li><span>Length:</span> <span>59 "</span></li></ul></div></div>""",
        (1463.7, 765.2, 390.5), whd(765.2, 1463.7, 390.5), "s80275887",
    ),
    Stored(
        "wayfair", "overall among parts", "https://www.wayfair.com/furniture/pdp/made-item-bop1026.html", "en-us",
        """<h1 data-rtl-id="title">Made item</h1><div><h3>Weights &amp; Dimensions</h3><dl><div><dt>Overall</dt><dd>43'' H X 27'' W X 28'' D</dd></div><div><dt>Seat</dt><dd>20'' H X 21'' W</dd></div>
        <div><dt>Minimum Overall Height - Top to Bottom</dt><dd>43.5''</dd></div><div><dt>Arm Height - Floor to Arm</dt><dd>26''</dd></div><div><dt>Overall Product Weight</dt><dd>38 lb.</dd></div></dl></div>""",
        (1092.2, 711.2, 685.8), whd(685.8, 1092.2, 711.2), "bop1026",
    ),
    Stored(
        "wikipedia", "a car", "https://en.wikipedia.org/wiki/Made_item", "en",
        infobox({"Class": "Small family car", "Wheelbase": "2,636&nbsp;mm (103.8&nbsp;in)", "Length": "4,284&nbsp;mm (168.7&nbsp;in)", "Width": "1,789&nbsp;mm (70.4&nbsp;in)", "Height": "1,452&nbsp;mm (57.2&nbsp;in)", "Kerb weight": "1,301 kg"}),
        (4284, 1789, 1452), {"length": 4284, "width": 1789, "height": 1452}, "Made_item", category=("Made items",),
    ),
    Stored(
        "wikipedia", "a car of the REST interface, in German", "https://de.wikipedia.org/api/rest_v1/page/html/Made_item", "de",
        """<section><table class="infobox"><tbody><tr><th>Länge:</th><td>4380–4455 mm</td></tr><tr><th>Breite:</th><td>1799 mm</td></tr><tr><th>Höhe:</th><td>1485 mm</td></tr>
        <tr><th>Radstand:</th><td>2637 mm</td></tr></tbody></table></section>""",
        (4417.5, 1799, 1485), {"length": 4417.5, "width": 1799, "height": 1485}, "Made_item", head="<title>Made item</title>",
    ),
    Stored(
        "wikipedia", "a person", "https://en.wikipedia.org/wiki/Made_person", "en",
        infobox({"Born": "6 January 1990 (age 36)", "Height": "1.93&nbsp;m (6&nbsp;ft 4&nbsp;in)", "Weight": "85 kg (187 lb)"}),
        (1930,), {"height": 1930}, "Made_person", category=("Made items",),
    ),
    Stored(
        "wikipedia", "an animal", "https://en.wikipedia.org/wiki/Made_dog", "en",
        infobox({"Origin": "Scotland", "Height": "51–61 cm (20–24 in)", "Weight": "25–34 kg (55–75 lb)"}),
        (560,), {"height": 560}, "Made_dog", category=("Made items",),
    ),
    Stored(
        "wikipedia", "a ship", "https://en.wikipedia.org/wiki/Made_ship", "en",
        infobox({"Tonnage": "46,328 GRT", "Length": "52.9&nbsp;m (173&nbsp;ft 7&nbsp;in)", "Beam": "9.1&nbsp;m (29&nbsp;ft 10&nbsp;in)", "Draught": "3.4 m (11 ft 2 in)", "Speed": "21 knots"}),
        (52900, 9100), {"length": 52900, "width": 9100}, "Made_ship", category=("Made items",),
    ),
    Stored(
        "wikipedia", "a building", "https://en.wikipedia.org/wiki/Made_tower", "en",
        infobox({"Completed": "1999", "Height": "55.8 m (183 ft)", "Floor count": "12", "Floor area": "3,000 m<sup>2</sup>"}),
        (55800,), {"height": 55800}, "Made_tower", category=("Made items",),
    ),
    Stored(
        "automobile_dimension", "a model", "https://www.automobiledimension.com/model/made/item", "en",
        """<h1>Made item</h1><div class="medidas"><h2>Dimensions</h2><ul><li><strong>Length:</strong> 4055 mm</li><li><strong>Width:</strong> 1745 mm</li><li><strong>Height:</strong> 1430 mm</li>
        <li><strong>Boot space:</strong> 309 dm3</li><li><strong>Wheelbase:</strong> 2540 mm</li></ul></div>
        <div class="similar"><h2>Similar cars</h2><ul><li>Length: 3999 mm</li></ul></div>""",
        (4055, 1745, 1430), {"length": 4055, "width": 1745, "height": 1430}, "made/item",
    ),
    Stored(
        "dimensions_com", "a drawing", "https://www.dimensions.com/element/made-item", "en",
        """<h1>Made item</h1><div class="element-table"><h2>Dimensions</h2><div class="row"><div>Height</div><div>31.9" | 81 cm</div></div><div class="row"><div>Width</div><div>18.1" | 46 cm</div></div>
        <div class="row"><div>Depth</div><div>21.7" | 55 cm</div></div><div class="row"><div>Seat Height</div><div>17.7" | 45 cm</div></div><div class="row"><div>Weight</div><div>13 lb | 5.9 kg</div></div></div>""",
        (810, 550, 460), whd(460, 810, 550), "made-item",
    ),
    Stored(
        "generic", "JSON-LD", "https://shop.example/p/1", "en", "<h1>x</h1>", (1500, 300), {"width": 300, "height": 1500}, "L-7",
        head="""<script type="application/ld+json">{"@graph":[{"@type":"Product","name":"Made item","sku":"L-7","width":{"value":30,"unitCode":"CMT"},"height":{"value":1.5,"unitCode":"MTR"}},
        {"@type":"BreadcrumbList","itemListElement":[{"name":"Home"},{"name":"Lamps"}]}]}</script>""", category=("Lamps",),
    ),
    Stored(
        "generic", "microdata", "https://shop.example/p/2", "en",
        '<div itemscope itemtype="https://schema.org/Product"><h1 itemprop="name">Made item</h1><meta itemprop="sku" content="V-1"><span itemprop="height">25 cm</span><span itemprop="width">12 cm</span></div>',
        (250, 120), {"width": 120, "height": 250}, "V-1",
    ),
    Stored(
        "generic", "Open Graph and a table", "https://shop.example/p/3", "en", "<table><tr><td>Dimensions</td><td>1 x 2 x 3 m</td></tr></table>", (3000, 2000, 1000),
        head='<meta property="og:title" content="Made item"><meta property="og:image" content="/a.jpg">',
    ),
    Stored("generic", "definition list", "https://shop.example/p/4", "en", "<h1>Made item</h1><dl><dt>Width</dt><dd>40 cm</dd><dt>Height</dt><dd>50 cm</dd></dl>", (500, 400), {"width": 400, "height": 500}),
    Stored(
        "generic", "embedded JSON", "https://shop.example/p/5", "en",
        '<h1>Made item</h1><script>window.S={"specs":[{"name":"Width","value":"4.3 cm"},{"name":"Height","value":"11.7 cm"},{"name":"Depth","value":"2.5 cm"}]}</script>', (117, 43, 25), whd(43, 117, 25),
    ),
    Stored("generic", "text", "https://shop.example/p/6", "en", "<h1>Made item</h1><p>Product dimensions are 40 x 30 x 20 cm. Ships today.</p>", (400, 300, 200)),
]  # fmt: skip


def stored(case: Stored) -> bytes:
    """The whole page of a case, with links to a product, a listing and elsewhere."""
    page = f'<!doctype html><html lang="{case.language}"><head><meta charset="utf-8">{case.head}</head><body>{case.body}</body></html>'
    return page.encode()
