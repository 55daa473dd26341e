"""Product pages in shops' markup: schema.org data, tables, definition lists, microdata, and what a person reads there.

Written by us, with the words that shops use for diameters, seat heights, packages and sets. The expectations were
written before the reader was run on them, but for the flag of the sentence. One page of fifty is not here: of `Top
diameter: 20 cm; Base diameter: 14 cm; Height: 24 cm` the reader takes the height alone.
"""

# ruff: noqa: E501 - markup stands as sites write it

from __future__ import annotations

from tests.crawler.page.shop_pages import Made, rows

TR = "<tr><th>{k}</th><td>{v}</td></tr>"
DL = "<dt>{k}</dt><dd>{v}</dd>"
LI = "<li><strong>{k}</strong> {v}</li>"


def table(cells: dict[str, str]) -> str:
    return f'<table class="specifications">{rows(cells, TR)}</table>'


def definitions(cells: dict[str, str]) -> str:
    return f'<dl class="product-attributes">{rows(cells, DL)}</dl>'


def listed(cells: dict[str, str]) -> str:
    return f'<h3>Specifications</h3><ul class="features">{rows(cells, LI)}</ul>'


def linked_data(fields: str) -> str:
    return (
        '<script type="application/ld+json">{"@context":"https://schema.org","@type":"Product","name":"Item",'
        + fields
        + "}</script>"
    )


def quantity(name: str, value: float, code: str) -> str:
    return f'"{name}":{{"@type":"QuantitativeValue","value":{value},"unitCode":"{code}"}}'


