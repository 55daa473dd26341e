from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crawler.text.cell_lengths import AXES, UnreadableLength, dimensions_mm, extents_mm, length_mm, measures
from crawler.text.numbers import number
from metric_base.length_units import MILLIMETRES, UNIT_WORDS, unit

LENGTHS = st.integers(min_value=1, max_value=999_999).map(lambda n: n / 100)
UNITS = st.sampled_from(["mm", "cm", "m", "in", "ft"])


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("12 1/4", 12.25),
        ("12-1/4", 12.25),
        ("3/8", 0.375),
        ("12½", 12.5),
        ("7 ⅞", 7.875),
        ("1,234.5", 1234.5),
        ("1.234,5", 1234.5),
        ("1,234", 1234.0),
        ("33,5", 33.5),
        ("0,125", 0.125),
        (".75", 0.75),
        ("1 234", 1234.0),
        ("1 000 000,25", 1_000_000.25),
    ],
)
def test_a_number_is_read_as_people_write_it(text: str, value: float) -> None:
    assert number(text) == pytest.approx(value)


@pytest.mark.parametrize("text", ["", "-", "x", "12 x 3", "1/0", "5 cm", "1.2.3.4,5,6"])
def test_what_is_no_number_is_none(text: str) -> None:
    assert number(text) is None


def test_the_declared_mark_decides() -> None:
    assert number("1,234", ",") == pytest.approx(1.234)
    assert number("1,234", ".") == pytest.approx(1234)
    assert number("1.234", ",") == pytest.approx(1234)


@given(st.integers(0, 10**9), st.integers(0, 99))
def test_a_number_survives_its_decimal_mark(whole: int, hundredths: int) -> None:
    value = whole + hundredths / 100
    assert number(f"{whole}.{hundredths:02}") == pytest.approx(value)
    assert number(f"{whole},{hundredths:02}", ",") == pytest.approx(value)
    assert number(f"{whole:,}.{hundredths:02}", ".") == pytest.approx(value)


@given(st.text(max_size=30))
def test_no_text_breaks_the_reader(text: str) -> None:
    value = number(text)
    assert value is None or value >= 0
    assert all(measure.mm >= 0 and measure.low_mm <= measure.high_mm for measure in measures(text, "mm"))


def test_every_unit_word_leads_to_the_one_table() -> None:
    assert set(UNIT_WORDS.values()) <= set(MILLIMETRES)
    assert unit("Inches") == unit("in.") == unit("″") == "in"
    assert unit("furlong") is None


@given(LENGTHS, LENGTHS, LENGTHS, UNITS, st.sampled_from([" x ", "x", " × ", " by ", " * "]))
def test_three_sides_are_read_in_order(a: float, b: float, c: float, key: str, sign: str) -> None:
    found = measures(f"{a:.2f}{sign}{b:.2f}{sign}{c:.2f} {key}")
    expected = [side * MILLIMETRES[key] for side in (a, b, c)]
    assert [measure.mm for measure in found] == pytest.approx(expected)


@given(LENGTHS, LENGTHS, UNITS, UNITS)
def test_each_side_may_have_its_own_unit(a: float, b: float, first: str, second: str) -> None:
    found = measures(f"{a:.2f}{first} / {b:.2f}{second}")
    if first == "ft" and second == "in":
        return  # feet and inches: tested below
    assert [m.mm for m in found] == pytest.approx([a * MILLIMETRES[first], b * MILLIMETRES[second]])


@given(
    st.integers(1, 30),
    st.integers(0, 11),
    st.sampled_from(["{} ft {} in", "{}' {}\"", "{}′{}″", "{} feet, {} inches", "{}'-{}\""]),
)
def test_feet_and_inches_are_one_length(feet: int, inches: int, form: str) -> None:
    found = measures(form.format(feet, inches))
    assert [measure.mm for measure in found] == pytest.approx([(12 * feet + inches) * 25.4])


