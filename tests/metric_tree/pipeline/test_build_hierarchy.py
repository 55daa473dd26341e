"""Inner nodes: beliefs, how common children are, reduction of mixtures, and which axes a node speaks of."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from metric_tree.axes import AXES, EXTENTS
from metric_tree.curated.rules import BadRule, exclusions, stated_frequencies
from metric_tree.fit.inner_priors import (
    child_belief,
    child_frequencies,
    inner_priors,
    is_part,
    plain_name_weights,
    present_fraction,
    shares_plain_name,
)
from metric_tree.fit.mixture import Mixture, reduce_mixture
from metric_tree.fit.moments import VAGUE, Moments
from metric_tree.pipeline.build import shipped_taxonomy
from metric_tree.prior import Prior

# Published values, written out so that a changed rule fails a test.
PLAIN_NAME_WEIGHT = 0.8

TRUST = {"shop": 1.0, "games": 0.35, "flea market": 1.0}


def child(name: str, mean: float, dims=AXES, kind="product") -> Prior:
    d = len(dims)
    return Prior(
        node_id=name,
        dims=tuple(dims),
        weights=np.ones(1),
        means=np.full((1, d), mean),
        covariances=0.04 * np.eye(d)[None],
        shared_covariance=0.01 * np.eye(d),
        n=5,
        n_sources=1,
        share_by_kind={kind: 1.0},
        borrowed=0.0,
    )


@given(seed=st.integers(0, 1000), k=st.integers(2, 30), kept=st.integers(1, 8))
@settings(max_examples=25, deadline=None)
def test_reduction_keeps_the_moments(seed, k, kept):
    generator = np.random.default_rng(seed)
    factors = generator.normal(0, 0.3, (k, 3, 3))
    mixture = Mixture(
        generator.dirichlet(np.ones(k)),
        generator.normal(6, 1, (k, 3)),
        np.einsum("kij,klj->kil", factors, factors) + 0.01 * np.eye(3),
    )
    small = reduce_mixture(mixture, kept)
    assert len(small.weights) == min(k, kept)
    for one, other in zip(moments_of(mixture), moments_of(small), strict=True):
        assert other == pytest.approx(one, rel=1e-9, abs=1e-9)


def moments_of(mixture: Mixture):
    mean = mixture.weights @ mixture.means
    offset = mixture.means - mean
    outer = np.einsum("k,ki,kj->ij", mixture.weights, offset, offset)
    return mixture.weights.sum(), mean, np.einsum("k,kij->ij", mixture.weights, mixture.covariances) + outer


def test_reduction_merges_what_is_alike():
    means = np.array([[5.0], [5.01], [7.0]])
    small = reduce_mixture(Mixture(np.full(3, 1 / 3), means, np.full((3, 1, 1), 0.01)), 2)
    assert sorted(small.means[:, 0]) == pytest.approx([5.005, 7.0])


def test_a_thousand_pages_of_one_shop_are_one_witness():
    counts = [{"shop": 10_000, "flea market": 10}, {"shop": 100, "flea market": 90}]
    shares = child_frequencies(counts, TRUST)
    assert shares.sum() == pytest.approx(1)
    assert 0.4 < shares[1] < 0.6  # by pages it would be 0.02


def test_children_without_witness_share_a_tenth_or_more_where_witnesses_weigh_little():
    many = dict.fromkeys("abcdefgh", 1.0)
    assert child_frequencies([dict.fromkeys(many, 1000), {}], many) == pytest.approx([0.95, 0.05])
    assert 0.5 < child_frequencies([{"shop": 1}, {}], TRUST)[0] < 0.6  # one page states next to nothing
    assert child_frequencies([{}, {}], TRUST) == pytest.approx([0.5, 0.5])


def test_a_node_speaks_of_the_axes_that_most_of_it_states():
    people = [[child("adult", 7.4, ("height",), "measured")], [child("baby", 6.5, AXES, "judged")]]
    found = inner_priors("person", people, np.array([0.9, 0.1]), AXES)
    assert [prior.dims for prior in found] == [("height",)]
    assert found[0].share_by_kind == pytest.approx({"measured": 0.9, "judged": 0.1})


def test_an_axis_that_more_children_state_has_a_row_of_its_own():
    chairs = [[child("a", 6.0)], [child("b", 6.5, ("height",))]]
    found = {prior.dims: prior for prior in inner_priors("chair", chairs, np.array([0.6, 0.4]), AXES)}
    assert set(found) == {AXES, ("height",)}
    assert found[AXES].n == 5
    assert found[("height",)].n == 10
    assert float(found[("height",)].weights @ found[("height",)].means[:, 0]) == pytest.approx(6.2)


def test_children_of_another_frame_are_left_out():
    found = inner_priors("n", [[child("a", 6.0)], [child("ball", 5.0, EXTENTS)]], np.array([0.7, 0.3]), AXES)
    assert [prior.dims for prior in found] == [AXES]
    assert found[0].means == pytest.approx(np.full((1, 3), 6.0))
    assert inner_priors("n", [[child("ball", 5.0, EXTENTS)]], np.ones(1), AXES) == []


def test_a_parent_believes_the_mean_of_its_children_little_and_their_spread_more():
    children = [
        Moments(str(mean), AXES, np.full(3, mean), 0.01 * np.eye(3), np.full(3, 20.0), None) for mean in (5.0, 6.0, 7.0)
    ]
    belief = child_belief(children)
    assert belief.mean == pytest.approx(np.full(3, 6.0), abs=0.1)
    assert belief.mean_rows < 0.1
    assert np.diag(belief.covariance) == pytest.approx(np.full(3, 0.025), rel=0.3)
    assert child_belief([]) == VAGUE


def test_axes_that_a_child_does_not_state_do_not_count():
    known = np.array([1.0, 1.0, 0.0])
    stating = Moments("a", AXES, np.array([6.0, 6.0, 6.0]), 0.01 * np.eye(3), np.ones(3), None)
    silent = Moments("b", AXES, np.array([6.0, 6.0, 60.0]), 0.01 * np.eye(3), known, None)
    assert child_belief([stating, silent]).mean[2] < 6.5


def test_the_leaf_of_the_plain_name_has_most_of_it_unless_a_reviewer_says_otherwise():
    children = ["mug/other", "tankard", "beaker"]
    weights = plain_name_weights("mug", children, np.array([0.1, 0.6, 0.3]))
    assert weights == pytest.approx([PLAIN_NAME_WEIGHT, (1 - PLAIN_NAME_WEIGHT) * 2 / 3, (1 - PLAIN_NAME_WEIGHT) / 3])
    assert plain_name_weights("mug", children, np.array([0.9, 0.05, 0.05]))[0] == pytest.approx(0.9)
    assert plain_name_weights("mug", children[1:], np.array([0.7, 0.3])) == pytest.approx([0.7, 0.3])
    assert plain_name_weights("mug", children, np.ones(3) / 3, {"tankard": 1.0, "gone": 3.0}) == pytest.approx(
        [0, 1, 0]
    )


def test_children_without_weight_are_not_in_the_mixture():
    objects = [[child("a", 6.0)], [child("b", 9.0)]]
    (prior,) = inner_priors("n", objects, np.array([1.0, 0.0]), AXES)
    assert prior.quantile(0.5) == pytest.approx(objects[0][0].quantile(0.5))


def test_stated_frequencies_are_of_children_that_exist():
    known: dict[str, set[str]] = {}
    for category in shipped_taxonomy().categories():
        known.setdefault(category.parent_id, set()).add(category.node_id)
    assert stated_frequencies()
    for node_id, weights in stated_frequencies().items():
        assert set(weights) <= known[node_id], node_id
        assert sum(weights.values()) == pytest.approx(1, abs=0.02), node_id


def test_a_frequency_that_is_none_is_refused(tmp_path):
    table = tmp_path / "frequencies.csv"
    table.write_text("node_id,child_id,weight,reason\nn,a,-1,because\n")
    with pytest.raises(BadRule, match="weight: expected a number"):
        stated_frequencies(table)


def test_excluded_rows_exist_in_the_taxonomy_and_say_why():
    nodes = {category.node_id for category in shipped_taxonomy().categories()}
    rules = exclusions().rules
    assert {node for own in rules.values() for node, _ in own if node} <= nodes
    assert exclusions().covers("ikea_sa_2020", "door.n.01/other", "LAPPVIKEN: Door, 60x64 cm")
    assert not exclusions().covers("metric_tree_2020", "door.n.01/other", "")
    assert exclusions().covers("open_models", "lion.n.01", "Schleich Lion Action Figure")
    assert not exclusions().covers("open_models", "lion.n.01", "Lion")


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (",mug.n.04,,because", "source"),
        ("shop,,,because", "node_id, title: expected one of them"),
        ("shop,mug.n.04,,", "reason"),
    ],
)
def test_an_exclusion_that_says_too_little_is_refused(tmp_path, row: str, message: str):
    table = tmp_path / "exclusions.csv"
    table.write_text(f"source,node_id,title,reason\n{row}\n")
    with pytest.raises(BadRule, match=message):
        exclusions(table)


def test_parts_are_not_in_the_plain_name():
    children = ["toilet.n.02/other", "flush_toilet.n.01", "toilet_seat.n.01"]
    weights = plain_name_weights("toilet.n.02", children, np.array([0.2, 0.2, 0.6]))
    assert weights == pytest.approx([PLAIN_NAME_WEIGHT, 1 - PLAIN_NAME_WEIGHT, 0])
    assert plain_name_weights("toilet.n.02", children[2:], np.ones(1)) == pytest.approx([1])
    assert not is_part("mt:dog_other", "dog.n.01")


def test_what_is_not_called_by_the_plain_name_weighs_nothing_in_it() -> None:
    categories = {one.node_id: one for one in shipped_taxonomy().categories()}
    iron, children = categories["iron.n.04"], ["iron.n.04/other", "steam_iron.n.01", "ironing_board.n.01"]
    kinds = [shares_plain_name(categories[child], iron) for child in children]
    assert kinds[1:] == [True, False]
    assert plain_name_weights("iron.n.04", children, np.ones(3) / 3, has_name=kinds) == pytest.approx([0.8, 0.2, 0.0])
    assert plain_name_weights("iron.n.04", children, np.ones(3) / 3, has_name=[False] * 3) == pytest.approx(
        [1.0, 0.0, 0.0]
    )


def test_what_a_museum_alone_keeps_is_not_what_people_mean() -> None:
    own = [[child("a", 5.0)], [child("b", 5.0, kind="museum")], [child("c", 5.0)]]
    common = child_frequencies([{}, {}, {}], TRUST, present_fraction(own))
    assert common[1] < 0.02
    assert common[0] == pytest.approx(common[2])
