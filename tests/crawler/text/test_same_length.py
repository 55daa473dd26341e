"""When two statements are one length."""

from __future__ import annotations

import pytest

from crawler.text.sizes import is_same_length


@pytest.mark.parametrize(
    ("mm", "other_mm", "is_same"),
    [(50.0, 55.9, True), (50.0, 56.1, False), (943.0, 1000.0, True), (937.0, 1000.0, False)],
)
def test_equal_lengths_differ_by_6_mm_or_6_percent_of_the_longer(mm: float, other_mm: float, is_same: bool) -> None:
    assert is_same_length(mm, other_mm) == is_same_length(other_mm, mm) == is_same
