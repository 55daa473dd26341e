"""The evidence of the nodes of a name, and both sides of the thresholds of the resolver."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest

from taxonomy.naming import resolver
from taxonomy.naming.names import Candidate, NameMatch, Names
from taxonomy.naming.resolver import Resolver, is_slip
from taxonomy.words.senses import Sense, reviewed_meanings

Row = tuple[str, str, Sequence[str] | None, int, str | None]


def names_of(*rows: Row, labels: dict[str, float] | None = None) -> Names:
    ids, names, aliases, items, parents = zip(*rows, strict=True)
    return Names(ids, names, aliases, items, parents, lambda _: (), lambda _: labels or {})


def test_the_evidence_of_a_name_an_alias_a_label_items_and_food() -> None:
    """0.42 per power of ten of the items, at most three; 5 of labels at most; 0.01 for each candidate."""
    rows: list[Row] = [
        ("food.n.01", "food", None, 0, None),
        ("mt:a", "zorb", None, 99, None),
        ("mt:b", "b", ["zorb"], 999_999, None),
        ("mt:c", "zorb", None, 9, "food.n.01"),
        ("mt:d", "d", None, 0, None),
    ]
    scores = {one.node_id: one.score for one in names_of(*rows, labels={"mt:b": 6.0, "mt:d": 4.0}).candidates("zorb")}
    assert scores == pytest.approx(
        {
            "mt:a": 2.0 + 0.42 * 2 + 0.01,
            "mt:b": 5.0 + 0.42 * 3 + 1.0 + 0.01,
            "mt:c": 2.0 + 0.42 + 0.8 + 0.01,
            "mt:d": 4.0 + 0.01,
        }
    )


def test_a_clear_reviewed_meaning_exceeds_the_others_by_two() -> None:
    order = reviewed_meanings("balloon")
    assert order is not None
    assert order.clear
    rows: list[Row] = [(node, "balloon", None, 9, None) for node in order.nodes]
    first, second, *_ = names_of(*rows).candidates("balloon")
    assert first.score - second.score == pytest.approx(2.0)


@pytest.mark.parametrize(("margin", "is_ambiguous"), [(1.04, True), (1.06, False)])
def test_a_meaning_is_clear_by_a_margin_of_105(margin: float, is_ambiguous: bool) -> None:
    assert NameMatch((Candidate("a", 1.0, "alias"),), "alias", margin).ambiguous == is_ambiguous


def test_words_in_brackets_outweigh_all_other_evidence_by_ten() -> None:
    rows: list[Row] = [
        ("weapon.n.01", "weapon", None, 0, None),
        ("mt:a", "zorb", None, 9, "weapon.n.01"),
        ("mt:b", "zorb", None, 9, None),
    ]
    match = Resolver(names_of(*rows)).match("zorb (weapon)")
    assert match is not None
    assert (match.node_id, match.margin) == ("mt:a", pytest.approx(10.0))


def chain(level: int, node: str) -> Names:
    """A node at a level of a chain, with a child."""
    rows: list[Row] = [(f"mt:{k}", f"step{k}", None, 0, f"mt:{k - 1}" if k else None) for k in range(level - 1)]
    above = rows[-1][0] if rows else None
    return names_of(*rows, (node, node.partition(".")[0], None, 9, above), ("mt:child", "child", None, 9, node))


@pytest.mark.parametrize(
    ("text", "level", "is_found"),
    [("macaw", 4, True), ("macaw", 3, False), ("sea bird", 3, True), ("sea bird", 2, False)],
)
def test_a_hypernym_is_used_from_level_four_and_by_its_name_from_level_three(
    text: str, level: int, is_found: bool
) -> None:
    match = Resolver(chain(level, "bird.n.01")).match(text)
    assert (match is not None and match.node_id == "bird.n.01") == is_found


@pytest.mark.parametrize(("level", "suggested"), [(3, ["bird"]), (2, [])])
def test_a_hypernym_is_suggested_from_level_three(level: int, suggested: list[str]) -> None:
    assert Resolver(chain(level, "bird.n.01")).nearest("macaw") == suggested


@pytest.mark.parametrize(
    ("trust", "text", "is_found"),
    [
        ((4, 4), "wibbly zorb", True),  # MIN_HEAD_COMPOUNDS
        ((3, 3), "wibbly zorb", False),
        ((66, 100), "wibbly zorb", True),  # MIN_HEAD_FRACTION of 0.65
        ((64, 100), "wibbly zorb", False),
        ((4, 4), "wibbly wobbly wabbly zorb", True),  # MAX_COMPOUND_WORDS
        ((4, 4), "wibbly wobbly wabbly webbly zorb", False),
    ],
)
def test_a_head_noun_stands_for_a_compound_by_the_known_compounds(
    monkeypatch: pytest.MonkeyPatch, trust: tuple[int, int], text: str, is_found: bool
) -> None:
    monkeypatch.setattr(resolver, "head_trust", lambda _: {"mt:a": trust})
    match = Resolver(names_of(("mt:a", "zorb", None, 9, None))).match(text)
    assert (match is not None and match.how == "broader kind") == is_found


@pytest.mark.parametrize(("word", "other", "is_same"), [("abcd", "abce", True), ("abc", "abd", False)])
def test_words_of_four_letters_may_differ_in_a_suggestion(word: str, other: str, is_same: bool) -> None:
    assert is_slip(word, other) == is_same


@pytest.mark.parametrize(("uses", "is_ambiguous"), [(24, False), (26, True)])
def test_another_sense_of_a_head_noun_competes_from_a_quarter_of_its_uses(
    monkeypatch: pytest.MonkeyPatch, uses: int, is_ambiguous: bool
) -> None:
    known = [Sense(("mt:a",), 100 - uses), Sense(("mt:b",), uses)]
    monkeypatch.setattr(resolver, "head_trust", lambda _: {"mt:a": (4, 4)})
    monkeypatch.setattr(resolver, "senses", lambda word: known if word == "zorb" else [])
    match = Resolver(names_of(("mt:a", "zorb", None, 9, None), ("mt:b", "zerb", None, 9, None))).match("wibbly zorb")
    assert match is not None
    assert match.ambiguous == is_ambiguous


@pytest.mark.parametrize(("text", "how", "score"), [("bird.n.01", "id", math.inf), ("macaw", "broader kind", 0.0)])
def test_an_id_is_certain_and_a_hypernym_is_the_only_candidate(text: str, how: str, score: float) -> None:
    match = Resolver(chain(4, "bird.n.01")).match(text)
    assert match is not None
    assert (match.node_id, match.how, match.candidates[0].score, match.margin) == ("bird.n.01", how, score, math.inf)


@pytest.mark.parametrize(
    ("name", "text", "is_found"), [("zorbs", "zorbt", True), ("zorb", "zorc", False), ("zorbt", "zort", False)]
)
def test_a_word_of_five_letters_may_have_one_wrong_letter(name: str, text: str, is_found: bool) -> None:
    match = Resolver(names_of(("mt:a", name, None, 9, None))).match(text)
    assert (match is not None and match.how == "misspelt") == is_found


@pytest.mark.parametrize(("name", "text", "is_found"), [("zo rbt", "zorbt", True), ("zo rb", "zorb", False)])
def test_names_of_five_letters_are_compared_without_spaces(name: str, text: str, is_found: bool) -> None:
    match = Resolver(names_of(("mt:a", name, None, 9, None))).match(text)
    assert (match is not None and match.how == "folded") == is_found
