"""What differs between two releases."""

import numpy as np
import pytest

from metric_tree.reports.diff import label, release_diff
from metric_tree.tree import Tree
from tests.synthetic import minitree


@pytest.fixture
def whole(tmp_path):
    """The mini tree."""
    return Tree(minitree.release(tmp_path / "whole"))


def test_the_spread_is_that_of_a_sample(whole):
    prior = whole.node("swivel_chair.n.01").prior()
    sizes = np.log(prior.marginal(prior.dims).sample(40_000, seed=1))
    assert prior.log_sd() == pytest.approx(sizes.std(axis=0), rel=0.02)


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
