"""The type of place: its probability by the classes, and its only effect, the frequencies of kinds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import metric_tree
from estimator.results.object_priors import (
    SceneTypes,
    prior_for_scene_type,
    scene_type_probabilities,
    shipped_scene_types,
)
from tests.synthetic.priors import prior

CHAIR = prior("chair.n.01", [(560, 540, 950), (700, 640, 1100)])
#: Two places with different neighbours of chairs, and different heights of chairs.
TWO = SceneTypes(
    ("chair.n.01", "toilet.n.02", "desk.n.01"),
    np.array([0.5, 0.5]),
    np.array([[2.0, 0.01, 1.0], [0.5, 1.0, 0.01]]),
    {"chair.n.01": np.array([[0.0, 0.0, 20.0], [0.0, 0.0, -20.0]])},
)


def test_classes_say_the_place() -> None:
    nodes = [metric_tree.open().find(name) for name in ("chair", "office chair", "desk")]
    share = scene_type_probabilities(nodes, TWO)
    assert share is not None
    assert share[0] > 0.8
    assert sum(share) == pytest.approx(1, abs=0.03)
    assert scene_type_probabilities(nodes[:2], TWO) is None, "an office chair is a chair: one class"


@given(st.lists(st.integers(0, 40), min_size=18, max_size=18))
def test_shares_are_probabilities_whatever_is_there(counts: list[int]) -> None:
    places = shipped_scene_types()
    share = places.probabilities(counts)
    assert len(share) == len(places.probability) + 1
    assert np.all(share >= 0)
    assert share.sum() == pytest.approx(1)


def test_a_place_moves_the_weights_of_kinds_alone() -> None:
    high, low, unknown = (prior_for_scene_type(CHAIR, share, TWO) for share in ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)))
    assert high.weights[1] > 0.7 > 0.3 > low.weights[1]
    assert unknown.weights == pytest.approx(CHAIR.weights)
    assert np.array_equal(high.means, CHAIR.means)
    assert prior_for_scene_type(prior("lamp.n.01", [(200, 200, 500)]), (1.0, 0, 0), TWO).weights == pytest.approx([1.0])


def test_the_shipped_tilts_have_no_mean() -> None:
    """Common properties of the rooms of one source are not a type of place."""
    places = shipped_scene_types()
    for node, tilts in places.tilts.items():
        part = places.probability * places.rates[:, places.nodes.index(node)]
        assert np.abs(part @ tilts / part.sum()).max() < 0.1
