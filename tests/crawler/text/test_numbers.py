"""Numbers, units and the words of lengths, each against a source that is not the code's own table."""

from __future__ import annotations

import unicodedata
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crawler.text.cell_lengths import AXES, UnreadableLength, dimensions_mm, extents_mm, length_mm, measures
from crawler.text.numbers import number
from crawler.text.sizes import Length, flags_of, is_same_length, sizes
from crawler.text.tokens import axis_of_letter, tokens
from metric_base.length_units import MILLIMETRES, metres, millimetres, unit

VULGAR = "¼½¾⅓⅔⅕⅖⅗⅘⅙⅚⅛⅜⅝⅞"


@pytest.mark.parametrize("mark", VULGAR)
def test_a_fraction_in_one_character_is_what_unicode_says(mark: str) -> None:
    assert number(mark) == pytest.approx(unicodedata.numeric(mark))
    assert number(f"7 {mark}") == pytest.approx(7 + unicodedata.numeric(mark))
    assert measures(f"3{mark} in")[0].mm == pytest.approx(25.4 * (3 + unicodedata.numeric(mark)))


@given(st.integers(0, 99), st.integers(1, 63), st.sampled_from([2, 3, 4, 5, 6, 8, 10, 12, 16, 32, 64]))
def test_a_mixed_number(whole: int, above: int, below: int) -> None:
    assert number(f"{whole} {above}/{below}") == pytest.approx(whole + above / below)
    assert number(f"{above}/{below}") == pytest.approx(above / below)
    assert measures(f"{whole}-{above}/{below} in")[0].mm == pytest.approx(25.4 * (whole + above / below))


@given(st.integers(1, 999), st.integers(0, 999))
def test_a_comma_before_three_digits_parts_thousands(head: int, tail: int) -> None:
    assert number(f"{head},{tail:03d}") == 1000 * head + tail
    assert number(f"0,{tail:03d}") == pytest.approx(tail / 1000)
    assert number(f"{head},{tail:03d}", ",") == pytest.approx(head + tail / 1000)


#: From the SI and the international yard and pound agreement of 1959.
KNOWN_MM = {
    "mm": 1,
    "millimetres": 1,
    "cm": 10,
    "Zentimeter": 10,
    "dm": 100,
    "m": 1000,
    "mètres": 1000,
    "in": 25.4,
    "Inches": 25.4,
    "in.": 25.4,
    "″": 25.4,
    "Zoll": 25.4,
    "ft": 304.8,
    "feet": 304.8,
    "′": 304.8,
    "yards": 914.4,
}


@pytest.mark.parametrize(("word", "factor"), KNOWN_MM.items())
def test_a_unit_has_its_factor(word: str, factor: float) -> None:
    key = unit(word)
    assert key is not None
    assert millimetres(2.5, key) == pytest.approx(2.5 * factor)
    assert length_mm(f"2.5 {word}", "m") == pytest.approx(2.5 * factor)


def test_the_table_of_units_is_the_whole_of_it() -> None:
    assert pytest.approx(dict(MILLIMETRES)) == {
        "um": 0.001,
        "mm": 1,
        "cm": 10,
        "dm": 100,
        "m": 1e3,
        "km": 1e6,
        "in": 25.4,
        "ft": 304.8,
        "yd": 914.4,
        "mi": 1609344,
    }


@given(st.integers(1, 40), st.integers(0, 11))
def test_feet_and_inches_are_one_length(feet: int, inches: int) -> None:
    for text in (f"{feet} ft {inches} in", f"{feet}' {inches}\"", f"{feet} feet, {inches} inches"):
        assert [one.mm for one in measures(text)] == [pytest.approx(25.4 * (12 * feet + inches))]


def test_feet_alone_and_feet_in_a_row() -> None:
    assert [one.mm for one in measures("3 ft x 4 ft")] == [pytest.approx(914.4), pytest.approx(1219.2)]


#: A word of each axis, long and short forms of which one begins the other.
AXIS_WORDS = {
    "length": "length",
    "Len": "length",
    "width": "width",
    "wide": "width",
    "W": "width",
    "height": "height",
    "high": "height",
    "Ht": "height",
    "depth": "depth",
    "deep": "depth",
    "Thickness": "depth",
    "Diam": "diameter",
    "diameter": "diameter",
    "Ø": "diameter",
}


@pytest.mark.parametrize(("word", "axis"), AXIS_WORDS.items())
def test_a_word_names_its_axis_before_and_behind(word: str, axis: str) -> None:
    assert axis in AXES
    assert [(one.axis, one.mm) for one in measures(f"{word}: 12 cm")] == [(axis, 120)]
    assert [(one.axis, one.mm) for one in measures(f"12 cm {word}")] == [(axis, 120)]


def test_a_unit_stands_for_the_lengths_around_it() -> None:
    assert [one.mm for one in measures("3 x 4 cm x 5 x 2 in")] == [30, 40, 127, pytest.approx(50.8)]
    assert [one.mm for one in measures("3 x 4", "cm")] == [30, 40]
    assert measures("3 x 4") == ()


