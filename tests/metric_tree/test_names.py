from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from metric_tree.names import NameIndex, fold_name, singular_form


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("Swivel_Chair", "swivel chair"),
        ("T-shirts", "t shirts"),
        ("  café  au   lait ", "cafe au lait"),
        ("men's", "mens"),
    ],
)
def test_folded(name: str, expected: str) -> None:
    assert fold_name(name) == expected


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("office chairs", "office chair"),
        ("dishes", "dish"),
        ("batteries", "battery"),
        ("computer mice", "computer mouse"),
        ("glass", "glass"),
        ("bus", "bus"),
        ("buses", "bus"),
        ("boxes", "box"),
        ("people", "person"),
        ("shoes", "sho"),  # wrong English, but both spellings of a name meet in it
        ("gas", "gas"),
    ],
)
def test_singular(name: str, expected: str) -> None:
    assert singular_form(name) == expected


@given(st.text())
def test_folding_is_idempotent(name: str) -> None:
    assert fold_name(fold_name(name)) == fold_name(name)


@given(st.from_regex(r"[a-z]{3,9}", fullmatch=True))
def test_a_name_and_its_plural_meet(name: str) -> None:
    index = NameIndex([("id", [name])])
    assert index.ids(name.upper()) == ("id",)
    if not name.endswith(("s", "x", "z", "h", "y", "o", "f", "e", "i", "u", "corp", "serie", "specie")):
        assert index.ids(f"{name}s") == ("id",)


def test_the_name_as_written_comes_first() -> None:
    index = NameIndex([("eyewear", ["glasses"]), ("tumbler", ["glass"])])
    assert index.ids("Glasses") == ("eyewear",)
    assert index.ids("glass") == ("tumbler",)
    assert index.nearest("glases") == ["glasses", "glass"]
