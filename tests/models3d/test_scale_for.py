"""The scale of one object from its category, its extents and other estimates, without a file."""

from __future__ import annotations

import numpy as np
import pytest

import metric_tree
from metric_base.errors import InputError
from metric_tree.tree import UnknownName
from models3d.asset import Asset, AssetBody
from models3d.size_check.check import check_bodies

CHAIR = {"length": 0.52, "width": 0.50, "height": 0.90}


@pytest.mark.parametrize(
    ("unit", "verdict", "factor"), [(1, "right", 1), (1000, "wrong unit", 0.001), (1 / 0.0254, "wrong unit", 0.0254)]
)
def test_units(unit: float, verdict: str, factor: float) -> None:
    found = metric_tree.scale_for("chair", {name: unit * side for name, side in CHAIR.items()})
    assert (found.verdict, found.node_id) == (verdict, "chair.n.01")
    assert found.factor == pytest.approx(factor)
    assert found.low < factor < found.high
    assert f"{verdict} (p = {found.probability:.2f}) as chair" in found.reason


def test_it_is_the_verdict_of_check_asset() -> None:
    from pathlib import Path

    extents = np.array([0.5, 0.9, 0.52])
    body = AssetBody("chair", np.zeros(3), extents)
    asset = Asset(Path("chair.glb"), "glb", None, "y", (body,))
    (check,) = check_bodies(asset, metric_tree.open(), "chair")
    found = metric_tree.scale_for("chair", extents.tolist(), up="y")
    assert (found.verdict, found.factor) == (check.verdict, check.factor)
    assert found.probability == pytest.approx(check.probability)
    assert check.true_size is not None
    assert (found.low, found.median, found.high) == pytest.approx(check.true_size.factor)


def test_evidence_narrows_and_moves_the_factor() -> None:
    normalised = [0.58, 1.0, 0.55]
    alone = metric_tree.scale_for("mug", normalised)
    found = metric_tree.scale_for("mug", normalised, evidence=[(0.11, 0.1)])
    assert np.log(found.high / found.low) < 0.6 * np.log(alone.high / alone.low)
    assert found.median == pytest.approx(0.11, rel=0.05)
    assert "1 estimate" in found.reason


def test_wrong_evidence_is_an_outlier() -> None:
    """A contradicting estimate (DOUBT of 0.1) does not move the posterior of the proportions."""
    alone = metric_tree.scale_for("chair", CHAIR)
    found = metric_tree.scale_for("chair", CHAIR, evidence=[metric_tree.FactorEvidence(100.0, 0.1)])
    assert found.median == pytest.approx(alone.median, rel=0.02)
    certain = metric_tree.scale_for("chair", CHAIR, evidence=[metric_tree.FactorEvidence(2.0, 0.01, doubt=0)])
    assert certain.median == pytest.approx(2.0, rel=0.02)
    assert certain.verdict != "right"


@pytest.mark.parametrize("extents", [[1.0, 2.0], [1.0, 0.0, 1.0], [1.0, float("nan"), 1.0], {"length": 1.0}])
def test_invalid_extents(extents: list[float]) -> None:
    with pytest.raises((InputError, ValueError)) as error:
        metric_tree.scale_for("chair", extents)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("factor", "sd_log", "doubt"), [(0, 0.1, 0.1), (1, 0, 0.1), (1, 0.1, 1.0), (1, 0.1, -0.1)])
def test_invalid_evidence(factor: float, sd_log: float, doubt: float) -> None:
    with pytest.raises(InputError, match="scale_for: evidence: expected a positive factor"):
        metric_tree.FactorEvidence(factor, sd_log, doubt)


def test_unknown_category() -> None:
    with pytest.raises(UnknownName):
        metric_tree.scale_for("zxqvt", CHAIR)


@pytest.mark.parametrize(("category", "sides"), [("bottle", (0.037, 0.037, 0.129)), ("sofa", (370.0, 159.0, 150.0))])
def test_the_factor_is_in_its_interval(category: str, sides: tuple[float, float, float]) -> None:
    """Files in metres and in centimetres of unusual sizes, which the proportions alone would contradict."""
    found = metric_tree.scale_for(category, dict(zip(("length", "width", "height"), sides, strict=True)))
    assert found.verdict in {"right", "wrong unit"}
    assert found.factor in {found.low, found.high}
    assert found.low < found.median < found.high
