"""A second set of made-up pages, written after the reader had been mended on the first: how far its rules carry."""

# ruff: noqa: E501 - markup stands as sites write it

from __future__ import annotations

from tests.crawler.page.shop_pages import Made, rows, whd

LATER = [
    Made(
        "Lowe's", "en",
        '<div class="specs"><h3>Dimensions</h3>'
        + rows(
            {"Width (Inches)": "29.87", "Height (Inches)": "66.25", "Depth (Excluding Handles) (Inches)": "30.5", "Cord Length (Inches)": "60"},
            '<div class="row"><div class="col"><span>{k}</span></div><div class="col"><p>{v}</p></div></div>',
        )
        + "</div>",
        (1682.8, 774.7, 758.7), whd(758.7, 1682.8, 774.7),
    ),
    Made(
        "Costco", "en",
        """<div class="product-info-description"><strong>Features:</strong><ul><li>Solid wood</li></ul><strong>Dimensions:</strong>
        <ul><li>Sofa: 88.5" L x 39" W x 37" H</li><li>Weight: 150 lbs.</li></ul></div>""",
        (2247.9, 990.6, 939.8), {"length": 2247.9, "width": 990.6, "height": 939.8},
    ),
    Made(
        "Overstock, a set of sentences", "en",
        "<ul><li>Overall dimensions: 30 inches high x 24 inches wide x 18 inches deep</li><li>Drawer dimensions: 4 inches high x 20 inches wide</li></ul>",
        (762, 609.6, 457.2), whd(609.6, 762, 457.2),
    ),
    Made(
        "Newegg", "en",
        '<table class="table-horizontal"><caption>Dimensions &amp; Weight</caption>'
        + rows(
            {"Dimensions (H x W x D)": '18.10" x 8.20" x 17.90"', "Weight": "14.5 lbs.", "Max GPU Length": "330 mm"},
            "<tr><th>{k}</th><td>{v}</td></tr>",
        )
        + "</table>",
        (459.7, 454.7, 208.3), whd(208.3, 459.7, 454.7),
    ),
    Made(
        "Currys", "en",
        "<table>"
        + rows(
            {"Dimensions": "850 x 600 x 590 mm (H x W x D)", "Boxed dimensions": "890 x 650 x 660 mm (H x W x D)", "Weight": "66 kg"},
            "<tr><th scope='row'>{k}</th><td>{v}</td></tr>",
        )
        + "</table>",
        (850, 600, 590), whd(600, 850, 590),
    ),
    Made(
        "AO.com", "en",
        """<div class="sizes"><p>H 84.5cm</p><p>W 59.8cm</p><p>D 60cm</p></div>""",
        (845, 600, 598), whd(598, 845, 600),
    ),
    Made(
        "Habitat", "en",
        """<div><h2>About this product</h2><ul><li>Size H202, W100, D60cm.</li><li>Internal drawer height 18cm.</li>
        <li>Weight 81kg.</li><li>Size of packaging 210 x 60 x 20cm.</li></ul></div>""",
        (2020, 1000, 600), whd(1000, 2020, 600),
    ),
    Made(
        "The White Company", "en",
        "<div class='details'><p>H 28 x W 20 x D 20cm (11 x 8 x 8in)</p></div><h4>Size Guide</h4>",
        (280, 200, 200), whd(200, 280, 200), ("low_trust",),
    ),
    Made(
        "MediaMarkt", "de",
        '<table><tr><th colspan="2">Abmessungen und Gewicht</th></tr>'
        + rows(
            {"Breite (cm)": "59.5 cm", "Höhe": "185,5 cm", "Tiefe": "65 cm", "Gewicht": "71 kg", "Breite mit Verpackung": "63 cm", "Kabellänge": "230 cm"},
            "<tr><td>{k}</td><td>{v}</td></tr>",
        )
        + "</table>",
        (1855, 650, 595), whd(595, 1855, 650),
    ),
    Made(
        "Saturn, slashes", "de",
        "<dl><dt>Abmessungen (B/H/T)</dt><dd>44,5 cm / 28,1 cm / 34,6 cm</dd><dt>Garraumvolumen</dt><dd>20 l</dd></dl>",
        (445, 346, 281), whd(445, 281, 346),
    ),
    Made(
        "XXXLutz", "de",
        """<div><h3>Details</h3><div><span>Gesamtbreite</span><span>245 cm</span></div><div><span>Gesamthöhe</span><span>88 cm</span></div>
        <div><span>Gesamttiefe</span><span>102 cm</span></div><div><span>Sitzhöhe</span><span>45 cm</span></div></div>""",
        (2450, 1020, 880), whd(2450, 880, 1020),
    ),
    Made(
        "IKEA de, the measurements' modal", "de",
        """<h2>Maße</h2><ul><li><span>Breite:</span> <span>80 cm</span></li><li><span>Tiefe:</span> <span>28 cm</span></li>
        <li><span>Höhe:</span> <span>202 cm</span></li><li><span>Max. Belastung/Boden:</span> <span>30 kg</span></li></ul>
        <h3>Verpackung</h3><p>Dieses Produkt kommt in 1 Paket.</p><ul><li><span>Breite:</span> <span>29 cm</span></li>
        <li><span>Höhe:</span> <span>13 cm</span></li><li><span>Länge:</span> <span>208 cm</span></li></ul>""",
        (2020, 800, 280), whd(800, 2020, 280),
    ),
    Made(
        "La Redoute", "fr",
        """<div><h3>Dimensions</h3><p>Dimensions totales : <br>Largeur : 160 cm<br>Hauteur : 75 cm<br>Profondeur : 90 cm</p>
        <p>Dimensions et poids des colis : <br>1 colis<br>L170 x H12 x P98 cm<br>42 kg</p></div>""",
        (1600, 900, 750), whd(1600, 750, 900),
    ),
    Made(
        "Fnac Darty", "fr",
        "<table>"
        + rows(
            {"Dimensions (H x L x P)": "H. 178 x L. 59,5 x P. 65,7 cm", "Poids": "68 kg", "Dimensions emballées": "H. 185 x L. 64 x P. 70 cm"},
            "<tr><td>{k}</td><td>{v}</td></tr>",
        )
        + "</table>",
        (1780, 657, 595), whd(595, 1780, 657),
    ),
    Made(
        "Maisons du Monde", "fr",
        '<ul class="dims"><li>Dimensions (cm) : H 77 x L 200 x PR 100</li><li>Poids net (kg) : 60</li></ul>',
        (2000, 1000, 770), whd(2000, 770, 1000),
    ),
    Made(
        "MediaWorld", "it",
        "<ul>"
        + rows(
            {"Larghezza": "60 cm", "Altezza": "85 cm", "Profondità": "55,3 cm", "Larghezza imballo": "65 cm", "Lunghezza cavo": "1,5 m"},
            "<li><p>{k}</p><p>{v}</p></li>",
        )
        + "</ul>",
        (850, 600, 553), whd(600, 850, 553),
    ),
    Made(
        "Mondo Convenienza", "it",
        "<div><b>Misure:</b> L 240 x P 95 x H 88 cm</div><div><b>Seduta:</b> altezza 45 cm, profondità 56 cm</div>",
        (2400, 950, 880), whd(2400, 880, 950),
    ),
    Made(
        "PcComponentes", "es",
        """<h3>Especificaciones</h3><ul><li><strong>Dimensiones</strong><ul><li>Alto: 46,1 cm</li><li>Ancho: 53,9 cm</li>
        <li>Fondo: 19,5 cm</li></ul></li><li><strong>Embalaje</strong><ul><li>Alto: 14 cm</li><li>Ancho: 62 cm</li><li>Fondo: 40 cm</li>
        </ul></li></ul>""",
        (539, 461, 195), whd(539, 461, 195),
    ),
    Made(
        "Kave Home", "es",
        "<dl><dt>Medidas (alto x ancho x fondo)</dt><dd>77 cm x 220 cm x 90 cm</dd><dt>Altura del asiento</dt><dd>43 cm</dd></dl>",
        (2200, 900, 770), whd(2200, 770, 900),
    ),
    Made(
        "Coolblue", "nl",
        '<h3>Afmetingen &amp; gewicht</h3><dl class="product-specs">'
        + rows(
            {"Hoogte": "84,8 cm", "Breedte": "59,8 cm", "Diepte": "59 cm", "Diepte met open deur": "106,3 cm", "Lengte aansluitkabel": "160 cm"},
            "<dt><span>{k}</span></dt><dd>{v}</dd>",
        )
        + "</dl>",
        (848, 598, 590), whd(598, 848, 590),
    ),
    Made(
        "Leen Bakker", "nl",
        "<table><tr><td>Afmetingen (hxbxd)</td><td>85x160x45 cm</td></tr><tr><td>Dikte blad</td><td>3 cm</td></tr></table>",
        (1600, 850, 450), whd(1600, 850, 450),
    ),
    Made(
        "Conforama Portugal", "pt",
        "<p><strong>Medidas:</strong> 140 cm (largura) x 85 cm (altura) x 40 cm (profundidade)</p>",
        (1400, 850, 400), whd(1400, 850, 400),
    ),
    Made(
        "Magazine Luiza", "pt",
        "<table><tr><td>Dimensões do produto</td><td><ul><li>Altura: 74 cm</li><li>Largura: 120 cm</li><li>Profundidade: 60 cm</li></ul></td></tr>"
        "<tr><td>Dimensões da embalagem</td><td><ul><li>Altura: 10 cm</li><li>Largura: 125 cm</li><li>Profundidade: 64 cm</li></ul></td></tr></table>",
        (1200, 740, 600), whd(1200, 740, 600),
    ),
    Made(
        "a car", "en",
        "<h2>Dimensions</h2><table>"
        + rows(
            {"Overall length": "4,284 mm", "Overall width (incl. mirrors)": "2,027 mm", "Overall height": "1,452 mm", "Wheelbase": "2,636 mm", "Boot capacity": "380 litres", "Turning circle": "10.9 m"},
            "<tr><td>{k}</td><td>{v}</td></tr>",
        )
        + "</table>",
        (4284, 2027, 1452), {"length": 4284, "width": 2027, "height": 1452},
    ),
    Made(
        "a ship's infobox", "en",
        '<table class="infobox"><tr><th colspan="2">General characteristics</th></tr>'
        + rows(
            {"Tonnage": "46,328 GRT", "Length": "882 ft 9 in (269.1 m) overall", "Beam": "92 ft 6 in (28.2 m)", "Draught": "34 ft 7 in (10.5 m)"},
            "<tr><td>{k}</td><td>{v}</td></tr>",
        )
        + "</table>",
        (269100, 28200), {"length": 269100, "width": 28200}, ("absurd_size",),
    ),
    Made(
        "a person's infobox", "en",
        '<table class="infobox"><tr><th>Born</th><td>6 January 1990 (age 36)</td></tr><tr><th>Height</th><td>1.93 m (6 ft 4 in)</td></tr>'
        "<tr><th>Weight</th><td>85 kg</td></tr></table>",
        (1930,), {"height": 1930},
    ),
    Made(
        "metres and centimetres mixed", "de",
        "<table><tr><td>Maße (L x B x H)</td><td>1,80 m x 90 cm x 75 cm</td></tr></table>",
        (1800, 900, 750), {"length": 1800, "width": 900, "height": 750},
    ),
    Made(
        "a round table", "en",
        '<ul><li><b>Diameter:</b> 47.25"</li><li><b>Height:</b> 29 1/2"</li><li><b>Base diameter:</b> 24"</li></ul>',
        (1200.2, 1200.2, 749.3), {"diameter": 1200.2, "height": 749.3},
    ),
    Made(
        "variants of one product in an option list", "en",
        '<label>Size</label><select><option>80 x 150 cm</option><option>120 x 180 cm</option></select><p>Hand woven.</p>',
        None, flags=("no_size",),
    ),
    Made(
        "the chosen variant above a chart of all", "en",
        """<table><tr><th>Dimensions</th><td>120 x 180 cm</td></tr></table><h3>All sizes</h3><table><tr><th>Size</th><th>Width</th>
        <th>Length</th></tr><tr><td>S</td><td>80 cm</td><td>150 cm</td></tr><tr><td>M</td><td>120 cm</td><td>180 cm</td></tr></table>""",
        (1800, 1200),
    ),
    Made(
        "a phone", "en",
        "<h3>Body</h3><table>"
        + rows(
            {"Dimensions": "147.6 x 71.6 x 7.8 mm (5.81 x 2.82 x 0.31 in)", "Weight": "171 g (6.03 oz)", "Display": "6.1 inches, 91.3 cm2"},
            "<tr><td class='ttl'>{k}</td><td class='nfo'>{v}</td></tr>",
        )
        + "</table>",
        (147.6, 71.6, 7.8),
    ),
    Made(
        "a page that contradicts itself", "en",
        "<table><tr><th>Product Dimensions</th><td>30 x 40 x 50 cm</td></tr><tr><th>Item Dimensions</th><td>30 x 40 x 90 cm</td></tr></table>",
        (500, 400, 300), flags=("contradicts_itself",),
    ),
]  # fmt: skip

