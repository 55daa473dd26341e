from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import metric_tree
from metric_base.errors import InputError
from metric_tree import AmbiguousName, BadRelease, NoPrior, Tree, UnknownName
from metric_tree.release.registry import PATH_VARIABLE, release_directory, releases, version_key
from metric_tree.release.terms import basis
from tests.synthetic import minitree


def test_find_folds_names(mini: Tree) -> None:
    for name in ("swivel chair", "Swivel_Chairs", "desk-chair", "swivel_chair.n.01"):
        assert mini.find(name).node_id == "swivel_chair.n.01"
    assert mini.find("mt:bar_stool").path == ("entity", "furniture", "seat", "chair", "bar stool")


def test_an_unknown_name_names_the_nearest(mini: Tree) -> None:
    with pytest.raises(UnknownName, match="swivel chair"):
        mini.find("swivl chiar")
    assert isinstance(UnknownName("x"), KeyError)


def two_zorbs(tmp_path: Path, of_trackballs: int = 4) -> Tree:
    """The small tree with a made-up word for two objects that are no kin."""
    content = minitree.rows()
    for row in content["nodes.parquet"]:
        if row["node_id"] in ("trackball.n.01", "rat.n.01"):
            row["aliases"] = [*row["aliases"], "zorb"]
        if row["node_id"] == "trackball.n.01":
            row["n_items"] = of_trackballs
    return Tree(minitree.release(tmp_path / "r", content))


def test_an_ambiguous_name_lists_its_nodes(tmp_path: Path) -> None:
    tree = two_zorbs(tmp_path)
    with pytest.raises(AmbiguousName, match=r"trackball\.n\.01 \(4 items\), rat\.n\.01 \(2 items\)"):
        tree.find("zorbs")
    meaning = tree.resolve("zorbs")
    assert meaning.ambiguous
    assert [node.node_id for node in meaning.alternatives] == ["rat.n.01"]
    assert "zorb" not in tree


def test_many_more_items_decide(tmp_path: Path) -> None:
    meaning = two_zorbs(tmp_path, of_trackballs=1000).resolve("zorb")
    assert (meaning.node.node_id, meaning.how, meaning.ambiguous) == ("trackball.n.01", "alias", False)


def test_what_detectors_mean_comes_before_the_animal(mini: Tree) -> None:
    assert mini.find("mouse").node_id == "mouse.n.04"
    assert mini.find("Mouse", "openimages_601").node_id == "mouse.n.01"
    assert mini.resolve("mouse", "detectors").how == "label list"


@pytest.mark.parametrize(
    ("text", "how"),
    [
        ("swivel chair", "own name"),
        ("desk chair", "alias"),
        ("SwivelChair", "own name"),
        ("2 swivel chairs", "folded"),
        ("swivel_chair.003", "own name"),
        ("black leather swivel chair", "modifier stripped"),
        ("a swivel chair with wheels", "own name"),
        ("desk chair/swivel chair", "alias"),
        ("swivel_chair.n.01", "id"),
    ],
)
def test_how_a_name_is_reached_is_said(mini: Tree, text: str, how: str) -> None:
    meaning = mini.resolve(text)
    assert (meaning.node.node_id, meaning.how) == ("swivel_chair.n.01", how)


def test_alternatives_that_disagree_are_unknown(mini: Tree) -> None:
    with pytest.raises(UnknownName, match="no node is called 'trackball/rat'"):
        mini.find("trackball/rat")


def test_a_search_ranks_meanings_then_beginnings(mini: Tree) -> None:
    assert mini.search("swivel")[0].node_id == "swivel_chair.n.01"
    assert [node.node_id for node in mini.search("chair", limit=2)] == ["chair.n.01", "swivel_chair.n.01"]
    assert mini.search("swivel chiar")[0].node_id == "swivel_chair.n.01"
    assert mini.search("   ") == ()
    assert mini.search("chair".rjust(300)) == mini.search("chair")
    assert mini.search("chair".rjust(301)) == ()


def test_the_family(mini: Tree) -> None:
    chair = mini.find("chair")
    assert chair.parent is not None
    assert chair.parent.node_id == "seat.n.03"
    assert {child.node_id for child in chair.children} == {"swivel_chair.n.01", "mt:bar_stool"}
    assert mini.root.level == 1
    assert all(leaf.level == 5 for leaf in mini.leaves())
    assert len(list(mini.root.descendants())) == len(mini)


