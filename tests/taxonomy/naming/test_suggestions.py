"""Numbers of names in messages and searches."""

from __future__ import annotations

import pytest

import metric_tree
from metric_base.errors import InputError
from taxonomy.label_lists import UnknownLabel, labelled_node


def test_an_unknown_label_has_at_most_3_similar_ones() -> None:
    with pytest.raises(UnknownLabel, match="nearest: ") as error:
        labelled_node("caot", "lvis_v1")
    assert str(error.value).partition("nearest: ")[2].count(",") == 2


@pytest.mark.parametrize(("n", "is_shown"), [(300, True), (301, False)])
def test_a_name_has_at_most_300_characters(n: int, is_shown: bool) -> None:
    with pytest.raises(InputError) as error:
        metric_tree.open().find("q" * n, advice=False)
    assert ("q" * n in str(error.value)) == is_shown
