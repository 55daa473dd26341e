"""States and heights of things: read from the manifest; states are judged, and refused where they are damaged."""

from __future__ import annotations

import numpy as np
import pytest

from metric_base.errors import InputError
from metric_tree.curated.sizes import curated_heights
from metric_tree.node import WITH_HEAD, state_priors
from metric_tree.pipeline.companion_files import height_records
from metric_tree.tree import open_tree

SIZE_MM = {"length": 490, "width": 90, "height": 900}
FOLDED = {"state": "folded", "size_mm": SIZE_MM, "sd_log": dict.fromkeys(SIZE_MM, 0.2)}


def test_a_state_is_a_judged_prior_of_the_stated_size_and_spread() -> None:
    [(name, prior)] = state_priors("chair", [FOLDED]).items()
    assert (name, prior.tier, prior.dims) == ("folded", "judged", ("length", "width", "height"))
    assert prior.quantile(0.5) == pytest.approx([490, 90, 900])
    assert prior.log_sd() == pytest.approx([0.2] * 3)  # within and between sources together
    assert np.linalg.eigvalsh(prior.shared_covariance).min() > 0


@pytest.mark.parametrize("wrong", [{}, {"size_mm": {}}, {"sd_log": {"length": 0.2}}, {"state": ""}])
def test_a_damaged_state_is_one_line(wrong: dict[str, object]) -> None:
    with pytest.raises(InputError, match="chair: states: expected a name, sizes and spreads"):
        state_priors("chair", [{**FOLDED, **wrong} if wrong else {}])


def test_the_release_says_what_its_heights_are() -> None:
    tree = open_tree()
    rows = {one.node_id: one for one in curated_heights()}
    assert all(tree.has_node(node_id) for node_id in rows)
    assert tree.release.manifest["heights"] == height_records(rows)
    for node_id in ("sink.n.01", "sink.n.01/other"):
        assert tree.node(node_id).height_is == rows["sink.n.01"].height
        assert not tree.node(node_id).underside_seen
    assert (tree.node("chair.n.01").height_is, tree.node("chair.n.01").underside_seen) == (None, True)


def test_an_axis_without_a_size_has_a_reason() -> None:
    tree = open_tree()
    reasons = {name: tree.find(name).unknown_axes for name in ("sloop", "football goal", "business card", "chair")}
    assert reasons == {
        "sloop": "height: no source states it",
        "football goal": "width: the standard leaves it open",
        "business card": "height: the judged range leaves it open",
        "chair": None,
    }
    incomplete = [node for node in tree if not node.children and node.unknown_axes]
    assert 100 < len(incomplete) < 200
    assert tree.node("mt:tsuka").unknown_axes == "extent2: no model has it"


def test_objects_of_one_scene_share_35_per_cent_of_the_variance_of_a_state() -> None:
    [prior] = state_priors("chair", [FOLDED]).values()
    assert prior.shared_covariance == pytest.approx(0.35 * 0.2**2 * np.eye(3))


def test_the_vertical_extent_of_an_animal_is_that_with_its_head() -> None:
    """Breeds have the definition of the node above them; the ratio has its own spread."""
    tree = open_tree()
    [ratio] = [one.extent for one in curated_heights() if one.node_id == "dog.n.01"]
    for name in ("dog", "beagle"):
        node = tree.find(name)
        prior, outer = node.prior(("height",)), node.states[WITH_HEAD].marginal(("height",))
        assert node.height_is == tree.node("dog.n.01").height_is
        assert outer.quantile(0.5) / prior.quantile(0.5) == pytest.approx([ratio[1]], rel=0.01)
        variance = (np.log(ratio[2] / ratio[0]) / (2 * 1.645)) ** 2
        assert outer.log_sd() ** 2 == pytest.approx(prior.log_sd() ** 2 + variance)
        assert node.outer(prior).tier == prior.tier


def test_the_outer_extents_of_other_things_are_those_of_the_prior() -> None:
    tree = open_tree()
    chair, dog = tree.find("chair"), tree.find("dog")
    assert chair.outer(chair.prior()) is chair.prior()
    lengths = dog.prior(("length", "width"))
    assert dog.outer(lengths) is lengths
    assert tree.find("mixing bowl").height_is is None  # a definition without a ratio holds for its node alone
