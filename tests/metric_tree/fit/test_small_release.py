"""Norms are exact, and a release of few classes takes the shipped model of the evidence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from metric_tree.curated.sizes import norms
from metric_tree.fit.class_prior import class_prior
from metric_tree.fit.evidence_model import EvidenceModel, fit_evidence_model, shipped_model
from metric_tree.fit.moments import VAGUE
from metric_tree.tree import open_tree
from taxonomy.catalogue import default_catalogue
from tests.metric_tree.fit.test_fit import class_rows

#: Sizes that a norm fixes, as anybody can look them up: node, axis, mm.
FIXED = [
    ("compact_disk.n.01", "length", 120.0),
    ("mt:aa_battery", "extent1", 50.5),
    ("mt:aaa_battery", "extent1", 44.5),
    ("table-tennis_table.n.01", "length", 2740.0),
    ("mt:euro_pallet", "length", 1200.0),
    ("mt:a4_sheet", "length", 297.0),
    ("mt:a4_sheet", "width", 210.0),
    ("credit_card.n.01", "length", 85.6),
    ("golf_ball.n.01", "extent1", 42.7),
    ("puck.n.02", "extent3", 25.4),
    ("dartboard.n.01", "height", 451.0),
    ("videocassette.n.01", "length", 188.0),
]


@pytest.mark.parametrize(("node_id", "axis", "mm"), FIXED)
def test_what_a_norm_fixes_is_exact(node_id: str, axis: str, mm: float) -> None:
    prior = open_tree().node(node_id).prior((axis,))
    assert prior.tier == "norm"
    assert prior.norm
    assert prior.quantile(0.5)[0] == pytest.approx(mm, rel=0.005)


def test_every_norm_of_one_size_has_its_median_and_is_no_wider_than_its_tolerance() -> None:
    tree, catalogue = open_tree(), default_catalogue()
    sizes: dict[str, int] = {}
    for row in norms():
        sizes[row.node_id] = sizes.get(row.node_id, 0) + 1
    for row in norms():
        node = tree.node(catalogue.leaf_of(row.node_id) or "")
        assert node.tier == "norm", row.node_id
        if sizes[row.node_id] == 1:
            typical = sorted(value for value in row.typical if value)
            assert sorted(node.prior(node.prior_dims[0]).quantile(0.5)) == pytest.approx(typical, rel=0.002), (
                row.node_id
            )


def test_neither_a_bias_nor_items_move_a_norm() -> None:
    x = np.log([[120.0, 120.0, 1.2], [142.0, 125.0, 10.0], [140.0, 124.0, 9.0]])
    sd = np.array([[0.002] * 3, [np.nan] * 3, [np.nan] * 3])
    rows = class_rows(x, sources=["norms", "shop", "shop"], kinds=["norm", "product", "product"], range_sd=sd)
    model = EvidenceModel(bias={"product": 0.3, "judged": 0.3, "norm": 0.3})
    prior = class_prior(rows, VAGUE, model, heldout=False)
    assert prior.quantile(0.5) == pytest.approx([120, 120, 1.2])
    assert prior.log_sd() == pytest.approx([0.002] * 3, rel=0.01)
    assert prior.disagreement() == pytest.approx(prior.shared_covariance)


def test_the_sizes_of_a_norm_are_weighted_by_their_shares() -> None:
    x = np.log([[550.0, 480.0, 930.0], [730.0, 580.0, 1070.0]])
    rows = class_rows(x, sources=["norms"] * 2, kinds=["norm"] * 2, range_sd=np.full((2, 3), 0.01))
    prior = class_prior(replace(rows, row_share=np.array([0.35, 0.65])), VAGUE, EvidenceModel(), heldout=False)
    assert prior.weights == pytest.approx([0.35, 0.65])
    assert prior.quantile(0.5) == pytest.approx([730, 580, 1070], rel=0.01)
    assert class_prior(rows, VAGUE, EvidenceModel(), heldout=False).weights == pytest.approx([0.5, 0.5])


def test_a_release_of_few_classes_takes_the_shipped_model() -> None:
    assert fit_evidence_model([], []) is shipped_model()
    own, shipped = EvidenceModel(share=1.0, bias={"asset": 0.4}), EvidenceModel(share=0.25, bias={"asset": 0.0})
    mixed = own.towards(shipped, 0.5)
    assert mixed.share == pytest.approx(0.5)
    assert mixed.bias["asset"] == pytest.approx(0.2)
    assert own.towards(shipped, 1.0).share == pytest.approx(1.0)