def test_feet_beside_feet_stay_two_lengths() -> None:
    assert [m.mm for m in measures("5' x 7'")] == pytest.approx([1524.0, 2133.6])
    assert [m.mm for m in measures("5'x7\"")] == pytest.approx([1524.0, 177.8])


def test_the_size_in_brackets_is_the_same_size_again() -> None:
    assert [m.mm for m in measures("12 1/4 x 3 in (31 x 8 cm)")] == pytest.approx([311.15, 76.2])


@pytest.mark.parametrize(
    "text", ["H: 9 x W: 4 x D: 3 cm", "9cm H x 4cm W x 3cm D", "height 9 cm, width 4 cm, depth 3 cm"]
)
def test_axis_words_stand_before_or_behind(text: str) -> None:
    assert dimensions_mm(measures(text)) == pytest.approx({"height": 90, "width": 40, "depth": 30})


def test_weights_and_volumes_are_no_lengths() -> None:
    assert [m.mm for m in measures("94 x 50 x 20.8 mm, 88 cc")] == pytest.approx([94, 50, 20.8])
    assert [m.mm for m in measures("9.25 x 3 x 14.85 inches; 10.56 Ounces")] == pytest.approx([234.95, 76.2, 377.19])
    assert measures("3.2 kg") == ()


def test_a_range_has_two_ends() -> None:
    (measure,) = measures("10-12 cm")
    assert (measure.low_mm, measure.high_mm, measure.mm, measure.is_range) == (100, 120, 110, True)


def test_bare_figures_take_the_declared_order() -> None:
    found = measures("100 x 50 x 10 mm")
    assert dimensions_mm(found, ("height", "width", "depth")) == {"height": 100, "width": 50, "depth": 10}
    assert dimensions_mm(found) == {}
    assert dimensions_mm(found, ("height",)) == {}


def test_of_a_word_stated_twice_the_outer_size_counts() -> None:
    assert dimensions_mm(measures("Diam 8 x Diam 11 x H 5 cm")) == {"diameter": 110, "height": 50}


@pytest.mark.parametrize(
    ("text", "unit_key", "mm"),
    [
        ("1652 mm", "cm", 1652),
        ("33,5", "cm", 335),
        ("101 cm", "mm", 1010),
        ("21 7/12", "ft", 6578.6),
        ("0", "mm", None),
        ("-", "mm", None),
        ("NA", "m", None),
    ],
)
def test_a_cell_is_one_length(text: str, unit_key: str, mm: float | None) -> None:
    assert length_mm(text, unit_key) == (None if mm is None else pytest.approx(mm, abs=0.1))


@pytest.mark.parametrize("text", ["-4 mm", "12 x 3 mm", "about", "XX.X"])
def test_a_cell_that_is_no_length_says_so(text: str) -> None:
    with pytest.raises(UnreadableLength, match="expected one length; found"):
        length_mm(text, "mm")


@given(st.dictionaries(st.sampled_from(AXES), st.floats(0.1, 1e5), max_size=5))
def test_extents_are_the_stated_sides_longest_first(words: dict[str, float]) -> None:
    extents = extents_mm(words)
    if not words:
        assert extents is None
        return
    assert extents is not None
    assert list(extents) == sorted(extents, reverse=True)
    assert 1 <= len(extents) <= 3
    assert set(extents) <= set(words.values())


def test_a_diameter_counts_twice() -> None:
    assert extents_mm({"diameter": 80, "height": 95}) == (95, 80, 80)
    assert extents_mm({"diameter": 23}) == (23, 23)
    assert extents_mm({"width": 90, "height": 95, "diameter": 80}) == (95, 90, 80)


def test_a_number_that_has_two_decimal_marks_is_no_length() -> None:
    assert [one.mm for one in measures("1,234,567 mm, 3 mm", decimal=",")] == [3]
    assert [one.mm for one in measures("1,234,567 mm, 3 mm")] == [1234567, 3]