def test_inner_nodes_aggregate_items(mini: Tree) -> None:
    chair = mini.find("chair")
    assert chair.items().num_rows == 23 == chair.n_items
    assert set(chair.items()["node_id"].to_pylist()) == {"swivel_chair.n.01", "mt:bar_stool"}
    assert chair.images().num_rows == 0


def test_a_prior_of_some_dimensions_is_the_marginal(mini: Tree) -> None:
    node = mini.find("swivel chair")
    prior = node.prior(("height",))
    assert prior.dims == ("height",)
    low, high = prior.interval(0.9)[0]
    assert low < 1050 < high
    assert np.allclose(prior.quantile(0.5), 1050)
    assert node.prior() is node.prior(("length", "width", "height"))  # read once
    assert node.prior(("height", "length")).dims == ("height", "length")


def test_no_prior_names_what_exists(mini: Tree) -> None:
    with pytest.raises(NoPrior, match="found length, width, height"):
        mini.find("swivel chair").prior(("extent1",))
    with pytest.raises(NoPrior, match="found none"):
        mini.find("chair").prior()


def test_one_dimension_may_stand_alone(mini: Tree) -> None:
    prior = mini.find("swivel chair").prior("height")
    assert prior.dims == ("height",)
    assert mini.find("swivel chair").prior().marginal("length").dims == ("length",)
    with pytest.raises(NoPrior, match="dims: expected a prior that holds depth; found"):
        mini.find("swivel chair").prior("depth")


@pytest.mark.parametrize("name", [None, 5, b"chair"])
def test_what_is_no_name_is_told(mini: Tree, name: object) -> None:
    with pytest.raises(UnknownName, match="name: expected a name; found"):
        mini.find(name)  # type: ignore[arg-type]
    assert name not in mini


def test_a_tree_contains_what_it_finds(mini: Tree) -> None:
    for name in ("chair", "Swivel_Chairs", "chair.n.01", mini.find("chair")):
        assert name in mini
    assert "unicorn" not in mini


def test_a_list_without_the_word_names_its_own(mini: Tree) -> None:
    with pytest.raises(KeyError, match=r"'seats': no label of coco_80; nearest: "):
        mini.find("seats", "coco_80")


def test_releases_are_found_by_version_and_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    minitree.release(tmp_path / "99.10.0")
    minitree.release(tmp_path / "99.9.0")
    monkeypatch.setenv(PATH_VARIABLE, str(tmp_path))
    assert [path.name for path in releases()[:2]] == ["99.10.0", "99.9.0"]
    assert release_directory("99.9.0") == tmp_path / "99.9.0"
    assert release_directory(tmp_path / "99.9.0") == tmp_path / "99.9.0"
    with pytest.raises(BadRelease, match=r"expected an available version \(99\.10\.0, 99\.9\.0"):
        release_directory("3.3.3")


def test_versions_are_ordered_as_numbers() -> None:
    assert version_key("1.10.0") > version_key("1.9.9") > version_key("1.9.draft")


def test_the_open_release_is_that_without_withheld_sources() -> None:
    opened = metric_tree.open(licence="open")
    assert opened.version == f"{metric_tree.open().version}-open"
    assert not any(source["withheld"] for source in opened.release.manifest["sources"])
    assert release_directory("2.0.0", "open").name == "2.0.0-open"
    with pytest.raises(InputError, match="licence: expected 'open'"):
        metric_tree.open(licence="Apache-2.0")
    with pytest.raises(BadRelease, match=r"1\.0\.0-open: expected an available version"):
        metric_tree.open("1.0.0", licence="open")


def test_the_basis_states_withheld_sources() -> None:
    default, opened = (basis(tree.release.manifest) for tree in (metric_tree.open(), metric_tree.open(licence="open")))
    assert "of 52 sources whose rows are not published" in default
    assert "nuscenes_mini" in default
    assert opened.startswith("The priors of 4.3.0-open are fitted to 49,570 items of sources with open licences. ")


def test_a_release_is_opened_once_for_each_state_of_its_files(tmp_path: Path) -> None:
    release = minitree.release(tmp_path / "r", minitree.rows()).directory
    tree = metric_tree.open(release)
    assert metric_tree.open(release) is tree  # the priors of a batch of scenes are the same objects
    content = minitree.rows()
    content["nodes.parquet"][-1]["aliases"] = ["zorb"]
    shutil.rmtree(release)
    minitree.release(release, content)
    assert metric_tree.open(release).find("zorb").node_id == content["nodes.parquet"][-1]["node_id"]
    (release / "priors.parquet").write_bytes(b"damaged")
    with pytest.raises(BadRelease, match=r"priors\.parquet"):
        metric_tree.open(release)
