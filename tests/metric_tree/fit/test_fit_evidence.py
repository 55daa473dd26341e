"""Weight of a row by its kind and by the number of rows of its source."""

from __future__ import annotations

import numpy as np
import pytest

from metric_tree.fit.evidence_model import EvidenceModel, fit_evidence_model, shipped_model
from metric_tree.fit.random_effects import source_means
from metric_tree.fit.rows import row_weights


def test_fifty_rows_of_a_source_have_half_of_its_largest_weight() -> None:
    assert row_weights(["shop"] * 50, ["product"] * 50).sum() == pytest.approx(25.0)
    assert row_weights(["shop"] * 5000, ["product"] * 5000).sum() == pytest.approx(50.0, rel=0.02)


def test_a_large_shop_does_not_drown_a_small_one() -> None:
    weights = row_weights(["large"] * 1000 + ["small"] * 50, ["product"] * 1050)
    assert weights[:1000].sum() < 2 * weights[1000:].sum()


def test_weak_rows_lose_half_their_weight_at_three_strong_rows_and_all_of_it_at_thirty():
    def model(strong, has_range=False):
        return row_weights(["shop"] * strong + ["artist"], ["product"] * strong + ["asset"], has_range=has_range)[-1]

    assert model(3) == pytest.approx(model(0) / 2)
    assert model(29) == pytest.approx(model(0) * 3 / 32)
    assert model(30) == 0.0
    assert model(19, has_range=True) > 0.0
    assert model(20, has_range=True) == 0.0  # a range is equivalent to ten rows


def test_a_single_size_is_a_third_of_a_row_if_others_have_more():
    several = row_weights(["shop"] * 2, ["product"] * 2, n_stated=np.array([3, 1]))
    assert several[1] == pytest.approx(several[0] / 3)
    assert row_weights(["shop"] * 2, ["product"] * 2, n_stated=np.array([1, 1])).std() == 0.0


def test_a_scale_of_zero_counts_as_half_a_percent_when_models_are_mixed() -> None:
    none, some = EvidenceModel(share=0.0, spread=0.0), EvidenceModel(share=0.2, spread=0.05)
    halfway = none.towards(some, 0.5)
    assert (halfway.share, halfway.spread) == pytest.approx((np.sqrt(0.005 * 0.2), np.sqrt(0.005 * 0.05)))


def two_sources(shift: float, rows: int = 8):
    """The means of two sources of a class, with so many rows each."""
    x = np.linspace(6.0, 6.2, 2 * rows)[:, None] + np.repeat([0.0, shift], rows)[:, None]
    names = ["a"] * rows + ["b"] * rows, ["product"] * rows + ["asset"] * rows
    return source_means(x, np.ones((2 * rows, 1)), np.ones(2 * rows), *names, np.array([[0.01]]))


def test_eight_classes_with_two_sources_change_the_shipped_model() -> None:
    classes = [("furniture.n.01", two_sources(0.1 * number)) for number in range(8)]
    kinds = sorted({"product", "asset", "measured", "museum", "judged", "default", "statistic", "standard", "norm"})
    assert fit_evidence_model(classes[:7], kinds) is shipped_model()
    assert fit_evidence_model(classes, kinds).bias != shipped_model().bias


def test_eight_rows_of_a_source_determine_its_spread() -> None:
    assert np.isfinite(two_sources(0.0).spreads).all()
    assert np.isnan(two_sources(0.0, rows=7).spreads).all()


@pytest.mark.parametrize(("sd", "published"), [(0.0, 0.01), (0.0115, 0.0115)])
def test_a_source_has_a_spread_of_at_least_a_hundredth(sd: float, published: float) -> None:
    x = np.full((8, 1), 6.0) + sd * np.sqrt(7 / 8) * np.tile([[-1.0], [1.0]], (4, 1))
    found = source_means(x, np.ones((8, 1)), np.ones(8), ["a"] * 8, ["product"] * 8, np.full((1, 1), sd**2))
    assert found.spreads == pytest.approx([published])
    assert np.sqrt(found.within) == pytest.approx(np.full((1, 1), published), rel=0.05)
