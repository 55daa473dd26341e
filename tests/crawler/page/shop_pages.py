"""Made-up product pages in the markup of widely used shop platforms, and what a person reads on each.

Written by us, in seven languages, with what misleads a reader: packages, parts, other products, several units, ranges,
orders of axes, units in headers. The expectations were written before the reader was run on them.
"""

# ruff: noqa: E501 - markup stands as sites write it

from __future__ import annotations

from typing import Any, NamedTuple


class Made(NamedTuple):
    """A page: its platform, language, body, the outer size in mm (longest first) or None, axis words, flags."""

    platform: str
    language: str
    body: str
    extents: tuple[float, ...] | None
    words: dict[str, float] | None = None
    flags: tuple[str, ...] = ()
    head: str = ""


def rows(cells: dict[str, str], row: str) -> str:
    """Label and value pairs in a site's row: `{k}` and `{v}` are filled in."""
    return "".join(row.replace("{k}", key).replace("{v}", value) for key, value in cells.items())


def whd(width: float, height: float, depth: float) -> dict[str, float]:
    return {"width": width, "height": height, "depth": depth}


#: Below every page: what is not the product.
OTHERS = """<section class="product-recommendations"><h2>You may also like</h2><ul>
<li>Dimensions: 3 x 2 x 1 m</li><li><b>Width:</b> 9 cm</li></ul></section>
<div id="customer-reviews"><p>The size is 12 x 12 x 12 cm, too small for me. Height: 3 cm.</p></div>"""

