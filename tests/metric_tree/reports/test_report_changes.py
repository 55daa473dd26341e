"""What differs between two releases."""

import numpy as np
import pytest

from metric_tree.reports.diff import (
    changes,
    label,
    largest_changes,
    release_diff,
    removed_nodes,
    size_and_spread,
    source_changes,
)
from metric_tree.tree import Tree
from tests.synthetic import minitree

FACTOR = 1.5


@pytest.fixture
def whole(tmp_path):
    """The mini tree."""
    return Tree(minitree.release(tmp_path / "whole"))


@pytest.fixture
def opened(tmp_path):
    """The mini tree with a larger and wider swivel chair, and without the rat."""
    content = minitree.rows()
    for prior in content["priors.parquet"]:
        if prior["node_id"] == "swivel_chair.n.01":
            centre = np.mean(prior["means"], axis=0)
            prior["means"] = [[c + np.log(FACTOR) for c in centre]]
            prior["weights"] = [1.0]
            prior["covariances"] = [(4 * np.array(prior["covariances"][0])).tolist()]
    for table in content.values():
        table[:] = [row for row in table if row["node_id"] != "rat.n.01"]
    return Tree(minitree.release(tmp_path / "open", content))


def test_a_node_that_is_gone_is_named(whole, opened):
    assert [node.node_id for node in removed_nodes(opened, whole)] == ["rat.n.01"]
    assert removed_nodes(whole, opened) == []


def test_a_change_is_the_mean_over_the_dimensions(whole, opened):
    (change,) = largest_changes(changes(opened, whole), shown=5)
    assert change.node.name == "swivel chair"
    assert change.size == pytest.approx(np.mean(np.log(change.now_mm / change.then_mm)))
    assert change.size == pytest.approx(np.log(FACTOR), abs=0.1)
    assert change.spread > 0.2
    assert largest_changes(changes(opened, whole), shown=5, least_items=1000) == []


def test_a_release_has_not_changed_since_itself(whole):
    found = changes(whole, whole)
    assert len(found) == 6
    assert largest_changes(found, shown=5) == []
    assert source_changes(whole, whole) == []
    level, n, sizes, widths = size_and_spread(found)[-1]
    assert (level, n) == ("all", 6)
    assert not sizes.any()
    assert not widths.any()


def test_the_spread_is_that_of_a_sample(whole):
    prior = whole.node("swivel_chair.n.01").prior()
    sizes = np.log(prior.marginal(prior.dims).sample(40_000, seed=1))
    assert prior.log_sd() == pytest.approx(sizes.std(axis=0), rel=0.02)


def test_items_of_a_source_before_and_now(whole, tmp_path):
    fewer = minitree.release(tmp_path / "fewer")
    (record,) = fewer.manifest["sources"]
    record["n_fit"] = 3
    assert source_changes(Tree(fewer), whole) == [(record["title"], 0, 3)]


def test_a_release_is_called_by_what_it_leaves_out(whole, tmp_path):
    assert label(whole) == whole.version
    fewer = minitree.release(tmp_path / "fewer")
    Tree(fewer).release.manifest["noncommercial"] = False
    assert label(Tree(fewer)) == f"{whole.version} without non-commercial sources"


@pytest.mark.parametrize(
    ("factor", "widening", "is_moved"), [(1.045, 1.0, False), (1.055, 1.0, True), (1.0, 1.19, False), (1.0, 1.21, True)]
)
def test_a_prior_has_moved_from_five_per_cent_or_a_fifth_of_its_interval(whole, tmp_path, factor, widening, is_moved):
    content = minitree.rows()
    for prior in content["priors.parquet"]:
        if prior["node_id"] == "rat.n.01":
            prior["means"] = (np.array(prior["means"]) + np.log(factor)).tolist()
            for name in ("covariances", "shared_covariance"):
                prior[name] = (widening**2 * np.array(prior[name])).tolist()
    diff = release_diff(whole, Tree(minitree.release(tmp_path / "moved", content)))
    assert [moved.node for moved in diff.priors] == (["rat.n.01"] if is_moved else [])
