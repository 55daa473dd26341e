"""States of objects: a mixture with the plain prior, from which the likelihood chooses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from estimator.posterior.axis_assignments import is_sorted
from estimator.records.objects import MeasuredObject
from estimator.records.result import ObjectReport
from estimator.results.estimate import scale_of_objects
from estimator.results.object_priors import STATE_PROBABILITY, prior_with_states
from metric_tree.tree import Tree, open_tree

#: Objects that determine a scale of 1 m per unit.
ROOM = (("chair", (0.55, 0.52, 0.9)), ("desk", (1.4, 0.7, 0.74)), ("sofa", (2.0, 0.9, 0.82)))


@pytest.fixture(scope="module")
def tree() -> Tree:
    return open_tree()


def report(category: str, size: Sequence[float], tree: Tree) -> ObjectReport:
    """Return the report of an object of this size in m, in a room of known objects."""
    entries = [*ROOM, (category, size)]
    objects = [MeasuredObject(str(n), name, np.array(m), np.full(3, 0.05)) for n, (name, m) in enumerate(entries)]
    result = scale_of_objects(objects, tree)
    assert result.scale == pytest.approx(1, abs=0.05)
    return result.objects[-1]


@pytest.mark.parametrize(
    ("category", "size"),
    [
        ("bed", (2.05, 1.45, 0.52)),  # without a headboard
        ("bed", (2.1, 1.5, 1.1)),
        ("stove", (0.59, 0.52, 0.06)),  # the hob
        ("stove", (0.6, 0.6, 0.85)),
        ("folding chair", (0.49, 0.09, 0.9)),  # folded
    ],
)
def test_an_object_in_any_of_its_states_is_no_outlier(category: str, size: tuple[float, ...], tree: Tree) -> None:
    assert report(category, size, tree).verdict == "used"


def test_a_size_of_no_state_is_an_outlier(tree: Tree) -> None:
    assert report("folding chair", (0.1, 0.09, 0.2), tree).verdict == "outlier"


def test_the_states_have_a_small_weight_and_their_sizes(tree: Tree) -> None:
    bed = tree.find("bed")
    mixed, state = prior_with_states(bed.prior(), bed), bed.states["without headboard"]
    assert mixed.weights[-1] == STATE_PROBABILITY
    assert mixed.weights.sum() == pytest.approx(1)
    assert np.array_equal(mixed.means[-1], state.means[0])
    assert np.array_equal(mixed.weights[:-1], (1 - STATE_PROBABILITY) * bed.prior().weights)


def test_the_state_of_the_plain_prior_is_no_further_state(tree: Tree) -> None:
    fan = tree.find("hand fan")  # closed in shops
    assert len(prior_with_states(fan.prior(), fan).weights) == len(fan.prior().weights) + len(fan.states) - 1


@pytest.mark.parametrize("name", ["chair", "umbrella", "65 inch television"])
def test_without_other_states_the_prior_is_unchanged(name: str, tree: Tree) -> None:
    """A chair has no state, the prior of an umbrella is over sorted extents, and a name may state the size."""
    node = tree.find(name)
    prior = node.prior()
    assert prior_with_states(prior, node) is prior
    assert is_sorted(prior) == (name == "umbrella")
    assert (node.stated is not None) == (name == "65 inch television")


@pytest.mark.parametrize("height", [0.42, 0.68])
def test_a_dog_is_as_high_as_its_head(height: float, tree: Tree) -> None:
    """Its height is at the withers, 0.45 m; the measured extent is that with its head, in any pose."""
    dog = tree.find("dog")
    mixed = prior_with_states(dog.prior(("height",)), dog)
    plain, outer = dog.prior(("height",)), dog.outer(dog.prior(("height",)))
    assert np.array_equal(mixed.means[: len(outer.means)], outer.means)
    assert (outer.means > plain.means).all()
    assert report("dog", (0.9, 0.25, height), tree).verdict == "used"
