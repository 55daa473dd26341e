"""Probabilities of the explanations of extents, by their formulas with the published values."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models3d.asset import AssetBody
from models3d.size_check.hypotheses import hypotheses, ordered_sizes
from models3d.size_check.size_model import SizeModel, size_model
from tests.synthetic.priors import prior

MODEL = SizeModel((0, 1, 2), False, np.ones(1), np.log([[900.0, 500.0, 700.0]]), 0.09 * (0.5 + 0.5 * np.eye(3))[None])


def _body(longest: float, is_centred: bool) -> AssetBody:
    sides = np.array([longest, 0.62, 0.53])
    low = -sides / 2 if is_centred else np.zeros(3)
    return AssetBody("model", low, low + sides)


@pytest.mark.parametrize(("longest", "is_centred"), [(0.937, False), (0.937, True), (1.0, False), (1.0, True)])
def test_the_prior_of_every_explanation(longest: float, is_centred: bool) -> None:
    """A side of 1 m is round (a fifth of the models, within 0.1 %) and normalised (60 % of the arbitrary scales)."""
    found = hypotheses(_body(longest, is_centred), "y", MODEL)
    x = np.log(1000 * np.array([[longest, 0.53, 0.62]]))
    density, is_round = float(MODEL.log_density(x)[0]), longest == 1.0
    other, normalised = (0.2, 0.8) if is_centred else (0.8, 0.2)
    at_unit = 1 / (0.001 * math.sqrt(2 * math.pi)) / 4 if is_round else 0.0
    size = (0.4 * other / (2 * math.log(1e4)) + 0.6 * at_unit * normalised) / other
    expected = {
        ("right", 1.0, None): math.log(0.70) + density + math.log(0.8 + (0.2 / (2 * 0.001 / 0.1) if is_round else 0)),
        ("unit", 10.0, None): math.log(0.18 * 0.07) + float(MODEL.log_density(x + math.log(10.0))[0]),
        ("arbitrary", None, None): math.log(0.06 * size) + float(MODEL.log_evidence(x)[0]),
        ("miniature", 6.0, None): math.log(0.01 / 22) + float(MODEL.log_density(x + math.log(6.0))[0]),
        ("unlike", None, None): math.log(0.03) - 3 * math.log(math.log(1e4)),
    }
    for axis in range(3):
        others = float(MODEL.without(axis).log_density(x)[0])
        expected["stretched", None, axis] = math.log(0.02 / 3) + others - math.log(2 * math.log(10.0))
    logs = {(row.kind, row.factor, row.axis): math.log(row.probability) for row in found if not row.is_rotated}
    right = ("right", 1.0, None)
    for key, value in expected.items():
        assert logs[key] - logs[right] == pytest.approx(value - expected[right], abs=1e-6)


@pytest.mark.parametrize(("up", "chances"), [("y", (0.02, 0.96, 0.02)), (None, (0.04, 0.5, 0.46))])
def test_the_prior_of_the_vertical(up: str | None, chances: tuple[float, ...]) -> None:
    """An unexplained object has no proportions, so that only the prior of the orientation is left."""
    found = hypotheses(_body(0.937, False), up, MODEL)  # type: ignore[arg-type]
    unlike = {row.up: row.probability for row in found if row.kind == "unlike"}
    assert [unlike[axis] / sum(unlike.values()) for axis in "xyz"] == pytest.approx(chances)


@pytest.mark.parametrize(
    ("tier", "is_broader", "fraction"),
    [("norm", False, 0.05), ("few", False, 0.08), (None, False, 0.1), ("few", True, 0.3)],
)
def test_errors_of_models_by_artists(tier: str | None, is_broader: bool, fraction: float) -> None:
    """0.15 of all sides and 0.12 of each; models that deviate much have 0.6 and 0.5 in addition."""
    sizes = prior("chair", [(560.0, 540.0, 950.0)])
    model = size_model(sizes, tier, is_broader=is_broader)
    usual = sizes.covariances[0] + sizes.shared_covariance + 0.15**2 + 0.12**2 * np.eye(3)
    assert model.weights == pytest.approx([1 - fraction, fraction])
    assert model.covariances[0] == pytest.approx(usual)
    assert model.covariances[1] == pytest.approx(usual + 0.6**2 + 0.5**2 * np.eye(3))


def test_a_side_without_an_extent_counts_as_a_micrometre() -> None:
    sizes = ordered_sizes(np.array([0.9e-6, 0.5, 1.1e-6]), "y", is_sorted=False)
    assert sizes == pytest.approx(np.log([1.1e-3, 1e-3, 500]))
    assert ordered_sizes(np.array([0.0, 0.5, 0.2]), "z", is_sorted=True) == pytest.approx(np.log([500, 200, 1e-3]))
