"""Known lengths from the command line and from a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estimator.evidence.known_lengths import KnownLength, ObjectLength, parse_known_lengths
from metric_base.errors import InputError

# Published values, written out so that a changed rule fails a test.
DEFAULT_SIGMA = 0.01


def test_two_points_and_metres() -> None:
    (length,) = parse_known_lengths(["1,2,3", "(1, 2, -1)", "0.5"])
    assert length.distance == 4
    assert length.metres == 0.5
    assert length.sigma == DEFAULT_SIGMA
    np.testing.assert_allclose(np.exp(length.log_scale), 0.125)


def test_lengths_have_units(tmp_path: Path) -> None:
    (length,) = parse_known_lengths(["1,2,3", "1,2,-1", "37.9", "cm"])
    assert isinstance(length, KnownLength)
    assert length.metres == pytest.approx(0.379)
    assert parse_known_lengths(["chair 1", "height", "100cm"]) == (ObjectLength("chair 1", "height", 1.0),)
    (tmp_path / "lengths.txt").write_text("0 0 0 0 0 2 100cm 5mm\n")
    (length,) = parse_known_lengths([str(tmp_path / "lengths.txt")])
    assert isinstance(length, KnownLength)
    assert (length.metres, length.sigma) == (1.0, pytest.approx(0.005))
    with pytest.raises(InputError, match=r"metres: expected a length such as .*, found '3furlongs'"):
        parse_known_lengths(["chair 1", "height", "3furlongs"])


def test_a_file_of_lengths(tmp_path: Path) -> None:
    file = tmp_path / "lengths.txt"
    file.write_text("# door\n0 0 0 0 0 2 1.0\n\n0,0,0, 3,0,0, 1.5, 0.03  # table\n", encoding="utf-8")
    door, table = parse_known_lengths([str(file)])
    assert (door.metres, door.distance, door.sigma) == (1.0, 2.0, DEFAULT_SIGMA)
    assert (table.metres, table.distance) == (1.5, 3.0)
    assert table.sigma == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["1,2,3", "4,5,6"], "A B metres, or a file"),
        (["1,2", "4,5,6", "1"], "point"),
        (["1,2,x", "4,5,6", "1"], "numbers"),
        (["1,2,nan", "4,5,6", "1"], "finite"),
        (["1,2,3", "1,2,3", "1"], "two points apart"),
        (["1,2,3", "4,5,6", "-1"], "metres"),
        (["1,2,3", "4,5,6", "inf"], "metres"),
        (["/nowhere/at/all"], "readable file"),
    ],
)
def test_errors_are_one_line(words: list[str], named: str) -> None:
    with pytest.raises(InputError, match=named) as error:
        parse_known_lengths(words)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "text", ["", "# nothing\n", "1 2 3\n", "0 0 0 0 0 2 1.0 -0.1\n", "0 0 0 0 0 2 1.0 5\n", "\xff"]
)
def test_errors_of_a_file_name_it(text: str, tmp_path: Path) -> None:
    file = tmp_path / "lengths.txt"
    file.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=r"lengths\.txt"):
        parse_known_lengths([str(file)])


@pytest.mark.parametrize(
    ("metres", "is_valid"), [("1.01e-10", True), ("0.99e-10", False), ("0.99e9", True), ("1.01e9", False)]
)
def test_a_length_is_an_atom_to_the_orbit_of_the_moon(metres: str, is_valid: bool) -> None:
    if is_valid:
        assert parse_known_lengths(["1,2,3", "4,5,6", metres])[0].metres == float(metres)
    else:
        with pytest.raises(InputError, match="metres: expected 1e-10 to 1e\\+09"):
            parse_known_lengths(["1,2,3", "4,5,6", metres])
