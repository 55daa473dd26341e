"""One edit between two words, against its definition; weights of the label lists."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from taxonomy.naming.names import (
    is_misleading_alias,
    sense_score,
)
from taxonomy.words.senses import LABEL_WEIGHT, Sense, label_votes
from taxonomy.words.spelling import by_letters, one_edit, written_forms

# Published values, written out so that a changed rule fails a test.
FREQUENT_SENSE_SCORE = 1.0
LABEL_WEIGHT_ELSEWHERE = 0.7
MIN_SENSE_FRACTION = 0.1
PRECEDING_SENSE_PENALTY = 0.15

LETTERS = "abc"


def _edits(word: str) -> set[str]:
    """All words one edit away over three letters."""
    cuts = [(word[:at], word[at:]) for at in range(len(word) + 1)]
    return (
        {a + b[1:] for a, b in cuts if b}
        | {a + letter + b[1:] for a, b in cuts if b for letter in LETTERS}
        | {a + letter + b for a, b in cuts for letter in LETTERS}
        | {a + b[1] + b[0] + b[2:] for a, b in cuts if len(b) > 1}
    ) - {word}


@given(st.text(LETTERS, max_size=5), st.text(LETTERS, max_size=5))
@example("abc", "cac")
@example("ab", "ba")
def test_one_edit_is_what_it_says(word: str, other: str) -> None:
    assert one_edit(word, other) == (other in _edits(word))


def test_a_label_weighs_what_its_lists_do() -> None:
    assert label_votes("toaster")["toaster.n.02"] >= LABEL_WEIGHT["coco_80"] + LABEL_WEIGHT["lvis_v1"]
    assert min(label_votes("toaster").values()) >= LABEL_WEIGHT_ELSEWHERE


def test_a_rare_sense_counts_itself() -> None:
    """Each sense counts one more than its uses."""
    senses = [Sense(("board.n.01",), 81), Sense(("board.n.09",), 8)]
    assert (8 + 1) / (82 + 9) < MIN_SENSE_FRACTION < 9 / 89
    assert is_misleading_alias(1, senses, "board")
    assert not is_misleading_alias(1, [Sense(("board.n.01",), 80), senses[1]], "board")
    assert not is_misleading_alias(1, [Sense(("plank.n.01",), 81), senses[1]], "board")


def test_asense_scores_by_its_uses_less_those_before_it() -> None:
    senses = [Sense(("board.n.01",), 7), Sense((), 3), Sense(("board.n.09",), 3)]
    scores = [sense_score(place, senses) for place in (0, 2)]
    assert scores == [FREQUENT_SENSE_SCORE, FREQUENT_SENSE_SCORE * 4 / 8 - PRECEDING_SENSE_PENALTY]


@pytest.mark.parametrize(
    ("name", "is_found"), [("bed side", True), ("bed s", False), ("a bed", False), ("a beds", True)]
)
def test_only_names_of_five_letters_are_found_without_their_spaces(name: str, is_found: bool) -> None:
    forms = list(written_forms(name.replace(" ", ""), lambda: by_letters([name])))
    assert (name in forms) is is_found
