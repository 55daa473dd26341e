"""The language of a page, and the unit, axis or header of each number."""

from __future__ import annotations

import pytest

from crawler.text.cell_lengths import measures
from crawler.text.sizes import consensus, sizes
from crawler.text.vocabulary import Language, is_stripped, language_of


@pytest.mark.parametrize(
    ("declared", "host", "expected"),
    [
        ("de", "", "de"),
        ("fr-CA", "shop.de", "fr"),
        ("pt_BR", "", "pt"),
        ("EN", "shop.de", "en"),
        ("sv", "shop.it", "it"),
        (None, "www.shop.mx", "es"),
        ("", "shop.co.uk", "en"),
        (None, "shop.se", None),
    ],
)
def test_a_declared_language_comes_before_the_sites(declared: str | None, host: str, expected: str | None) -> None:
    assert language_of(declared, host) == expected


@pytest.mark.parametrize("text", ["10 x 20 x 30 cm", "10 cm x 20 x 30", "10 x 20 cm x 30"])
def test_a_unit_serves_its_neighbours_on_both_sides(text: str) -> None:
    assert [measure.mm for measure in measures(text, "in")] == [100, 200, 300]


def test_of_two_units_the_next_one_serves() -> None:
    assert [measure.mm for measure in measures("1 x 2 in x 30 x 40 mm x 50")] == pytest.approx([25.4, 50.8, 30, 40, 50])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("180 cm in length x 90 cm", [(1800, "length"), (900, None)]),
        ("180 cm (length) x 90 cm (width)", [(1800, "length"), (900, "width")]),
        ("W x H (overall): 1300.5 x 1400.5 mm (LxB)", [(1300.5, "width"), (1400.5, "height")]),
        ("1300.5 x 1400.5 mm (W x H)", [(1300.5, "width"), (1400.5, "height")]),
        ("0 x 30 x 40 cm", [(300, None), (400, None)]),
        ("12 kg, 30 x 40 cm", [(300, None), (400, None)]),
        ("20 m² of cloth 30 x 40 cm", [(300, None), (400, None)]),
    ],
)
def test_each_number_has_its_own_axis_and_what_is_no_length_is_left_out(
    text: str, expected: list[tuple[float, str | None]]
) -> None:
    size = consensus(sizes(text, "", "en"))
    assert [(pytest.approx(length.mm), length.axis) for length in size.lengths] == expected


def test_a_size_without_feet_is_not_the_whole_size() -> None:
    stripped = [is_stripped(label) for label in ("height without feet", "hohe ohne fuss", "height with feet", "height")]
    assert stripped == [True, True, False, False]


@pytest.mark.parametrize(
    ("text", "language", "mm"),
    [
        ("1,234 m", "de", 1234),
        ("1,234 m", "en", 1234000),
        ("1.234 mm", "de", 1234),
        ("1.234 mm", "en", 1.2),
        ("0.234 m", "de", 234),
        ("12.3456 mm", "de", 12.3),
    ],
)
def test_points_and_commas_of_three_digits_by_the_language(text: str, language: Language, mm: float) -> None:
    assert sizes(text, "", language)[0].lengths[0].mm == pytest.approx(mm)
