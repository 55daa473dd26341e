"""Fifty pages more, after the markup of real shops: diameters, seat heights, packages, sets, brackets and half-lines."""

# ruff: noqa: E501 - markup stands as sites write it

from __future__ import annotations

from tests.crawler.page.shop_pages import Made, rows, whd

TR, LI, DL = "<tr><th>{k}</th><td>{v}</td></tr>", "<li><b>{k}:</b> {v}</li>", "<dt>{k}</dt><dd>{v}</dd>"


def _table(pairs: dict[str, str], form: str = TR) -> str:
    body = rows(pairs, form)
    return f"<table>{body}</table>" if form == TR else f"<ul>{body}</ul>" if form == LI else f"<dl>{body}</dl>"


def _lwh(length: float, width: float, height: float) -> dict[str, float]:
    return {"length": length, "width": width, "height": height}


def _round(diameter: float, height: float) -> dict[str, float]:
    return {"diameter": diameter, "height": height}


FIFTY = [
    Made(
        "letters in brackets behind numbers",
        "en",
        "<p>Dimensions: 180 (L) x 90 (W) x 75 (H) cm</p>",
        (1800, 900, 750),
        _lwh(1800, 900, 750),
        ("low_trust",),
    ),
    Made(
        "letters in brackets, in a list",
        "en",
        _table({"Size": "42(W) x 47(D) x 88(H) cm", "Weight": "5 kg"}, LI),
        (880, 470, 420),
        whd(420, 880, 470),
    ),
    Made(
        "letters glued before",
        "en",
        _table({"Product Dimensions": "W80cm x D40cm x H120cm"}),
        (1200, 800, 400),
        whd(800, 1200, 400),
    ),
    Made(
        "letters glued behind",
        "en",
        _table({"Dimensions": '31.5"W x 15.7"D x 47.2"H'}),
        (1198.9, 800.1, 398.8),
        whd(800.1, 1198.9, 398.8),
    ),
    Made(
        "Argos",
        "en",
        "<ul><li>Size H75, W120, D60cm.</li><li>Weight 22kg.</li></ul>",
        (1200, 750, 600),
        whd(1200, 750, 600),
    ),
    Made(
        "Dunelm",
        "en",
        _table({"Dimensions": "H 45cm x W 110cm x D 60cm", "Assembly": "Self assembly"}, DL),
        (1100, 600, 450),
        whd(1100, 450, 600),
    ),
    Made(
        "John Lewis",
        "en",
        _table({"Dimensions": "H78 x W80 x D84cm", "Seat dimensions": "H43 x W55 x D56cm"}, DL),
        (840, 800, 780),
        whd(800, 780, 840),
    ),
    Made(
        "Made.com",
        "en",
        _table(
            {
                "Height": "82cm",
                "Width": "56cm",
                "Depth": "60cm",
                "Seat height": "46cm",
                "Packaging dimensions": "90 x 60 x 65cm",
            }
        ),
        (820, 600, 560),
        whd(560, 820, 600),
    ),
    Made(
        "Maisons du Monde",
        "fr",
        _table({"Dimensions (cm)": "H 76 x L 160 x PR 90", "Poids": "32 kg"}),
        (1600, 900, 760),
        whd(1600, 760, 900),
    ),
    Made(
        "La Redoute",
        "fr",
        "<ul><li>Largeur : 120 cm</li><li>Hauteur : 75 cm</li><li>Profondeur : 60 cm</li><li>Hauteur d'assise : 45 cm</li></ul>",
        (1200, 750, 600),
        whd(1200, 750, 600),
    ),
    Made(
        "Conforama",
        "fr",
        "<p>Dimensions : L.140 x H.75 x P.80 cm</p><p>Dimensions du colis : L.150 x H.12 x P.85 cm</p>",
        (1400, 800, 750),
        whd(1400, 750, 800),
        ("low_trust",),
    ),
    Made("Castorama", "fr", _table({"Diamètre": "35 cm", "Hauteur": "40 cm"}), (400, 350, 350), _round(350, 400)),
    Made(
        "Otto",
        "de",
        _table({"Breite": "140 cm", "Tiefe": "70 cm", "Höhe": "75 cm", "Sitzhöhe": "46 cm"}),
        (1400, 750, 700),
        whd(1400, 750, 700),
    ),
    Made(
        "Roller",
        "de",
        "<ul><li>Maße (B x T x H): ca. 90 x 40 x 180 cm</li><li>Gewicht: 38 kg</li></ul>",
        (1800, 900, 400),
        whd(900, 1800, 400),
    ),
    Made("XXXLutz", "de", _table({"Maße": "B/H/T: ca. 200/85/95 cm"}), (2000, 950, 850), whd(2000, 850, 950)),
    Made(
        "Höffner",
        "de",
        _table(
            {"Breite": "ca. 120 cm", "Höhe": "ca. 75 cm", "Tiefe": "ca. 60 cm", "Verpackungsmaße": "130 x 20 x 70 cm"}
        ),
        (1200, 750, 600),
        whd(1200, 750, 600),
    ),
    Made("Hornbach", "de", _table({"Durchmesser": "25 cm", "Höhe": "22 cm"}), (250, 250, 220), _round(250, 220)),
    Made("Tchibo", "de", "<p>Maße (Ø x H): ca. 8,5 x 9,5 cm</p>", (95, 85, 85), _round(85, 95), ("low_trust",)),
    Made(
        "Leroy Merlin",
        "it",
        _table({"Larghezza (cm)": "80", "Profondità (cm)": "45", "Altezza (cm)": "200"}),
        (2000, 800, 450),
        whd(800, 2000, 450),
    ),
    Made(
        "Mondo Convenienza",
        "it",
        "<p>Dimensioni: L 220 x P 95 x H 88 cm</p>",
        (2200, 950, 880),
        whd(2200, 880, 950),
        ("low_trust",),
    ),
    Made(
        "Kave Home",
        "es",
        _table({"Alto": "78 cm", "Ancho": "60 cm", "Fondo": "58 cm", "Altura del asiento": "47 cm"}),
        (780, 600, 580),
        whd(600, 780, 580),
    ),
    Made(
        "El Corte Inglés",
        "es",
        _table({"Medidas": "120 x 60 x 75 cm (ancho x fondo x alto)"}),
        (1200, 750, 600),
        whd(1200, 750, 600),
    ),
    Made(
        "Fonq",
        "nl",
        _table({"Breedte": "45 cm", "Diepte": "52 cm", "Hoogte": "81 cm", "Zithoogte": "47 cm"}),
        (810, 520, 450),
        whd(450, 810, 520),
    ),
    Made(
        "Ikea, measurements",
        "en",
        "<dl><dt>Width:</dt><dd>80 cm</dd><dt>Depth:</dt><dd>28 cm</dd><dt>Height:</dt><dd>202 cm</dd><dt>Max load/shelf:</dt><dd>30 kg</dd></dl>",
        (2020, 800, 280),
        whd(800, 2020, 280),
    ),
    Made(
        "Ikea, a package below",
        "en",
        "<dl><dt>Width:</dt><dd>55 cm</dd><dt>Length:</dt><dd>90 cm</dd><dt>Height:</dt><dd>45 cm</dd></dl><h3>Packaging</h3><p>Width: 56 cm Height: 5 cm Length: 92 cm Weight: 9 kg</p>",
        (900, 550, 450),
        _lwh(900, 550, 450),
    ),
    Made(
        "Target",
        "en",
        "<div><b>Dimensions (Overall):</b> 30 Inches (H) x 60 Inches (W) x 24 Inches (D)</div>",
        (1524, 762, 609.6),
        whd(1524, 762, 609.6),
    ),
    Made(
        "Walmart",
        "en",
        _table({"Assembled Product Dimensions (L x W x H)": "23.60 x 15.70 x 29.50 Inches"}),
        (749.3, 599.4, 398.8),
        _lwh(599.4, 398.8, 749.3),
    ),
    Made(
        "Home Depot",
        "en",
        _table({"Product Depth (in.)": "16 in", "Product Height (in.)": "72 in", "Product Width (in.)": "36 in"}),
        (1828.8, 914.4, 406.4),
        whd(914.4, 1828.8, 406.4),
    ),
    Made(
        "Best Buy",
        "en",
        _table(
            {
                "Product Height": "12.2 inches",
                "Product Width": "20.5 inches",
                "Product Depth": "17.1 inches",
                "Package height": "15 inches",
            }
        ),
        (520.7, 434.3, 309.9),
        whd(520.7, 309.9, 434.3),
    ),
    Made(
        "Pottery Barn",
        "en",
        '<ul><li>Overall: 40" wide x 36" deep x 33" high</li><li>Seat: 26" wide x 22" deep x 18" high</li></ul>',
        (1016, 914.4, 838.2),
        whd(1016, 838.2, 914.4),
    ),
    Made(
        "West Elm",
        "en",
        '<ul><li>Overall product dimensions: 60"w x 36"d x 30"h.</li><li>Leg height: 28".</li></ul>',
        (1524, 914.4, 762),
        whd(1524, 762, 914.4),
    ),
    Made(
        "CB2",
        "en",
        '<div>overall dimensions</div><div>Width: 72.0"</div><div>Depth: 36.0"</div><div>Height: 29.5"</div>',
        (1828.8, 914.4, 749.3),
        whd(1828.8, 749.3, 914.4),
    ),
    Made(
        "Etsy, prose",
        "en",
        "<p>Each bowl is hand thrown and measures 15 cm in diameter and 7 cm tall.</p>",
        (150, 150, 70),
        _round(150, 70),
        ("low_trust",),
    ),
    Made(
        "a mug with its handle",
        "en",
        _table({"Height": "9.5 cm", "Diameter": "8 cm", "Capacity": "350 ml"}),
        (95, 80, 80),
        _round(80, 95),
    ),
    Made(
        "no size but the package's",
        "en",
        _table({"Package dimensions": "30 x 20 x 10 cm", "Item weight": "1 kg"}),
        None,
        None,
        ("no_size",),
    ),
    Made(
        "no size but the seat's",
        "en",
        _table({"Seat height": "46 cm", "Seat width": "50 cm", "Max. load": "110 kg"}),
        None,
        None,
        ("no_size",),
    ),
    Made(
        "no size but the screen's",
        "en",
        _table({"Screen size": "55 inch", "Resolution": "3840 x 2160"}),
        None,
        None,
        ("no_size",),
    ),
    Made(
        "shipping carton",
        "en",
        _table({"Carton size (L x W x H)": "62 x 40 x 35 cm", "Width": "58 cm", "Depth": "36 cm", "Height": "32 cm"}),
        (580, 360, 320),
        whd(580, 320, 360),
    ),
    Made(
        "gift box",
        "en",
        "<ul><li>Size: 12 x 8 x 4 cm (L x W x H)</li><li>Box size: 14 x 10 x 6 cm</li></ul>",
        (120, 80, 40),
        _lwh(120, 80, 40),
    ),
    Made(
        "millimetres in the heading",
        "en",
        _table({"Dimensions (mm)": "600 x 550 x 850 (W x D x H)"}),
        (850, 600, 550),
        whd(600, 850, 550),
    ),
    Made(
        "AO, millimetres",
        "en",
        _table({"Height (mm)": "1850", "Width (mm)": "595", "Depth (mm)": "650"}),
        (1850, 650, 595),
        whd(595, 1850, 650),
    ),
    Made(
        "a metre and centimetres",
        "en",
        _table({"Length": "1.8 m", "Width": "90 cm", "Height": "74 cm"}),
        (1800, 900, 740),
        _lwh(1800, 900, 740),
    ),
    Made(
        "feet and inches",
        "en",
        _table({"Length": "6 ft", "Width": "2 ft 6 in", "Height": "29 in"}),
        (1828.8, 762, 736.6),
        _lwh(1828.8, 762, 736.6),
    ),
    Made(
        "fractions",
        "en",
        "<p>Overall: 35-1/2&quot; W x 17 3/4&quot; D x 30½&quot; H</p>",
        (901.7, 774.7, 450.9),
        whd(901.7, 774.7, 450.9),
        ("low_trust",),
    ),
    Made(
        "a unit after each and letters behind",
        "en",
        "<p>Measures 45cm wide, 40cm deep and 90cm high.</p>",
        (900, 450, 400),
        whd(450, 900, 400),
        ("low_trust",),
    ),
    Made(
        "Coolblue",
        "nl",
        _table({"Hoogte": "84,5 cm", "Breedte": "59,8 cm", "Diepte": "60 cm"}),
        (845, 600, 598),
        whd(598, 845, 600),
    ),
    Made("Jysk", "en", _table({"Size": "W90 x L200 cm", "Height": "22 cm"}), (2000, 900, 220), None),
    Made(
        "Wikipedia-like infobox",
        "en",
        _table(
            {
                "Length": "4,258 mm (167.6 in)",
                "Width": "1,790 mm (70.5 in)",
                "Height": "1,492 mm (58.7 in)",
                "Wheelbase": "2,620 mm (103.1 in)",
            }
        ),
        (4258, 1790, 1492),
        _lwh(4258, 1790, 1492),
    ),
    Made("a choice of widths", "de", _table({"Breite": "90/120/160 cm", "Höhe": "200 cm"}), (2000,), {"height": 2000}),
    Made(
        "thickness of a flat item",
        "en",
        _table({"Length": "60 cm", "Width": "40 cm", "Thickness": "2 cm"}),
        (600, 400, 20),
        None,
    ),
]