#: A third set, written after the second had been read rightly.
THIRD = [
    Made("Wayfair UK", "en", "<dl><dt>Overall</dt><dd>74cm H x 120cm W x 60cm D</dd><dt>Desk Drawer Interior</dt><dd>8cm H x 40cm W x 35cm D</dd></dl>", (1200, 740, 600), whd(1200, 740, 600)),
    Made(
        "Best Buy, a button between", "en",
        "<h4>Dimension</h4>" + rows({"Product Width": "29.8 inches", "Product Height": "66.5 inches", "Product Depth": "33.4 inches", "Product Weight": "210 pounds"}, '<li><div class="row"><div class="row-title"><div>{k}</div><button aria-label="info"></button></div><div class="row-value">{v}</div></div></li>'),
        (1689.1, 848.4, 756.9), whd(756.9, 1689.1, 848.4),
    ),
    Made("Amazon, measurements", "en", "<table><tr><th>Item Dimensions D x W x H</th><td>16\"D x 17\"W x 29\"H</td></tr><tr><th>Seat Height</th><td>18 Inches</td></tr></table>", (736.6, 431.8, 406.4), whd(431.8, 736.6, 406.4)),
    Made("Samsung", "en", "<ul><li><div><p>Net Dimension (WxHxD)</p><p>912 x 1780 x 716 mm</p></div></li><li><div><p>Packing Dimension (WxHxD)</p><p>970 x 1915 x 776 mm</p></div></li></ul>", (1780, 912, 716), whd(912, 1780, 716)),
    Made("Westwing", "de", "<p><b>Größe:</b> B 120 x H 75 x T 60 cm</p>", (1200, 750, 600), whd(1200, 750, 600)),
    Made("a unit in bold labels", "en", "<ul>" + rows({"Height (cm)": "75", "Width (cm)": "160", "Depth (cm)": "90", "Weight (kg)": "40"}, "<li><strong>{k}</strong> <span>{v}</span></li>") + "</ul>", (1600, 900, 750), whd(1600, 750, 900)),
    Made("Screwfix, letters in brackets", "en", "<table><tr><td>Product dimensions</td><td>(W)600 x (D)450 x (H)850mm</td></tr></table>", (850, 600, 450), whd(600, 850, 450)),
    Made("Toolstation", "en", "<ul><li>H x W x D: 850 x 600 x 450mm</li><li>Weight: 12kg</li></ul>", (850, 600, 450), whd(600, 850, 450)),
    Made("B&Q", "en", "<dl>" + rows({"Product height": "85cm", "Product width": "60cm", "Product depth": "57cm", "Pack quantity": "1"}, "<dt>{k}</dt><dd>{v}</dd>") + "</dl>", (850, 600, 570), whd(600, 850, 570)),
    Made("Very", "en", "<ul><li>Dimensions: Height 85, Width 60, Depth 55 cm</li></ul>", (850, 600, 550), whd(600, 850, 550)),
    Made("Cdiscount", "fr", "<table><tr><td>Dimensions</td><td>L. 120 x l. 60 x H. 75 cm</td></tr></table>", (1200, 750, 600), {"length": 1200, "width": 600, "height": 750}),
    Made("Bauhaus", "de", "<table>" + rows({"Höhe:": "85 cm", "Durchmesser:": "30 cm", "Länge Kabel:": "1,5 m", "Fassungsvermögen:": "20 l"}, "<tr><td>{k}</td><td>{v}</td></tr>") + "</table>", (850, 300, 300), {"height": 850, "diameter": 300}),
    Made("a museum", "en", "<dl><dt>Dimensions</dt><dd>Overall: 30.5 × 20.3 × 15.2 cm (12 × 8 × 6 in.)</dd></dl>", (305, 203, 152)),
    Made("words with the numbers", "es", "<p><strong>Medidas:</strong> Ancho 60 x Fondo 40 x Alto 85 cm</p>", (850, 600, 400), whd(600, 850, 400)),
    Made("words in the label", "pt", "<table><tr><th>Altura x Largura x Profundidade</th><td>85 x 60 x 55 cm</td></tr></table>", (850, 600, 550), whd(600, 850, 550)),
    Made("an order before the numbers", "nl", "<ul><li>Afmetingen: (b x h x d) 60 x 85 x 55 cm</li></ul>", (850, 600, 550), whd(600, 850, 550)),
    Made("a table with an empty column", "de", "<table><tr><td></td><td>Breite</td><td>80 cm</td></tr><tr><td></td><td>Höhe</td><td>200 cm</td></tr><tr><td></td><td>Tiefe</td><td>40 cm</td></tr></table>", (2000, 800, 400), whd(800, 2000, 400)),
    Made("two pairs in a row", "en", "<table><tr><td>Width</td><td>80 cm</td><td>Height</td><td>200 cm</td></tr><tr><td>Depth</td><td>40 cm</td><td>Weight</td><td>30 kg</td></tr></table>", (2000, 800, 400), whd(800, 2000, 400)),
    Made("description of a table and its chairs", "en", "<h3>Dimensions</h3><ul><li>Table: 75 x 120 x 80 cm</li><li>Chair: 90 x 45 x 50 cm</li></ul>", (1200, 800, 750), flags=("contradicts_itself",)),
    Made("thickness first", "en", "<table>" + rows({"Glass thickness": "8 mm", "Width": "120 cm", "Height": "45 cm", "Depth": "60 cm"}, "<tr><td>{k}</td><td>{v}</td></tr>") + "</table>", (1200, 600, 450), whd(1200, 450, 600)),
    Made("a range of widths", "en", "<table><tr><td>Width</td><td>60 - 100 cm</td></tr><tr><td>Height</td><td>85 cm</td></tr></table>", (850, 800), {"width": 800, "height": 850}, ("range",)),
    Made("a package in the next paragraph", "it", "<div><p>Dimensioni: 60 x 40 x 85 cm</p><p>Imballo: 65 x 45 x 90 cm</p></div>", (850, 600, 400), flags=("low_trust",)),
    Made("a paragraph of bold words", "fr", "<p><strong>Hauteur :</strong> 85 cm<br><strong>Largeur :</strong> 60 cm<br><strong>Profondeur :</strong> 55 cm<br><strong>Hauteur assise :</strong> 45 cm</p>", (850, 600, 550), whd(600, 850, 550)),
    Made("metres alone", "en", "<table><tr><td>Size</td><td>1.2m x 0.6m x 0.75m</td></tr></table>", (1200, 750, 600)),
]  # fmt: skip
