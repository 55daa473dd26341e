"""Tiers: the numbers of docs/reference/tiers.md, the order, mixtures, and releases that have none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from metric_base.errors import InputError
from metric_tree.node import ThinEvidence
from metric_tree.prior import Prior
from metric_tree.tiers import TIERS, Evidence, is_at_least, leaf_tier, mixture_tier, tier_of_shares
from metric_tree.tree import open_tree
from tests.synthetic import minitree
from tests.synthetic.priors import prior as synthetic_prior

# Published values, written out so that a changed rule fails a test.
MAX_BORROWED_FRACTION = 0.5
MAX_JUDGED_FRACTION = 0.5
MIN_FEW_ROWS = 3.0
MIN_MEASURED_ROWS = 10.0
MIN_MEASURED_SOURCES = 2

PAGE = Path(__file__).resolve().parents[2] / "docs/reference/tiers.md"


def test_the_page_has_the_tiers_and_their_numbers() -> None:
    text = PAGE.read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.startswith("| `")]
    assert tuple(line.split("`")[1] for line in lines) == TIERS
    assert f"{MIN_MEASURED_ROWS:g} or more effective rows" in lines[1]
    assert f"of {MIN_MEASURED_SOURCES} sources or more" in lines[1]
    assert f"{MIN_FEW_ROWS:g} or more such rows" in lines[2]
    assert MAX_BORROWED_FRACTION == MAX_JUDGED_FRACTION == 0.5  # "more than half"


@pytest.mark.parametrize(
    ("evidence", "borrowed", "judged", "tier"),
    [
        (Evidence(10.0, 2), 0.0, 0.6, "measured"),
        (Evidence(9.9, 2), 0.0, 0.6, "few"),
        (Evidence(500.0, 1), 0.0, 0.0, "few"),
        (Evidence(3.0, 1), 0.6, 0.0, "borrowed"),
        (Evidence(2.9, 1, 0, 1), 0.0, 0.8, "judged"),
        (Evidence(0.0, 0, 8, 1), 0.0, 0.51, "judged"),
        (Evidence(0.0, 0, 8, 1), 0.0, 0.49, "models"),
        (Evidence(0.0, 0, 3, 0), 0.4, 0.0, "models"),
        (Evidence(0.0, 0, 0, 1), 0.0, 1.0, "judged"),
    ],
)
def test_the_tier_of_a_class(evidence: Evidence, borrowed: float, judged: float, tier: str) -> None:
    assert leaf_tier(evidence, borrowed, judged) == tier
    assert leaf_tier(evidence, borrowed, judged, is_norm=True) == "norm"


@given(st.lists(st.tuples(st.sampled_from(TIERS), st.floats(0.01, 1.0)), min_size=1, max_size=9))
def test_half_of_a_mixture_reaches_its_tier(parts: list[tuple[str, float]]) -> None:
    tier, total = mixture_tier(parts), sum(weight for _, weight in parts)
    better = sum(weight for own, weight in parts if TIERS.index(own) < TIERS.index(tier))
    assert better < total / 2 + 1e-9 <= better + sum(weight for own, weight in parts if own == tier) + 2e-9


def test_tiers_are_ordered_and_others_are_refused() -> None:
    assert is_at_least("few", "few")
    assert not is_at_least("models", "few")
    with pytest.raises(InputError, match="expected one of norm, measured"):
        is_at_least("few", "good")


@pytest.mark.parametrize(
    ("shares", "n", "sources", "borrowed", "tier"),
    [
        ({"product": 1.0}, 40, 3, 0.1, "measured"),
        ({"product": 1.0}, 3, 1, 0.73, "borrowed"),  # the sun lounger of 2.0.0
        ({"curated": 1.0}, 0, 1, 0.0, "judged"),
        ({"asset": 1.0}, 6, 2, 0.2, "models"),
        ({"curated": 0.2, "measured": 0.8}, 4, 2, 0.0, "few"),
    ],
)
def test_a_row_of_an_older_release_has_a_tier(shares, n, sources, borrowed, tier) -> None:
    assert tier_of_shares(shares, n, sources, borrowed) == tier


def test_a_row_keeps_its_tier_counts_and_norm() -> None:
    prior = replace(
        synthetic_prior("disc", [[120.0, 120.0, 1.2]]),
        tier="norm",
        evidence=Evidence(3.25, 2, 1, 0),
        norm="IEC 60908, clause 6",
    )
    again = Prior.of_row(prior.row())
    assert (again.tier, again.evidence, again.norm) == (prior.tier, prior.evidence, prior.norm)
    assert again.marginal(("height",)).tier == "norm"


def test_a_name_is_refused_where_its_size_rests_on_too_little(tmp_path: Path) -> None:
    content = minitree.rows()
    for row in content["priors.parquet"]:
        row["tier"] = "judged" if row["node_id"] == "mt:bar_stool" else "few"
    tree = open_tree(minitree.release(tmp_path / "r", content).directory)
    assert tree.find("swivel chair", at_least="few").tier == "few"
    with pytest.raises(ThinEvidence, match=r"mt:bar_stool: tier: expected few or better; found judged"):
        tree.find("bar stool", at_least="few")
