"""What a row weighs: by its kind and by how many rows its source has."""

from __future__ import annotations

import pytest

from metric_tree.fit.rows import row_weights


def test_fifty_rows_of_a_source_have_half_of_its_largest_weight() -> None:
    assert row_weights(["shop"] * 50, ["product"] * 50).sum() == pytest.approx(25.0)
    assert row_weights(["shop"] * 5000, ["product"] * 5000).sum() == pytest.approx(50.0, rel=0.02)


def test_a_large_shop_does_not_drown_a_small_one() -> None:
    weights = row_weights(["large"] * 1000 + ["small"] * 50, ["product"] * 1050)
    assert weights[:1000].sum() < 2 * weights[1000:].sum()