MADE = [
    Made(
        "Shopify, list in the description", "en",
        """<div class="product__description rte quick-add-hidden"><p>A lamp of turned oak. Ships in 3-5 days.</p><ul>
        <li>Dimensions: 14"W x 14"D x 22"H</li><li>Weight: 9 lbs</li><li>Cord length: 72"</li></ul></div>
        <script>var meta = {"product":{"id":1,"variants":[{"id":2,"price":12900,"name":"Lamp - 22 in"}]}};</script>""",
        (558.8, 355.6, 355.6), whd(355.6, 558.8, 355.6),
    ),
    Made(
        "WooCommerce, attributes", "en",
        """<table class="woocommerce-product-attributes shop_attributes">
        <tr class="woocommerce-product-attributes-item--weight"><th>Weight</th><td>8.5 kg</td></tr>
        <tr class="woocommerce-product-attributes-item--dimensions"><th class="woocommerce-product-attributes-item__label">
        Dimensions</th><td class="woocommerce-product-attributes-item__value">60 &times; 40 &times; 75 cm</td></tr></table>
        <section class="related products"><h2>Related products</h2><table><tr><th>Dimensions</th><td>5 x 5 x 5 cm</td></tr>
        </table></section>""",
        (750, 600, 400),
    ),
    Made(
        "Magento, unit in the label", "en",
        '<div class="additional-attributes-wrapper table-wrapper"><table class="data table additional-attributes" '
        'id="product-attribute-specs-table"><caption class="table-caption">More Information</caption><tbody>'
        + rows(
            {
                "SKU": "CH-445", "Product Width (cm)": "45", "Product Depth (cm)": "52", "Product Height (cm)": "81.5",
                "Seat Height (cm)": "46", "Packed Width (cm)": "60", "Packed Height (cm)": "90", "Packed Weight (kg)": "7",
            },
            '<tr><th class="col label" scope="row">{k}</th><td class="col data" data-th="{k}">{v}</td></tr>',
        )
        + "</tbody></table></div>",
        (815, 520, 450), whd(450, 815, 520),
    ),
    Made(
        "BigCommerce, unit in brackets", "en",
        '<dl class="productView-info">'
        + rows(
            {
                "SKU:": "44-120", "Weight:": "18.00 LBS", "Width:": "12.00 (in)", "Height:": "30.00 (in)",
                "Depth:": "10.00 (in)", "Shipping:": "Calculated at Checkout",
            },
            '<dt class="productView-info-name">{k}</dt><dd class="productView-info-value">{v}</dd>',
        )
        + "</dl>",
        (762, 304.8, 254), whd(304.8, 762, 254),
    ),
    Made(
        "Shopware", "de",
        '<table class="table table-striped product-detail-properties-table"><tbody>'
        + rows(
            {
                "Material:": "Eiche", "Breite:": "80,5 cm", "Höhe:": "1.120 mm", "Tiefe:": "35 cm", "Sitzhöhe:": "46 cm",
                "Verpackungsmaße:": "120 x 90 x 15 cm", "Gewicht:": "21 kg",
            },
            '<tr class="properties-row"><th class="properties-label">{k}</th><td class="properties-value"><span>{v}</span>'
            "</td></tr>",
        )
        + "</tbody></table>",
        (1120, 805, 350), whd(805, 1120, 350),
    ),
    Made(
        "PrestaShop", "fr",
        '<section class="product-features"><p class="h6">Fiche technique</p><dl class="data-sheet">'
        + rows(
            {
                "Largeur": "90 cm", "Hauteur": "95,5 cm", "Profondeur": "88 cm", "Hauteur d'assise": "44 cm",
                "Dimensions du colis": "95 x 90 x 50 cm", "Poids": "24 kg",
            },
            '<dt class="name">{k}</dt><dd class="value">{v}</dd>',
        )
        + "</dl></section>",
        (955, 900, 880), whd(900, 955, 880),
    ),
    Made(
        "Home Depot", "en",
        '<div class="specifications"><div class="specifications__table"><h4>Dimensions</h4>'
        + rows(
            {
                "Product Depth (in.)": "24.5 in", "Product Height (in.)": "34 1/2 in", "Product Width (in.)": "30 in",
                "Packaged Depth (in.)": "28 in", "Packaged Height (in.)": "38 in", "Countertop Thickness (in.)": "1 in",
            },
            '<div class="specifications__row"><div class="specifications__cell specifications__cell__label">{k}</div>'
            '<div class="specifications__cell">{v}</div></div>',
        )
        + "</div></div>",
        (876.3, 762, 622.3), whd(762, 876.3, 622.3),
    ),
    Made(
        "Target", "en",
        '<div data-test="item-details-specifications">'
        + rows(
            {
                "Dimensions (Overall):": "30 Inches (H) x 60 Inches (W) x 16 Inches (D)", "Weight:": "50 Pounds",
                "Shelf Dimensions:": "58 Inches (W) x 14 Inches (D)", "Holds up to:": "40 Pounds per shelf",
            },
            "<div><b>{k}</b> {v}</div><hr>",
        )
        + "</div>",
        (1524, 762, 406.4), whd(1524, 762, 406.4),
    ),
    Made(
        "Walmart", "en",
        """<div class="nt1"><div class="pb2"><h3 class="flex items-center mv0 lh-copy f5 pb1 dark-gray">Weight Capacity</h3>
        <div class="mv0 lh-copy f6 mid-gray"><span>250 lb</span></div></div>
        <div class="pb2"><h3 class="flex items-center mv0 lh-copy f5 pb1 dark-gray">Assembled Product Dimensions (L x W x H)
        </h3><div class="mv0 lh-copy f6 mid-gray"><span>35.40 x 15.70 x 30.00 Inches</span></div></div></div>
        <script id="__NEXT_DATA__" type="application/json">{"shipping":[{"name":"Width","value":"99 in"}]}</script>""",
        (899.2, 762, 398.8),
    ),
    Made(
        "eBay, item specifics", "en",
        '<div class="ux-layout-section-evo ux-layout-section--features">'
        + rows(
            {"Brand": "Handmade", "Item Length": "24 in", "Item Width": "18 in", "Item Height": "12 in", "Item Weight": "4 lb"},
            '<div class="ux-layout-section-evo__col"><div class="ux-labels-values"><div class="ux-labels-values__labels">'
            '<div class="ux-labels-values__labels-content"><div><span class="ux-textspans">{k}</span></div></div></div>'
            '<div class="ux-labels-values__values"><div class="ux-labels-values__values-content"><div>'
            '<span class="ux-textspans">{v}</span></div></div></div></div></div>',
        )
        + "</div>",
        (609.6, 457.2, 304.8), {"length": 609.6, "width": 457.2, "height": 304.8},
    ),
    Made(
        "Argos", "en",
        """<div class="product-description-content-text" itemprop="description"><p>Seats six.</p><ul><li>Table:</li>
        <li>Size H75, W120, D80cm.</li><li>Weight 28kg.</li></ul><ul><li>Chair:</li><li>Seat height 45cm.</li></ul></div>""",
        (1200, 800, 750), whd(1200, 750, 800),
    ),
    Made(
        "Otto", "de",
        '<div class="js_pdp_selling-points"><table class="dv_characteristicsTable"><caption>Maßangaben</caption>'
        + rows(
            {"Breite": "140 cm", "Höhe": "85 cm", "Tiefe": "91 cm", "Sitztiefe": "54 cm", "Gewicht": "33 kg"},
            '<tr><td class="left"><span>{k}</span></td><td>{v}</td></tr>',
        )
        + "</table></div>",
        (1400, 910, 850), whd(1400, 850, 910),
    ),
    Made(
        "Zalando, a bag", "de",
        "<div><h2>Größe und Passform</h2><dl>"
        + rows(
            {"Höhe": "24 cm (Größe One Size)", "Länge": "32 cm (Größe One Size)", "Breite": "12 cm (Größe One Size)"},
            '<div role="row"><dt role="term">{k}<!-- -->:</dt><dd role="definition">{v}</dd></div>',
        )
        + "</dl></div>",
        (320, 240, 120), {"length": 320, "width": 120, "height": 240},
    ),
    Made(
        "Zalando, a shoe", "de",
        '<dl><div><dt>Absatzhöhe:</dt><dd>7 cm</dd></div><div><dt>Schafthöhe:</dt><dd>12 cm</dd></div></dl>',
        None, flags=("no_size",),
    ),
    Made(
        "Decathlon", "fr",
        """<section class="technical-information"><h2>Informations techniques</h2><div><h3>Dimensions et poids</h3>
        <ul><li>Dimensions : L 210 x l 190 x H 110 cm.</li><li>Housse de transport : 58 x 21 x 21 cm.</li>
        <li>Poids : 4,2 kg</li></ul></div></section>""",
        (2100, 1900, 1100), {"length": 2100, "width": 1900, "height": 1100},
    ),
    Made(
        "Conforama", "fr",
        """<table class="fiche"><tr><td>Dimensions (L x H x P)</td><td>180,5 x 75 x 90 cm</td></tr>
        <tr><td>Dimensions emballage</td><td>185 x 40 x 95 cm</td></tr><tr><td>Épaisseur du plateau</td><td>3,8 cm</td></tr>
        </table>""",
        (1805, 900, 750), whd(1805, 750, 900),
    ),
    Made(
        "Leroy Merlin", "es",
        "<h2>Características</h2><table>"
        + rows(
            {"Ancho (cm)": "60.0", "Alto (cm)": "85.2", "Fondo (cm)": "45", "Peso (kg)": "12", "Grosor de la puerta (mm)": "16"},
            '<tr><th scope="row">{k}</th><td>{v}</td></tr>',
        )
        + "</table>",
        (852, 600, 450), whd(600, 852, 450),
    ),
    Made(
        "El Corte Inglés", "es",
        """<dl class="product-features"><dt>Medidas</dt><dd>Alto: 85 cm. Ancho: 60 cm. Fondo: 63,5 cm.</dd>
        <dt>Medidas con embalaje</dt><dd>Alto: 90 cm. Ancho: 65 cm. Fondo: 70 cm.</dd><dt>Capacidad</dt><dd>9 kg</dd></dl>""",
        (850, 635, 600), whd(600, 850, 635),
    ),
    Made(
        "bol.com", "nl",
        '<div class="specs"><h3 class="specs__title">Productinformatie</h3><dl class="specs__list">'
        + rows(
            {
                "Product breedte": "40 cm", "Product hoogte": "101,5 cm", "Product diepte": "30 cm", "Zithoogte": "75 cm",
                "Verpakking breedte": "45 cm", "Verpakking hoogte": "110 cm", "Verpakking lengte": "35 cm",
            },
            '<div class="specs__row"><dt class="specs__title">{k}</dt><dd class="specs__value">{v}</dd></div>',
        )
        + "</dl></div>",
        (1015, 400, 300), whd(400, 1015, 300),
    ),
    Made(
        "Castorama", "fr",
        '<div class="_spec"><h2>Informations produit</h2><table>'
        + rows(
            {
                "Hauteur du produit": "86 cm", "Largeur du produit": "120 cm", "Profondeur du produit": "50 cm",
                "Hauteur du colis": "20 cm", "Largeur du colis": "125 cm", "Poids net": "31 kg",
            },
            "<tr><th>{k}</th><td>{v}</td></tr>",
        )
        + "</table></div>",
        (1200, 860, 500), whd(1200, 860, 500),
    ),
    Made(
        "Wehkamp", "nl",
        '<div class="ba-specifications"><h3>afmetingen</h3>'
        + rows(
            {"hoogte": "78 cm", "breedte": "62 cm", "diepte": "66 cm", "zithoogte": "45 cm", "armleuninghoogte": "61 cm"},
            '<div class="ba-row"><span class="ba-label">{k}</span><span class="ba-value">{v}</span></div>',
        )
        + "</div>",
        (780, 660, 620), whd(620, 780, 660),
    ),
    Made(
        "Dunelm, lines parted by breaks", "en",
        """<div class="pdp-accordion"><h3>Dimensions</h3><p>H88cm x W204cm x D95cm<br>Seat Height: 46cm<br>
        Seat Depth: 58cm<br>Leg Height: 12cm<br>Weight: 61kg<br>Boxed Dimensions: H90cm x W210cm x D100cm</p></div>""",
        (2040, 950, 880), whd(2040, 880, 950),
    ),
    Made(
        "Article", "en",
        """<div class="css-1x"><h2>Dimensions</h2><div><div>Overall</div><div>29.5"H x 84"W x 36"D</div></div>
        <div><div>Seat depth</div><div>23"</div></div><div><div>Clearance under the sofa</div><div>6"</div></div></div>""",
        (2133.6, 914.4, 749.3), whd(2133.6, 749.3, 914.4),
    ),
    Made(
        "West Elm", "en",
        """<div class="accordion-component"><h3>Details &amp; Dimensions</h3><ul><li>Overall: 35.5"w x 33"d x 31.5"h.</li>
        <li>Interior seat width: 24".</li><li>Seat height: 18".</li><li>Packaging dimensions: 40" x 38" x 30".</li></ul></div>""",
        (901.7, 838.2, 800.1), whd(901.7, 800.1, 838.2),
    ),
    Made(
        "Etsy", "en",
        """<ul><li><div class="wt-ml-xs-2">Materials: stoneware</div></li><li><div class="wt-ml-xs-2">Width: 4.5 inches</div></li>
        <li><div class="wt-ml-xs-2">Height: 9 inches</div></li><li><div class="wt-ml-xs-2">Depth: 4.5 inches</div></li></ul>""",
        (228.6, 114.3, 114.3), whd(114.3, 228.6, 114.3),
    ),
    Made(
        "Flipkart", "en",
        '<div class="_9V0sS6"><div class="_4BJ2V+">Dimensions</div><table class="_0ZhAN9"><tbody>'
        + rows(
            {"Width": "76.2 cm", "Height": "182.88 cm", "Depth": "40.64 cm", "Weight": "43 kg"},
            '<tr class="WJdYP6 row"><td class="+fFi1w col col-3-12">{k}</td><td class="Izz52n col col-9-12"><ul>'
            '<li class="HPETK2">{v}</li></ul></td></tr>',
        )
        + "</tbody></table></div>",
        (1828.8, 762, 406.4), whd(762, 1828.8, 406.4),
    ),
    Made(
        "Thomann", "en",
        """<ul class="fx-list"><li>Power consumption: 24 W</li><li>Dimensions (W x H x D): 330 x 72 x 210 mm</li>
        <li>Weight: 2.9 kg</li></ul>
        <div class="keyfeature"><span class="keyfeature__label">Speaker size</span><span>8 "</span></div>""",
        (330, 210, 72), whd(330, 72, 210),
    ),
    Made(
        "two systems in one cell", "en",
        "<table><tr><th>Dimensions (W x D x H)</th><td>80 × 60 × 75.5 cm / 31.5 × 23.6 × 29.7 in</td></tr></table>",
        (800, 755, 600), whd(800, 755, 600),
    ),
    Made(
        "several variants in a chart", "en",
        """<h2>Size chart</h2><table><tr><th>Size</th><th>Width</th><th>Length</th></tr><tr><td>Small</td><td>80 cm</td>
        <td>150 cm</td></tr><tr><td>Medium</td><td>120 cm</td><td>180 cm</td></tr><tr><td>Large</td><td>160 cm</td>
        <td>230 cm</td></tr></table>""",
        None, flags=("no_size",),
    ),
    Made(
        "axes in the header row", "en",
        """<h2>Specifications</h2><table><thead><tr><th>Width (mm)</th><th>Depth (mm)</th><th>Height (mm)</th></tr></thead>
        <tbody><tr><td>1200</td><td>600</td><td>750</td></tr></tbody></table>""",
        (1200, 750, 600), whd(1200, 750, 600),
    ),
    Made(
        "a column for each system", "en",
        """<table><tr><th>Measurement</th><th>Metric</th><th>Imperial</th></tr><tr><td>Width</td><td>50 cm</td><td>19.7 in</td>
        </tr><tr><td>Height</td><td>90 cm</td><td>35.4 in</td></tr><tr><td>Depth</td><td>45 cm</td><td>17.7 in</td></tr></table>""",
        (900, 500, 450), whd(500, 900, 450),
    ),
    Made(
        "microdata with quantities", "en",
        '<div itemscope itemtype="http://schema.org/Product"><h1 itemprop="name">Bench</h1>'
        + rows(
            {"width": "1200", "depth": "380", "height": "450"},
            '<span itemprop="{k}" itemscope itemtype="http://schema.org/QuantitativeValue"><meta itemprop="value" content="{v}">'
            '<meta itemprop="unitCode" content="MMT"></span>',
        )
        + "</div>",
        (1200, 450, 380), whd(1200, 450, 380),
    ),
    Made(
        "a product group in JSON-LD", "en",
        "<p>Choose a colour.</p>",
        (600, 450, 400), whd(400, 600, 450),
        head="""<script type="application/ld+json">{"@context":"https://schema.org","@type":"ProductGroup","name":"Stool",
        "hasVariant":[{"@type":"Product","name":"Stool, red","width":{"value":40,"unitText":"cm"},
        "depth":{"value":45,"unitText":"cm"},"height":{"value":60,"unitText":"cm"}}]}</script>""",
    ),
    Made(
        "additional properties in JSON-LD", "de",
        "<p>Ein Regal.</p>",
        (1800, 800, 300), whd(800, 1800, 300),
        head="""<script type="application/ld+json">{"@type":"Product","name":"Regal","additionalProperty":[
        {"@type":"PropertyValue","name":"Breite","value":"80","unitText":"cm"},
        {"@type":"PropertyValue","name":"Höhe","value":"180 cm"},{"@type":"PropertyValue","name":"Tiefe","value":"30 cm"},
        {"@type":"PropertyValue","name":"Verpackungshöhe","value":"12 cm"}]}</script>""",
    ),
    Made(
        "a desk of adjustable height", "de",
        '<h3>Abmessungen</h3><table>'
        + rows(
            {"Breite": "140 cm", "Tiefe": "70 cm", "Höhe": "71 - 119 cm", "Plattenstärke": "2,5 cm", "Hubgeschwindigkeit": "38 mm/s"},
            "<tr><td>{k}</td><td>{v}</td></tr>",
        )
        + "</table>",
        (1400, 950, 700), whd(1400, 950, 700), ("range",),
    ),
    Made(
        "a folding chair", "fr",
        "<table>"
        + rows(
            {"Dimensions déplié (L x l x H)": "52 x 47 x 80 cm", "Dimensions plié (L x l x H)": "95 x 47 x 8 cm", "Poids": "3 kg"},
            "<tr><th>{k}</th><td>{v}</td></tr>",
        )
        + "</table>",
        (800, 520, 470), {"length": 520, "width": 470, "height": 800},
    ),
    Made(
        "Worten", "pt",
        '<ul class="product-specs">'
        + rows(
            {
                "Largura (cm)": "59,8", "Altura (cm)": "84,5", "Profundidade (cm)": "55", "Peso (kg)": "38",
                "Largura da embalagem (cm)": "64", "Altura da embalagem (cm)": "89",
            },
            '<li><span class="details-label">{k}</span><span class="details-value">{v}</span></li>',
        )
        + "</ul>",
        (845, 598, 550), whd(598, 845, 550),
    ),
    Made(
        "Unieuro", "it",
        """<div class="spec-row"><span class="spec-name">Dimensioni (AxLxP)</span><span class="spec-value">178,1 x 59,5 x 65,8 cm
        </span></div><div class="spec-row"><span class="spec-name">Lunghezza cavo</span><span>1,8 m</span></div>
        <div class="spec-row"><span>Dimensioni imballo (AxLxP)</span><span>185 x 64 x 70 cm</span></div>""",
        (1781, 658, 595), whd(595, 1781, 658),
    ),
    Made(
        "a list with the order behind", "es",
        """<div class="descripcion"><ul><li>Medidas: 120x60x75 cm (largo x ancho x alto)</li><li>Altura del asiento: 45 cm</li>
        <li>Peso máximo: 120 kg</li></ul></div>""",
        (1200, 750, 600), {"length": 1200, "width": 600, "height": 750},
    ),
    Made(
        "a lamp with a diameter", "de",
        """<table><tr><td>Maße</td><td>Ø 35 cm, H 150 cm</td></tr><tr><td>Kabellänge</td><td>200 cm</td></tr>
        <tr><td>Schirm</td><td>Ø 35 cm, H 25 cm</td></tr></table>""",
        (1500, 350, 350), {"diameter": 350, "height": 1500},
    ),
    Made(
        "feet and inches", "en",
        """<table><tr><th>Assembled dimensions</th><td>6' 8" L x 3' W x 2' 6" H</td></tr>
        <tr><th>Box dimensions</th><td>7' x 3' x 8"</td></tr></table>""",
        (2032, 914.4, 762), {"length": 2032, "width": 914.4, "height": 762},
    ),
    Made(
        "groceries", "en",
        """<h3>Net Contents</h3><p>500g</p><table><tr><th>Energy</th><td>1510kJ / 357kcal</td></tr></table>
        <p>Serving size 45 g. Pack size: 12</p>""",
        None, flags=("no_size",),
    ),
    Made(
        "a screen's diagonal", "en",
        """<table><tr><th>Screen size</th><td>6.1 inches</td></tr><tr><th>Resolution</th><td>2532 x 1170 pixels</td></tr>
        <tr><th>Main camera sensor</th><td>9.8 x 7.3 mm</td></tr></table>""",
        None, flags=("no_size",),
    ),
    Made(
        "package within the cell of the product", "en",
        """<table><tr><th>Size</th><td>Product: 23.6"D x 47.2"W x 29.5"H; Package: 50"D x 26"W x 6"H</td></tr></table>""",
        (1198.9, 749.3, 599.4), whd(1198.9, 749.3, 599.4),
    ),
    Made(
        "a table to compare", "en",
        """<h2>Compare with others</h2><table><tr><th></th><th>This stool</th><th>Tall stool</th></tr>
        <tr><th>Dimensions</th><td>40 x 40 x 45 cm</td><td>40 x 40 x 75 cm</td></tr></table>""",
        None, flags=("no_size",),
    ),
    Made(
        "a seller's prose", "en",
        "<div><p>Lovely old vase from an estate. It measures approx. H 32 cm x W 20 cm x D 18 cm and has a small chip.</p></div>",
        (320, 200, 180), whd(200, 320, 180), ("low_trust",),
    ),
    Made(
        "Home24, a list under a heading", "de",
        """<div><h3>Maße</h3><ul><li>Höhe: 75 cm</li><li>Breite: 160 cm</li><li>Tiefe: 90 cm</li><li>Bodenfreiheit: 72 cm</li>
        <li>Tischplattenstärke: 3 cm</li></ul></div>""",
        (1600, 900, 750), whd(1600, 750, 900),
    ),
    Made(
        "lines parted by breaks under a heading", "es",
        "<div><h3>Medidas</h3><p>Ancho: 60 cm<br>Alto: 80,5 cm<br>Fondo: 40 cm<br>Altura de las patas: 15 cm</p></div>",
        (805, 600, 400), whd(600, 805, 400),
    ),
    Made(
        "letters with colons", "en",
        '<div class="attr"><span>Measurements</span><span>L: 45cm W: 30cm H: 20cm</span></div>',
        (450, 300, 200), {"length": 450, "width": 300, "height": 200},
    ),
    Made(
        "package weight among the axes", "en",
        "<h3>Specifications</h3><table>"
        + rows(
            {"Width": "40 cm", "Height": "50 cm", "Depth": "30 cm", "Shipping weight": "3 kg", "Package contents": "1 stool, 4 screws"},
            "<tr><th>{k}</th><td>{v}</td></tr>",
        )
        + "</table>",
        (500, 400, 300), whd(400, 500, 300),
    ),
    Made(
        "a television with and without its stand", "it",
        "<table>"
        + rows(
            {"Dimensioni senza piedistallo (LxAxP)": "1232 x 712 x 56 mm", "Dimensioni imballo": "1400 x 850 x 160 mm"},
            "<tr><th>{k}</th><td>{v}</td></tr>",
        )
        + "</table>",
        (1232, 712, 56), whd(1232, 712, 56),
    ),
    Made(
        "a mattress: width and length in Portuguese", "pt",
        """<table><tr><td>Medidas (C x L x A)</td><td>190 x 140 x 24 cm</td></tr><tr><td>Peso</td><td>32 kg</td></tr></table>""",
        (1900, 1400, 240), {"length": 1900, "width": 1400, "height": 240},
    ),
]  # fmt: skip


def document(made: Made) -> bytes:
    """The whole page of a case."""
    head = f'<meta charset="utf-8"><title>{made.platform}</title>{made.head}'
    page: Any = f'<!doctype html><html lang="{made.language}"><head>{head}</head><body><header>'
    page += f'<nav><a href="/">Home</a></nav></header><main><h1>Made product</h1>{made.body}{OTHERS}</main>'
    return (page + "<footer>Shop, 12 Long Street</footer></body></html>").encode()
