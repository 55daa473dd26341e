"""Folding, singulars and the noun phrase of a title."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taxonomy.words.phrases import endings, noun_phrase, pairs
from taxonomy.words.spelling import fold_text, singulars

TITLES = st.text(alphabet=st.characters(codec="utf-8"), max_size=80)
WORDS = st.text(alphabet="abcdefghijklmnopqrstuvwxyz", min_size=1, max_size=14)


@given(TITLES)
def test_folding_is_idempotent(text: str) -> None:
    assert fold_text(fold_text(text)) == fold_text(text)


@given(TITLES)
def test_folded_text_has_no_case_and_single_spaces(text: str) -> None:
    found = fold_text(text)
    assert found == found.lower().strip()
    assert "  " not in found
    assert all(c.isascii() and (c.isalnum() or c == " ") for c in found)


@given(st.lists(WORDS, min_size=1, max_size=5), st.sampled_from(["-", "_", " ", "  ", " - ", "/"]))
def test_separators_and_case_do_not_matter(words: list[str], separator: str) -> None:
    assert fold_text(separator.join(words)) == fold_text(" ".join(words)) == fold_text(separator.join(words).upper())


@given(WORDS.filter(lambda word: len(word) > 2 and not word.endswith("s")))
def test_an_english_plural_has_its_singular_among_the_candidates(word: str) -> None:
    assert word in set(singulars(_plural(word)))


@given(WORDS)
def test_a_word_is_never_its_own_singular(word: str) -> None:
    assert word not in set(singulars(word))


@given(TITLES)
def test_a_noun_phrase_is_found_for_whatever_is_said(text: str) -> None:
    phrase = noun_phrase(text)
    assert len(phrase) <= len(text)
    assert phrase == phrase.strip()


@given(st.lists(WORDS, min_size=1, max_size=6))
def test_endings_grow_shorter_and_keep_the_head(words: list[str]) -> None:
    runs = list(endings(words))
    assert [len(ending.split()) for ending in runs] == list(range(len(words), 0, -1))
    assert all(ending.split()[-1] == words[-1] for ending in runs)


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ("TVStand", "tv stand"),
        ("ArmChair", "arm chair"),
        ("coat_rack", "coat rack"),
        ("Drop-leaf table", "drop leaf table"),
        ("Crèches", "creches"),
        ("Hjørnesofa", "hjornesofa"),
        ("GRÖNLID", "gronlid"),
        ("Children's chair", "childrens chair"),
        ("grey tyres & armour", "gray tires and armor"),
        ("", ""),
    ],
)
def test_folding_by_example(written: str, expected: str) -> None:
    assert fold_text(written) == expected


@pytest.mark.parametrize(
    ("title", "expected"),
    [
        ("Plate with floral decoration", "Plate"),
        ('Chair, "Womb"', "Chair"),
        ("Box (with view of Dresden)", "Box"),
        ("One of a Pair of Columns from a Shrine", "Columns"),
        ("Set of six teaspoons", "teaspoons"),
        ("Bar stool with backrest frame,          74 cm", "Bar stool"),
        ("12 oz mug", "mug"),
        ("2-seat sofa", "2-seat sofa"),
        ("A Teapot", "Teapot"),
        ("chest of drawers", "chest of drawers"),
        ("with", "with"),
    ],
)
def test_noun_phrases_by_example(title: str, expected: str) -> None:
    assert noun_phrase(title) == expected


@pytest.mark.parametrize(
    ("plural", "singular"),
    [
        ("boxes", "box"), ("knives", "knife"), ("leaves", "leaf"), ("amphorae", "amphora"), ("lekythoi", "lekythos"),
        ("benches", "bench"), ("cities", "city"), ("plateaux", "plateau"), ("men", "man"), ("ciboria", "ciborium"),
        ("kylikes", "kylix"), ("bases", "basis"), ("rhyta", "rhytum"),
    ],
)  # fmt: skip
def test_singulars_by_example(plural: str, singular: str) -> None:
    assert singular in set(singulars(plural))


def test_spellings_are_american() -> None:
    assert fold_text("colour") == "color"
    assert fold_text("tyres") == "tires"
    assert fold_text("chair") == "chair"


def _plural(word: str) -> str:
    if word.endswith(("s", "x", "z", "ch", "sh")):
        return word + "es"
    if word.endswith("y") and len(word) > 2 and word[-2] not in "aeiou":
        return word[:-1] + "ies"
    return word + "s"


def test_what_describes_a_part_is_no_modifier_of_the_object():
    assert "high chair" not in set(pairs(["high", "back", "leather", "chair"]))
    assert "swivel chair" in set(pairs(["swivel", "leather", "chair"]))
