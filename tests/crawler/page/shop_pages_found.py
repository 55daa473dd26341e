"""A fourth set of made-up pages: ways of writing met in public repositories, and on pages by authors who had not seen
the reader. With other numbers; the authors' pages imitate whole sites and are not kept."""

# ruff: noqa: E501 - markup stands as sites write it

from __future__ import annotations

from tests.crawler.page.shop_pages import Made, whd

FOUND = [
    Made(
        "a table whose first row names its group", "en",
        '<table border="1"><thead><tr><th>Category</th><th>Name</th><th>Details</th></tr></thead><tbody><tr><td rowspan="3">Module</td>'
        "<td>Overall Dimensions</td><td>81.5*22.4*19.6 mm</td></tr><tr><td>Baseline</td><td>42mm</td></tr><tr><td>Working Distance</td><td>30~300cm</td></tr></tbody></table>",
        (81.5, 22.4, 19.6), {},
    ),
    Made(
        "a forgotten x", "en",
        "<table><tr><th>Item Dimensions LxWxH</th><td>15.02  20.63 x 8.04 inches</td></tr></table>",
        (524, 381.5, 204.2), {"length": 381.5, "width": 524, "height": 204.2},
    ),
    Made(
        "thousands of millimetres with points", "en",
        "<p>Schaltschrank<br>Maße (B x H x T): 1.200 x 1.800 x 400 mm</p>",
        (1800, 1200, 400), whd(1200, 1800, 400),
    ),
    Made(
        "a decimal point in millimetres", "en",
        "<table><tr><th>Dimensions</th><td>1.250 x 0.750 x 300 mm</td></tr></table>",
        (300, 1.2, 0.8), {},
    ),
    Made(
        "a form filled in with ones", "de",
        "<table><tr><th>Produktabmessungen</th><td>1 x 1 x 1 cm; 520 Gramm</td></tr></table>",
        (10, 10, 10), {}, ("placeholder",),
    ),
    Made(
        "a size behind another label in running text", "es",
        "<p>Material del producto: MDF de 18 mm. Medidas: Alto: 82 cm Ancho: 110 cm Profundidad: 45 cm Peso: 30 kg</p>",
        (1100, 820, 450), whd(1100, 820, 450), ("low_trust",),
    ),
    Made(
        "a label for the size before labels for its axes", "es",
        "<ul><li>Medidas: Alto: 19 cm, Ancho: 62 cm, Profundo: 34 cm.</li><li>Acero inoxidable.</li></ul>",
        (620, 340, 190), whd(620, 190, 340),
    ),
    Made(
        "axes behind `in`", "en",
        "<p>The table measures 160cm in length, 80cm in width and 74cm in height.</p>",
        (1600, 800, 740), {"length": 1600, "width": 800, "height": 740}, ("low_trust",),
    ),
    Made(
        "numbers parted by slashes alone", "de",
        "<table><tr><th>Maße (B/H/T) in cm</th><td>120/75/60</td></tr></table>",
        (1200, 750, 600), whd(1200, 750, 600),
    ),
    Made(
        "a list entry with a label of its own below a heading of weights, in two systems that do not agree", "en",
        "<ul><p><b>Dimension / weight</b></p><li>Product dimensions (HxWxD) : <span>620 x 510 x 330 mm (27 x 20 x 13 in.)</span></li><li>Product weight : <span>14KG</span></li></ul>",
        (620, 510, 330), whd(510, 620, 330), ("contradicts_itself",),
    ),
    Made(
        "a picture's size", "en",
        "<ul><li><strong>Optimal Dimensions:</strong> 1200 × 400 pixels or 1920 × 600 pixels.</li></ul>",
        None, None, ("no_size",),
    ),
    Made(
        "lines below a label for size and weight, each in two systems", "en",
        '<h2>Tech specs</h2><ul><li><div class="h5">Dimensions &amp; Weight</div><p>Height: 7.2 in. (183.00 mm)<br>Width: 1.4 in. (35.50 mm)<br>'
        "Depth: 7.0 in. (178.00 mm)<br>Starting weight: 2.30 lb (1.04 kg)</p></li></ul>",
        (183, 178, 35.5), whd(35.5, 183, 178),
    ),
    Made(
        "parts that a size takes in together", "en",
        '<ul><li><strong>Dimensions (kettle + base):</strong> 290 mm L x 170 mm W x 200 mm H (11.4 x 6.7 x 7.9 in)</li>'
        '<li><strong>Base only:</strong> 7" L x 6.5" W x 2.1" H</li><li><strong>Cord length:</strong> 30 in</li></ul>',
        (290, 200, 170), {"length": 290, "width": 170, "height": 200},
    ),
    Made(
        "a complete model, each length in brackets again before its axis", "en",
        "<ul><li>Display piece - The complete model measures over 15.7 in. (40 cm) high, 29.5 in. (75 cm) wide and 19.7 in. (50 cm) deep</li></ul>",
        (750, 500, 400), whd(750, 400, 500), ("low_trust",),
    ),
    Made(
        "others below a heading that says so", "de",
        "<h2>Maßangaben</h2><table><tr><td>Breite</td><td>130 cm</td></tr><tr><td>Tiefe</td><td>38 cm</td></tr><tr><td>Höhe</td><td>88,5 cm</td></tr>"
        "<tr><td>Innenmaß Schublade (BxTxH)</td><td>38 x 31 x 11 cm</td></tr></table>"
        '<h3>Das könnte dir auch gefallen</h3><ul><li><a href="/k">Kommode B/T/H: 60x33x84 cm</a></li></ul>',
        (1300, 885, 380), whd(1300, 885, 380),
    ),
    Made(
        "a table of sister products beside the size", "de",
        "<table><tr><th>Produktabmessungen</th><td>30T x 66B x 165,5H cm</td></tr></table>"
        "<h2>Vom Hersteller</h2><table><tr><td>Maße (cm)</td><td>30 x 66 x 93</td><td>30 x 66 x 129</td><td>30 x 66 x 165,5</td></tr></table>",
        (1655, 660, 300), whd(660, 1655, 300),
    ),
    Made(
        "the niche of a built-in item", "de",
        "<dl><dt>Abmessungen des Gerätes (H x B x T)</dt><dd>815 x 598 x 550 mm</dd><dt>Nischenmaße (H x B x T)</dt><dd>815-875 x 600 x 550 mm</dd>"
        "<dt>Abmessungen des verpackten Gerätes (H x B x T)</dt><dd>880 x 650 x 670 mm</dd></dl>",
        (815, 598, 550), whd(598, 815, 550),
    ),
    Made(
        "a table unfolded, with its folded size beside", "fr",
        "<h4>Dimensions ouverte</h4><p>Longueur : 110 cm<br>Largeur : 70 cm<br>Hauteur : 72 cm</p>"
        "<h4>Dimensions pliée</h4><p>L 70 cm x l 55 cm x ép. 7 cm | Volume : 27 L</p>",
        (1100, 720, 700), {"length": 1100, "width": 700, "height": 720},
    ),
    Made(
        "an aircraft's span", "fr",
        "<table><tr><th>Envergure</th><td>8,10 m</td></tr><tr><th>Longueur</th><td>7,90 m</td></tr><tr><th>Hauteur</th><td>2,60 m</td></tr></table>",
        (8100, 7900, 2600), {"width": 8100, "length": 7900, "height": 2600},
    ),
    Made(
        "a listed height", "en",
        "<table><tr><th>Listed height</th><td>7 ft 5 in (2.26 m)</td></tr><tr><th>Listed weight</th><td>300 lb (136 kg)</td></tr></table>",
        (2260,), {"height": 2260},
    ),
    Made(
        "the item's own name before three axes", "en",
        '<h2>Product details</h2><ul><li>Product: 70.9” L x 31.5” W x 28.5”–47.7” H</li><li>Drawer Interior: 23.6” L x 13.0” W x 2.4” H</li><li>6 ft. power cord</li></ul>',
        (1800.9, 967.7, 800.1), {"length": 1800.9, "width": 800.1, "height": 967.7}, ("range",),
    ),
    Made(
        "a table headed by axes with one row that has a name", "en",
        '<table class="dimensions"><thead><tr><th></th><th>Width</th><th>Depth</th><th>Height</th></tr></thead><tbody><tr><td>Recliner</td><td>34.00"</td><td>39.00"</td><td>42.00"</td></tr></tbody></table>'
        '<h4>Additional Dimensions</h4><ul><li>Footrest height: 19"</li><li>Arm height: 25"</li></ul>',
        (1066.8, 990.6, 863.6), whd(863.6, 1066.8, 990.6),
    ),
    Made(
        "a pallet, and what the item works with", "en",
        "<h2>Tech specs</h2><ul><li><div>Package dimensions (W x D x H)</div><div>14.92 x 4.49 x 8.74 in</div></li><li><div>Pallet dimensions (W x D x H)</div><div>47.2 x 39.4 x 96.9 in</div></li></ul>"
        "<h2>Works with</h2><div><p>16.54 x 15.35 x 12.72 in; 27.78 lb</p></div>",
        None, None, ("no_size",),
    ),
    Made(
        "the greatest diameter of a lens", "en",
        "<table><tr><td>Filter Size</td><td>77mm</td></tr><tr><td>Max. Diameter x Length, Weight</td><td>Approx. 3.29 x 4.22 in./ 83.5 x 107.3mm, approx. 1.54 lbs. / 700g</td></tr></table>",
        (107.3, 83.5, 83.5), {"diameter": 83.5, "length": 107.3},
    ),
    Made(
        "a line with two axes and nothing else", "en",
        "<p>Approx. 10.5–11” wide x 3.5–4” tall</p>",
        (273, 95.2), {"width": 273, "height": 95.2}, ("low_trust", "range"),
    ),
    Made(
        "parts below headings of their own", "en",
        '<h3>Overall Dimensions</h3><dl><dt>Width</dt><dd>93"</dd><dt>Depth</dt><dd>46"</dd><dt>Height</dt><dd>37"</dd></dl>'
        '<h3>Seat</h3><dl><dt>Width</dt><dd>81"</dd><dt>Depth</dt><dd>29"</dd><dt>Height</dt><dd>19"</dd></dl>',
        (2362.2, 1168.4, 939.8), whd(2362.2, 939.8, 1168.4),
    ),
    Made(
        "a book's format", "fr",
        "<dl><dt>Format</dt><dd>14,00 x 20,50 cm</dd><dt>Nombre de pages</dt><dd>368</dd></dl>",
        (205, 140), {},
    ),
    Made(
        "a product in its package", "es",
        "<h4>Medidas y peso</h4><dl><dt>Alto</dt><dd>84,6 cm</dd><dt>Ancho</dt><dd>59,6 cm</dd><dt>Fondo</dt><dd>58 cm</dd>"
        "<dt>Dimensiones del producto embalado (alto x ancho x fondo)</dt><dd>875 x 640 x 670 mm</dd></dl>",
        (846, 596, 580), whd(596, 846, 580),
    ),
    Made(
        "a screen with and without its stand", "pt",
        "<table><tr><td>Altura com base</td><td>78,5 cm</td></tr><tr><td>Largura com base</td><td>123,4 cm</td></tr><tr><td>Profundidade com base</td><td>23,2 cm</td></tr>"
        "<tr><td>Dimensões sem base (AxLxP)</td><td>71,8 x 123,4 x 5,7 cm</td></tr></table>",
        (1234, 785, 232), whd(1234, 785, 232),
    ),
    Made(
        "parts with axes of their own, and no size of the whole", "en",
        "<h3>Components</h3><table><tr><td>Saddle</td><td>Short Comp, 150mm width</td></tr><tr><td>Crank</td><td>Alloy, 50/34, 170mm length</td></tr>"
        "<tr><td>Weight</td><td>10.5 kg</td></tr></table>",
        None, None, ("no_size",),
    ),
    Made(
        "a thickness alone", "en",
        "<table><tr><td>Thickness</td><td>1200gsm grey board (2mm) + 157gsm art paper</td></tr><tr><td>Single package size</td><td>30X25X5 cm</td></tr></table>",
        None, None, ("no_size",),
    ),
    Made(
        "a size of two axes and the third in a row of its own", "de",
        "<dl><dt>Größe (B x L)</dt><dd>160 x 200 cm</dd><dt>Höhe</dt><dd>ca. 19 cm</dd><dt>Härtegrad</dt><dd>H3</dd></dl>",
        (2000, 1600, 190), {"width": 1600, "length": 2000, "height": 190},
    ),
    Made(
        "a diameter at its greatest", "en",
        "<dl><dt>Museum number</dt><dd>1945,0927.1</dd><dt>Dimensions</dt><dd>Diameter: 17.70 centimetres (max) Height: 24 centimetres</dd></dl>",
        (240, 177, 177), {"diameter": 177, "height": 240},
    ),
    Made(
        "a size in its `empaque`", "es",
        "<table><tr><td>Alto</td><td>111.8 cm</td></tr><tr><td>Ancho</td><td>68.6 cm</td></tr><tr><td>Profundidad</td><td>71.5 cm</td></tr>"
        "<tr><td>Medidas del empaque (alto x ancho x fondo)</td><td>116 x 73 x 75 cm</td></tr></table>",
        (1118, 715, 686), whd(686, 1118, 715),
    ),
    Made(
        "a part in brackets behind a comma's list", "en",
        "<table><tr><th>Dimensions (overall)</th><td>W 60 x D 62 x H 90 cm</td></tr><tr><th>Dimensions (seat, W x D x H)</th><td>48 x 45 x 46 cm</td></tr></table>",
        (900, 620, 600), whd(600, 900, 620),
    ),
]  # fmt: skip
