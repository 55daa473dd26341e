from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crawler.text.sizes import PLAUSIBLE_MM, consensus, sizes
from crawler.text.vocabulary import Language
from metric_base.length_units import MILLIMETRES

#: text, label, language, expected mm by axis (or in order where the text names no axis)
CASES = [
    ("9 x 3 x 14.5 inches; 11 Ounces", "Product Dimensions", "en", [228.6, 76.2, 368.3]),
    ("4.5 x 3.2 x 1.2 inches", "Item Dimensions LxWxH", "en", {"length": 114.3, "width": 81.3, "height": 30.5}),
    ("76L x 80B x 63H Zentimeter", "Artikelabmessungen L x B x H", "de", {"length": 760, "width": 800, "height": 630}),
    ("41'' H X 27'' W X 28'' D", "Overall", "en", {"height": 1041.4, "width": 685.8, "depth": 711.2}),
    ('Overall: 11" wide x 15.5" deep x 30" high', "", "en", {"width": 279.4, "depth": 393.7, "height": 762}),
    ("Diameter: 97mm, Height: 42 mm", "Dimensions", "en", {"diameter": 97, "height": 42}),
    ("48,6 x 29,2 x 40,5 cm", "Dimensões (LxAxP)", "pt", {"width": 486, "height": 292, "depth": 405}),
    ('5.5 x 4.4 x 3.1" / 140 x 113 x 78 mm', "Size (W x H x D)", "en", {"width": 140, "height": 113, "depth": 78}),
    ('3.4"W x 6.6"H (8.6W x 16.8H CM)', "dimensions", "en", {"width": 86, "height": 168}),
    ("210mm*115mm*85mm", "Product size", "en", [210, 115, 85]),
    ('30 1/8 "', "Width", "en", {"width": 765.2}),
    ("12½ in", "Height", "en", {"height": 317.5}),
    ("H45 x W60 x D30cm", "", "en", {"height": 450, "width": 600, "depth": 300}),
    ("ø 30 cm, H 45 cm", "", "en", {"diameter": 300, "height": 450}),
    ("5'11\"", "Height", "en", {"height": 1803.4}),
    ("6 ft 2 in x 30 in", "", "en", [1879.6, 762]),
    ("1.200 x 600 x 450 mm", "Maße (BxHxT)", "de", {"width": 1200, "height": 600, "depth": 450}),
    ("1,5 m x 80 cm", "Abmessungen", "de", [1500, 800]),
    ("30 x 40 x 50 cm (W x H x D)", "", "en", {"width": 300, "height": 400, "depth": 500}),
    ("L 120 x l 60 x H 75 cm", "", "fr", {"length": 1200, "width": 600, "height": 750}),
    ("Ancho 80 cm, Alto 120 cm, Fondo 40 cm", "", "es", {"width": 800, "height": 1200, "depth": 400}),
    ("80 x 40 x 120 cm (ancho x fondo x alto)", "", "es", {"width": 800, "depth": 400, "height": 1200}),
    ("Larghezza 60 cm Altezza 85 cm Profondità 45 cm", "", "it", {"width": 600, "height": 850, "depth": 450}),
    ("Breite: 45 cm | Höhe: 90,5 cm | Tiefe: 50 cm", "", "de", {"width": 450, "height": 905, "depth": 500}),
    ("B60 x D40 x H80 cm", "Afmetingen", "nl", {"width": 600, "depth": 400, "height": 800}),
    ("180cm(L) x 90cm(W) x 75cm(H)", "", "en", {"length": 1800, "width": 900, "height": 750}),
    ("12 inch tall by 8 inch wide", "", "en", {"height": 304.8, "width": 203.2}),
    ("30", "Width (in.)", "en", {"width": 762}),
    ("Largeur 40 cm x Profondeur 35 cm x Hauteur 1,10 m", "", "fr", {"width": 400, "depth": 350, "height": 1100}),
]  # fmt: skip


@pytest.mark.parametrize(("text", "label", "language", "expected"), CASES, ids=[case[0] for case in CASES])
def test_sizes_as_pages_write_them(text: str, label: str, language: Language, expected: object) -> None:
    size = consensus([found for found in sizes(text, label, language) if found.meaning == "whole"])
    assert "contradicts_itself" not in size.flags
    if isinstance(expected, dict):
        assert size.dimensions_mm() == pytest.approx(expected, abs=0.06)
    else:
        assert [length.mm for length in size.lengths] == pytest.approx(expected, abs=0.06)
        assert size.dimensions_mm() == {}