def test_a_range_has_two_ends_and_a_middle() -> None:
    (one,) = measures("10 - 14 cm")
    assert (one.low_mm, one.high_mm, one.mm, one.is_range) == (100, 140, 120, True)
    assert not measures("10 cm")[0].is_range


@pytest.mark.parametrize("text", ["-4 cm", "2 x 3 cm", "large"])
def test_a_cell_that_is_no_single_length_is_refused(text: str) -> None:
    with pytest.raises(UnreadableLength, match="expected one length"):
        length_mm(text, "cm")


@pytest.mark.parametrize("text", ["", "n/a", "-", "0", "0 cm"])
def test_a_cell_without_a_length_is_none(text: str) -> None:
    assert length_mm(text, "cm") is None


@given(st.lists(st.floats(1, 5000), min_size=1, max_size=3))
def test_extents_are_the_sides_longest_first(sides: list[float]) -> None:
    words = dict(zip(("length", "width", "height"), sides, strict=False))
    assert extents_mm(words) == tuple(sorted(sides, reverse=True))


def test_a_diameter_fills_two_sides_and_no_more() -> None:
    assert extents_mm({"diameter": 50.0, "height": 90.0}) == (90, 50, 50)
    assert extents_mm({"diameter": 50.0, "height": 90.0, "width": 60.0}) == (90, 60, 50)
    assert extents_mm({"diameter": 50.0}) == (50, 50)
    assert extents_mm({"height": None, "diameter": None}) is None


def test_words_take_the_outer_size_and_an_order_where_none_is_named() -> None:
    assert dimensions_mm(measures("Height 3 cm, height 5 cm")) == {"height": 50}
    assert dimensions_mm(measures("3 x 5 cm"), ("width", "height")) == {"width": 30, "height": 50}
    assert dimensions_mm(measures("3 x 5 x 6 cm"), ("width", "height")) == {}


@pytest.mark.parametrize(
    ("one", "other", "same"), [(100, 101, True), (100, 110, False), (2000, 2010, True), (20, 30, False)]
)
def test_a_length_stated_twice(one: float, other: float, same: bool) -> None:
    assert is_same_length(one, other) is same
    assert is_same_length(other, one) is same


def _lengths(text: str) -> tuple[Length, ...]:
    return sizes(text)[0].lengths


def test_flags_of_lengths() -> None:
    assert flags_of(_lengths("1 x 1 x 1 cm")) == ("placeholder",)
    assert flags_of(_lengths("10 x 20 x 30 cm")) == ()
    assert "range" in flags_of(_lengths("Height: 10-20 cm"))
    assert "absurd_size" in flags_of(_lengths("Height: 900000 m"))


LANGUAGES = [None, "en", "de", "fr", "nl", "it", "es", "pt"]


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_small_l_is_a_width_in_french_alone(language: Any) -> None:
    assert axis_of_letter("l", language) == ("width" if language == "fr" else "length")
    assert axis_of_letter("L", language) == "length"


@pytest.mark.parametrize("letter", ["A", "C", "P"])
def test_letters_of_romance_languages_mean_nothing_elsewhere(letter: str) -> None:
    assert [axis_of_letter(letter, language) for language in ("en", "de", "nl")] == [None] * 3
    assert axis_of_letter(letter, "es") is not None


def test_words_joined_by_x_are_a_header() -> None:
    (header, *rest) = tokens("ancho x fondo x alto 10 x 20 x 30 cm", "es")
    assert (header.kind, header.axes) == ("header", ("width", "depth", "height"))
    assert "header" not in {token.kind for token in rest}
    assert [token.kind for token in tokens("alto 10 cm", "es")] == ["axis", "number", "unit"]


def test_numbers_belong_together_up_to_three() -> None:
    assert [[length.mm for length in size.lengths] for size in sizes("10 x 20 x 30 cm")] == [[100, 200, 300]]
    assert max(len(size.lengths) for size in sizes("10 x 20 x 30 x 40 cm")) <= 3


def test_an_axis_named_twice_is_not_trusted() -> None:
    (size,) = sizes("10 cm W x 20 cm W x 30 cm H")
    assert [length.axis for length in size.lengths] == [None, None, None]


def test_a_unit_follows_a_number_or_the_letters_of_an_axis() -> None:
    assert [token.kind for token in tokens("63H cm")] == ["number", "axis", "unit"]
    assert "unit" not in {token.kind for token in tokens("made in Italy", "en")}


@pytest.mark.parametrize(
    ("text", "length"),
    [("1.25", 1.25), ("37.9cm", 0.379), ("5ft", 1.524), ("5' 3\"", 1.6002), ("5 ft 3 in", 1.6002), ("80 mm", 0.08),
     ("-2m", -2.0), ("1e2 cm", 1.0), ("2 Zoll", 0.0508)],
)  # fmt: skip
def test_a_stated_length_is_in_metres_unless_it_has_a_unit(text: str, length: float) -> None:
    assert metres(text) == pytest.approx(length, rel=1e-12)


@pytest.mark.parametrize("text", ["", "cm", "5 furlongs", "5ft 3", "1,5m", "5 5ft", "1m of"])
def test_other_texts_are_no_length(text: str) -> None:
    with pytest.raises(ValueError, match=r"no length"):
        metres(text)