STATED = [
    Made(
        "letters in brackets",
        "en",
        table({"Dimensions": "180 (L) x 90 (W) x 75 (H) cm", "Seats": "6"}),
        (1800, 900, 750),
        {"length": 1800, "width": 900, "height": 750},
    ),
    Made(
        "order behind, one unit",
        "de",
        table({"Maße": "60 × 40 × 75 (B × T × H) cm", "Material": "Eiche"}),
        (750, 600, 400),
        {"width": 600, "depth": 400, "height": 750},
    ),
    Made(
        "abbreviated letters",
        "fr",
        definitions({"Dimensions": "H.75 x L.90 x P.40 cm", "Matière": "hêtre"}),
        (900, 750, 400),
        {"height": 750, "width": 900, "depth": 400},
    ),
    Made(
        "seat height in a row of its own",
        "en",
        table({"Width": "52 cm", "Depth": "55 cm", "Height": "82 cm", "Seat height": "46 cm"}),
        (820, 550, 520),
        {"width": 520, "depth": 550, "height": 820},
    ),
    Made(
        "seat height as SH",
        "en",
        table({"Dimensions": "W: 60cm, D: 58cm, H: 75cm, SH: 45cm"}),
        (750, 600, 580),
        {"width": 600, "depth": 580, "height": 750},
    ),
    Made(
        "Sitzhöhe",
        "de",
        definitions({"Breite": "45 cm", "Tiefe": "50 cm", "Höhe": "90 cm", "Sitzhöhe": "45 cm"}),
        (900, 500, 450),
        {"width": 450, "depth": 500, "height": 900},
    ),
    Made(
        "hauteur d'assise",
        "fr",
        definitions({"Largeur": "45 cm", "Profondeur": "50 cm", "Hauteur": "90 cm", "Hauteur d'assise": "47 cm"}),
        (900, 500, 450),
        {"width": 450, "depth": 500, "height": 900},
    ),
    Made(
        "altura del asiento",
        "es",
        table({"Ancho": "45 cm", "Fondo": "50 cm", "Alto": "90 cm", "Altura del asiento": "47 cm"}),
        (900, 500, 450),
        {"width": 450, "depth": 500, "height": 900},
    ),
    Made(
        "altezza seduta",
        "it",
        table({"Larghezza": "45 cm", "Profondità": "50 cm", "Altezza": "90 cm", "Altezza seduta": "47 cm"}),
        (900, 500, 450),
        {"width": 450, "depth": 500, "height": 900},
    ),
    Made(
        "diameter and height",
        "en",
        table({"Diameter": "40 cm", "Height": "45 cm"}),
        (450, 400, 400),
        {"diameter": 400, "height": 450},
    ),
    Made("diameter sign", "de", table({"Maße": "Ø 40 cm, H 45 cm"}), (450, 400, 400), {"diameter": 400, "height": 450}),
    Made("dia. by H", "en", table({"Size": "dia. 30 x H 12 cm"}), (300, 300, 120), {"diameter": 300, "height": 120}),
    Made(
        "Durchmesser",
        "de",
        listed({"Durchmesser:": "26 cm", "Höhe:": "7,5 cm", "Füllmenge:": "2,5 l"}),
        (260, 260, 75),
        {"diameter": 260, "height": 75},
    ),
    Made(
        "diamètre",
        "fr",
        listed({"Diamètre :": "26 cm", "Hauteur :": "7,5 cm"}),
        (260, 260, 75),
        {"diameter": 260, "height": 75},
    ),
    Made(
        "diametro",
        "it",
        definitions({"Diametro": "26 cm", "Altezza": "7,5 cm"}),
        (260, 260, 75),
        {"diameter": 260, "height": 75},
    ),
    Made(
        "package below the product",
        "en",
        table({"Product dimensions": "45 x 30 x 20 cm", "Package dimensions": "50 x 35 x 25 cm"}),
        (450, 300, 200),
    ),
    Made(
        "packed beside assembled",
        "en",
        table({"Assembled": "H85 x W60 x D55cm", "Packed": "H15 x W65 x D60cm"}),
        (850, 600, 550),
        {"height": 850, "width": 600, "depth": 550},
    ),
    Made(
        "Verpackungsmaße",
        "de",
        table({"Artikelmaße (B x H x T)": "60 x 85 x 55 cm", "Verpackungsmaße": "65 x 15 x 60 cm"}),
        (850, 600, 550),
        {"width": 600, "height": 850, "depth": 550},
    ),
    Made(
        "colis",
        "fr",
        table({"Dimensions": "L 120 x l 60 x H 75 cm", "Dimensions du colis": "L 125 x l 65 x H 12 cm"}),
        (1200, 750, 600),
        {"length": 1200, "width": 600, "height": 750},
    ),
    Made(
        "only a package",
        "en",
        table({"Shipping dimensions": "50 x 35 x 25 cm", "Shipping weight": "4 kg"}),
        None,
        flags=("no_size",),
    ),
    Made(
        "quantities of schema.org",
        "en",
        "<p>A chest.</p>",
        (900, 800, 400),
        {"width": 900, "height": 800, "depth": 400},
        head=linked_data(
            ", ".join((quantity("width", 90, "CMT"), quantity("height", 80, "CMT"), quantity("depth", 40, "CMT")))
        ),
    ),
    Made(
        "quantities in inches",
        "en",
        "<p>A chest.</p>",
        (914.4, 762, 406.4),
        {"width": 914.4, "height": 762, "depth": 406.4},
        head=linked_data(
            ", ".join((quantity("width", 36, "INH"), quantity("height", 30, "INH"), quantity("depth", 16, "INH")))
        ),
    ),
    Made(
        "quantities in millimetres",
        "de",
        "<p>Regal.</p>",
        (1800, 800, 300),
        {"width": 800, "height": 1800, "depth": 300},
        head=linked_data(
            ", ".join((quantity("width", 800, "MMT"), quantity("height", 1800, "MMT"), quantity("depth", 300, "MMT")))
        ),
    ),
    Made(
        "additional properties",
        "en",
        "<p>A bench.</p>",
        (1200, 450, 350),
        {"width": 1200, "height": 450, "depth": 350},
        head=linked_data(
            '"additionalProperty":[{"@type":"PropertyValue","name":"Width","value":"120 cm"},{"@type":"PropertyValue","name":"Height","value":"45 cm"},{"@type":"PropertyValue","name":"Depth","value":"35 cm"},{"@type":"PropertyValue","name":"Seat height","value":"45 cm"}]'
        ),
    ),
    Made(
        "microdata",
        "en",
        '<div itemscope itemtype="https://schema.org/Product"><span itemprop="name">Shelf</span><span itemprop="width">80 cm</span><span itemprop="height">180 cm</span><span itemprop="depth">30 cm</span></div>',
        (1800, 800, 300),
        {"width": 800, "height": 1800, "depth": 300},
    ),
    Made(
        "metric aside",
        "en",
        table({"Overall": "30 in. (76 cm) W x 15.5 in. (39 cm) D x 34 in. (86 cm) H"}),
        (860, 760, 390),
        {"width": 760, "depth": 390, "height": 860},
    ),
    Made(
        "inches with letters in brackets",
        "en",
        table({"Dimensions": '23.6"(L) x 15.7"(W) x 29.5"(H)'}),
        (749.3, 599.4, 398.8),
        {"length": 599.4, "width": 398.8, "height": 749.3},
    ),
    Made(
        "unit at the end in brackets",
        "en",
        table({"Dimensions": "60 W x 40 D x 75 H (cm)"}),
        (750, 600, 400),
        {"width": 600, "depth": 400, "height": 750},
    ),
    Made(
        "one unit after three axes",
        "en",
        table({"Dimensions": "Width 60 Depth 40 Height 75 cm"}),
        (750, 600, 400),
        {"width": 600, "depth": 400, "height": 750},
    ),
    Made(
        "slashes in the label",
        "de",
        definitions({"B/H/T": "45 cm / 90 cm / 50 cm"}),
        (900, 500, 450),
        {"width": 450, "height": 900, "depth": 500},
    ),
    Made("weight and dimensions", "en", table({"Weight & dimensions": "12 kg; 60 x 40 x 75 cm"}), (750, 600, 400)),
    Made(
        "cable and shade",
        "en",
        table({"Height": "45 cm", "Diameter": "25 cm", "Cable length": "180 cm", "Shade diameter": "25 cm"}),
        (450, 250, 250),
        {"height": 450, "diameter": 250},
    ),
    Made(
        "drawers and shelves",
        "en",
        table(
            {"Width": "80 cm", "Depth": "40 cm", "Height": "100 cm", "Drawer depth": "33 cm", "Shelf width": "74 cm"}
        ),
        (1000, 800, 400),
        {"width": 800, "depth": 400, "height": 1000},
    ),
    Made(
        "afmetingen",
        "nl",
        definitions({"Breedte": "45 cm", "Diepte": "50 cm", "Hoogte": "90 cm", "Zithoogte": "46 cm"}),
        (900, 500, 450),
        {"width": 450, "depth": 500, "height": 900},
    ),
    Made(
        "medidas",
        "pt",
        definitions({"Largura": "45 cm", "Profundidade": "50 cm", "Altura": "90 cm", "Altura do assento": "46 cm"}),
        (900, 500, 450),
        {"width": 450, "depth": 500, "height": 900},
    ),
    Made(
        "maximum load beside sizes",
        "en",
        table({"Size (WxDxH)": "60 x 40 x 75 cm", "Max. load": "100 kg"}),
        (750, 600, 400),
        {"width": 600, "depth": 400, "height": 750},
    ),
    Made(
        "decimal metres",
        "es",
        table({"Medidas": "1,20 x 0,60 x 0,75 m (largo x ancho x alto)"}),
        (1200, 750, 600),
        {"length": 1200, "width": 600, "height": 750},
    ),
    Made("no size", "en", table({"Colour": "black", "Warranty": "2 years"}), None, flags=("no_size",)),
    Made(
        "mattress for a bed",
        "en",
        table({"Width": "150 cm", "Length": "210 cm", "Height": "95 cm", "Mattress size": "140 x 200 cm"}),
        (2100, 1500, 950),
        {"width": 1500, "length": 2100, "height": 950},
    ),
    Made("per piece", "en", table({"Pieces in the set": "2", "Dimensions (each)": "40 x 40 x 45 cm"}), (450, 400, 400)),
    Made(
        "two sizes of one product",
        "en",
        table({"Large": "50 x 30 x 20 cm", "Small": "40 x 25 x 15 cm"}),
        None,
        flags=("no_size",),
    ),
    Made(
        "table with chairs",
        "en",
        table({"Table": "120 x 80 x 75 cm", "Chair": "45 x 50 x 90 cm"}),
        None,
        flags=("no_size",),
    ),
    Made(
        "open and folded",
        "en",
        table({"Dimensions (open)": "60 x 55 x 80 cm", "Dimensions (folded)": "60 x 8 x 90 cm"}),
        (800, 600, 550),
    ),
    Made(
        "height with and without stand",
        "en",
        table(
            {"Dimensions without stand (WxHxD)": "123 x 71 x 6 cm", "Dimensions with stand (WxHxD)": "123 x 77 x 25 cm"}
        ),
        (1230, 770, 250),
        {"width": 1230, "height": 770, "depth": 250},
    ),
    Made(
        "height from to",
        "en",
        table({"Width": "60 cm", "Depth": "60 cm", "Height": "110 - 120 cm"}),
        (1150, 600, 600),
        {"width": 600, "depth": 600, "height": 1150},
        flags=("range",),
    ),
    Made("circumference", "en", table({"Circumference": "70 cm", "Weight": "430 g"}), None, flags=("no_size",)),
    Made(
        "sizes in a sentence",
        "en",
        "<p>Made of oak, it measures 60 cm wide, 40 cm deep and 75 cm high.</p>",
        (750, 600, 400),
        {"width": 600, "depth": 400, "height": 750},
        flags=("low_trust",),
    ),
    Made(
        "screen diagonal",
        "en",
        table({"Screen size": "27 in", "Width": "61 cm", "Height": "45 cm", "Depth": "20 cm"}),
        (610, 450, 200),
        {"width": 610, "height": 450, "depth": 200},
    ),
    Made(
        "package in inches, product in metric",
        "en",
        table({"Item (LxWxH)": "30 x 20 x 10 cm", "Box (LxWxH)": "14 x 10 x 6 in"}),
        (300, 200, 100),
        {"length": 300, "width": 200, "height": 100},
    ),
]