@pytest.mark.parametrize(
    ("text", "language", "expected"),
    [
        ("60 × 40 × 75 (B × T × H) cm", "de", [{"width": 600, "depth": 400, "height": 750}]),
        ("H.75 x L.90 x P.40 cm", "fr", [{"height": 750, "width": 900, "depth": 400}]),
        ("W: 60cm, D: 40cm, H: 75cm, SH: 45cm", "en", [{"width": 600, "depth": 400, "height": 750}]),
        ("Large: 50 x 30 x 20 cm", "en", [{}]),
        ("Overall: 30 in. (76 cm) W x 15.5 in. (39 cm) D", "en", [{"width": 760, "depth": 390}]),
        ("Height: 20 in. (51 cm)", "en", [{"height": 510}]),
    ],
)
def test_asides_abbreviations_and_units_behind_an_order(text: str, language: Language, expected: list[object]) -> None:
    """The last two: where a length comes again in brackets in metric, the metric one counts, not the rounded inch."""
    assert [one.dimensions_mm() for one in sizes(text, "", language) if one.meaning == "whole"] == expected


@pytest.mark.parametrize(
    "text", ["180 (L) x 90 (W) x 75 (H) cm", "180(L) x 90(W) x 75(H) cm", "180 (length) x 90 (width) x 75 (height) cm"]
)
def test_axes_in_brackets_before_one_unit(text: str) -> None:
    (size,) = sizes(text)
    assert size.dimensions_mm() == {"length": 1800, "width": 900, "height": 750}


@pytest.mark.parametrize(
    "text",
    [
        "Table (L x W x H): 180 x 90 x 75 cm, bench (W x D x H): 45 x 50 x 90 cm",
        "180 x 90 x 75 cm (LxWxH), 45 x 50 x 90 cm (WxDxH)",
    ],
)
def test_each_of_two_sizes_has_its_own_order_of_axes(text: str) -> None:
    table, bench = sizes(text)
    assert table.dimensions_mm() == {"length": 1800, "width": 900, "height": 750}
    assert bench.dimensions_mm() == {"width": 450, "depth": 500, "height": 900}


@pytest.mark.parametrize(
    ("text", "label"),
    [
        ("14.2 pounds", "Item Weight"),
        ("100 x 50", ""),
        ("1920 x 1080 pixels", "Resolution"),
        ("2.5 kg", ""),
        ("", "Size"),
        ("20 oz", "Size"),
    ],
)
def test_what_is_no_length_is_no_size(text: str, label: str) -> None:
    assert sizes(text, label, "en") == ()


@pytest.mark.parametrize(
    ("text", "label", "meaning"),
    [
        ("10.3 x 6.7 x 5.5 inches", "Package Dimensions", "package"),
        ('12.3 x 9.3 x 6.1"', "Box Dimensions (LxWxH)", "package"),
        ("40 x 30 x 20 cm", "Verpackungsabmessungen", "package"),
        ("20'' H", "Seat Height", "component"),
        ("150 cm", "Kabellänge", "component"),
        ('10" diameter x 5.5" high', "Shade only", "component"),
    ],
)
def test_packages_and_parts_are_kept_apart(text: str, label: str, meaning: str) -> None:
    found = sizes(text, label)
    assert [size.meaning for size in found] == [meaning]


def test_parts_in_the_text_of_the_whole() -> None:
    found = sizes("Overall: 100 x 50 x 90 cm. Seat height: 45 cm; Back plate: 12 x 12 cm", "Dimensions", "en")
    assert [size.meaning for size in found] == ["whole", "component", "component"]


def test_systems_that_contradict_each_other_are_flagged() -> None:
    size = consensus(sizes("10 x 20 x 30 in (10 x 20 x 30 cm)", "Dimensions", "en"))
    assert size.flags == ("contradicts_itself",)


def test_a_range_keeps_its_ends_and_a_flag() -> None:
    (size,) = sizes("50-75 cm", "Height", "en")
    assert (size.lengths[0].low_mm, size.lengths[0].high_mm, size.flags) == (500, 750, ("range",))


def test_a_diameter_counts_twice() -> None:
    (size,) = sizes("Diameter 30 cm, Height 45 cm", "", "en")
    assert size.extents_mm() == (450, 300, 300)


_lengths = st.lists(st.floats(0.5, 3000).map(lambda value: round(value, 2)), min_size=1, max_size=3)
_units = st.sampled_from(["mm", "cm", "m", "in"])
_spelled = {
    "mm": ["mm", " mm", " millimetres"],
    "cm": ["cm", " cm", " Zentimeter", " centimètres"],
    "m": [" m", "m"],
    "in": ['"', " in", " inches", "″", "''", " Zoll"],
}


@given(_lengths, _units, st.data())
def test_what_is_written_is_read_back(values: list[float], unit: str, data: st.DataObject) -> None:
    spelled = data.draw(st.sampled_from(_spelled[unit]))
    glued = ["x"] if len(spelled.strip()) <= 2 else []  # nobody writes `3 inchesx4 inches`
    joint = data.draw(st.sampled_from([" x ", " × ", " X ", "*", *glued]))
    every = data.draw(st.booleans())
    text = joint.join(f"{value:g}{spelled if every or i == len(values) - 1 else ''}" for i, value in enumerate(values))
    (size,) = sizes(text, "Dimensions")
    expected = [float(f"{value:g}") * MILLIMETRES[unit] for value in values]
    assert [length.mm for length in size.lengths] == pytest.approx(expected, abs=0.06)
    low, high = PLAUSIBLE_MM
    assert ("absurd_size" in size.flags) == any(not low <= round(mm, 1) <= high for mm in expected)


@given(st.lists(st.floats(1, 500).map(lambda value: round(value, 1)), min_size=3, max_size=3), st.permutations("WDH"))
def test_axes_before_behind_and_ahead_read_the_same(values: list[float], order: list[str]) -> None:
    named = dict(zip(order, values, strict=True))
    before = " x ".join(f"{axis}{value:g}" for axis, value in named.items()) + " cm"
    behind = " x ".join(f"{value:g} cm {axis}" for axis, value in named.items())
    ahead = " x ".join(f"{value:g}" for value in values) + " cm"
    read = [sizes(before), sizes(behind), sizes(ahead, f"Size ({' x '.join(order)})")]
    expected = {axis: named[letter] * 10 for axis, letter in (("width", "W"), ("depth", "D"), ("height", "H"))}
    for found in read:
        assert len(found) == 1
        assert found[0].dimensions_mm() == pytest.approx(expected, abs=0.06)


_pieces = [*"0123456789.,/x×X*-–'\"″½ ()[]:;|LWHDBTPAø\u00a0\n", "cm", "mm", "in", "ft", "kg", "Höhe", "seat"]


@settings(max_examples=400)
@given(st.lists(st.sampled_from(_pieces), max_size=60).map("".join), st.text(max_size=20))
def test_nothing_crashes_it_and_nothing_absurd_goes_unflagged(text: str, label: str) -> None:
    low, high = PLAUSIBLE_MM
    for size in sizes(text, label):
        for length in size.lengths:
            assert math.isfinite(length.mm)
            assert length.low_mm <= length.high_mm
            assert low <= length.mm <= high or "absurd_size" in size.flags


@pytest.mark.parametrize(
    ("texts", "named", "flags"),
    [
        (["10 x 20 cm", "H 10 cm x W 20 cm"], {"height": 100, "width": 200}, ()),
        (["10 x 20 cm", "H 10.5 cm x W 20.5 cm"], {"height": 105, "width": 205}, ()),
        (["4 x 8 in", "10 x 20 cm"], {}, ()),
        (["10 x 20 cm", "H 15 cm x W 20 cm"], {"height": 150, "width": 200}, ("contradicts_itself",)),
        (["10 x 20 x 30 cm", "H 10 cm x W 20 cm"], {}, ()),
        (["10 x 20 x 30 cm", "H 10 cm x W 40 cm"], {}, ("contradicts_itself",)),
        (["H 10 cm x W 20 cm", "W 10 cm x H 20 cm"], {"height": 100, "width": 200}, ("contradicts_itself",)),
        (["H 10 cm x W 20 cm", "20 x 10 cm"], {"height": 100, "width": 200}, ()),
    ],
)
def test_of_several_statements_the_most_complete_is_used(
    texts: list[str], named: dict[str, float], flags: tuple[str, ...]
) -> None:
    for ordered in (texts, texts[::-1]) if named.keys() == {"height", "width"} and not flags else (texts,):
        size = consensus([sizes(text)[0] for text in ordered])
        assert (size.dimensions_mm(), size.flags) == (named, flags)


@pytest.mark.parametrize(
    ("text", "mm"),
    [
        ("15.5 in. (39 cm)", [390]),
        ("15.5 in. (60 cm)", [393.7, 600]),
        ("39 cm (15.5 in)", [390]),
        ("39 cm (41 cm)", [390, 410]),
    ],
)
def test_a_length_in_brackets_is_the_same_length_if_it_is_equal_in_another_unit(text: str, mm: list[float]) -> None:
    assert [length.mm for size in sizes(text, "Height") for length in size.lengths] == mm
