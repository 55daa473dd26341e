"""Named variants and sizes in names: the tables, their names, and the priors of their sizes."""

from pathlib import Path

import numpy as np
import pytest

import metric_tree
from metric_tree.axes import AXES, EXTENTS
from metric_tree.curated.sizes import norms
from metric_tree.variants import BadVariant, StatedSize, Variant, quantity_in, stated_size_rules, variants
from taxonomy.catalogue import default_catalogue
from taxonomy.label_lists import vocabularies, vocabulary

HEADER = (
    "node_id,name,aliases,region,years,share,length_mm,length_tolerance_mm,width_mm,width_tolerance_mm,height_mm,"
    "height_tolerance_mm,document,clause,source,written\n"
)
ROW = "chair.n.01,{name},{aliases},,,,{length},,,,,,ISO 1,clause 1,by hand,2026-11-28\n"


@pytest.fixture(scope="module")
def tree():
    return metric_tree.open()


def medians(node):
    prior = node.prior()
    return dict(zip(prior.dims, prior.quantile(0.5), strict=True))


def test_every_variant_has_a_node_and_sorted_sizes_if_the_node_has_sorted_extents(tree):
    rows = [row for node_rows in variants().values() for row in node_rows]
    assert len(rows) >= 400
    for row in rows:
        node = tree.node(row.node_id)
        assert set(node.dims) & {*row.sizes, *EXTENTS}, row
        sizes = [mm for mm, _ in row.sizes.values()]
        assert node.dims[0] in AXES or sizes == sorted(sizes, reverse=True), row


def test_every_norm_is_a_variant_with_the_same_sizes():
    for norm in norms():
        row = next(row for row in variants()[norm.node_id] if row.name == norm.size)
        assert sorted(mm for mm, _ in row.sizes.values()) == pytest.approx(sorted(filter(None, norm.typical)), rel=1e-4)
        assert (row.document, row.clause, row.region) == (norm.document, norm.clause, norm.region)


@pytest.mark.parametrize(
    ("text", "node_id", "sizes"),
    [
        ("LP", "phonograph_record.n.01", {"length": 301}),
        ("20-foot containers", "mt:shipping_container", {"length": 6058, "height": 2591}),
        ("20' container", "mt:shipping_container", {"length": 6058}),
        ("330ml can", "soda_can.n.01", {"height": 115.2}),
        ("CR2450", "mt:coin_cell", {"extent1": 24.5, "extent3": 5}),
        ("king size mattress", "mattress.n.01", {"length": 2032, "width": 1930}),
        ("2x4", "lumber.n.01", {"extent2": 89, "extent3": 38}),
        ("railroad tie", "lumber.n.01", {"extent1": 2591}),
        ("A-board", "signboard.n.01", {"length": 650, "height": 1050}),
        ("snooker table", "pool_table.n.01", {"length": 3820}),
        ("T8 lamp", "mt:tubular_bulb", {"height": 1213.6}),
        ("42U rack", "mt:server", {"height": 1991}),
        ("29er wheel", "bicycle_wheel.n.01", {"length": 736}),
    ],
)
def test_the_name_of_a_variant_is_the_node_with_this_size(tree, text, node_id, sizes):
    meaning = tree.resolve(text)
    assert (meaning.node.node_id, meaning.how) == (node_id, "variant")
    assert meaning.node.stated.variant.name in meaning.note
    found = medians(meaning.node)
    assert {dim: found[dim] for dim in sizes} == pytest.approx(sizes, rel=0.002)
    assert tree.node(node_id).stated is None  # the plain node is unchanged


@pytest.mark.parametrize(
    ("text", "node_id", "dim", "mm"),
    [
        ("55 inch tv", "television_receiver.n.01", "length", 1229),
        ('27" monitor', "computer_monitor.n.01", "length", 609),
        ("28-inch bicycle", "bicycle.n.01", "length", 1799),
        ("1.5 l bottle", "bottle.n.01", "height", 325),
        ("8 ft ladder", "ladder.n.01", "height", 2365),
        ("size 42 shoe", "shoe.n.01", "length", 300),
        ("6-seat sofa", "sofa.n.01", "length", 3191),
    ],
)
def test_a_number_in_a_name_conditions_the_prior(tree, text, node_id, dim, mm):
    meaning = tree.resolve(text)
    assert meaning.node.node_id == node_id
    assert "by its rule" in meaning.note
    assert medians(meaning.node)[dim] == pytest.approx(mm, rel=0.005)
    low, high = meaning.node.prior((dim,)).interval(0.9)[0]
    plain_low, plain_high = tree.node(node_id).prior((dim,)).interval(0.9)[0]
    assert high / low < plain_high / plain_low


@pytest.mark.parametrize(
    ("name", "where", "mm"),
    [("traffic lane", "usa", 3658), ("parking space", "germany", 2500), ("railway gauge", "russia", 1520)],
)
def test_lanes_bays_and_tracks_have_the_width_of_the_standard_of_a_country(tree, name, where, mm):
    assert tree.find(name).prior(("width",), where).quantile(0.5) == pytest.approx([mm], rel=0.01)


def test_numbers_that_are_no_size_are_ignored(tree):
    for text in ("chair 12", "2 chairs", "size 9 shoe", "5 inch tv", "2-seat sofa", "toy 55 inch tv"):
        try:
            assert tree.resolve(text).node.stated is None, text
        except metric_tree.UnknownName:
            assert text == "toy 55 inch tv"
    assert quantity_in("55 inch") is None
    assert quantity_in("60 x 120 cm tv") is None


def test_sizes_that_a_second_reading_found_wrong_are_corrected(tree):
    """Release 3.0.0 has a cube for a harpsichord, collectors' coins and an ear that lies."""
    for name, low, high in (("harpsichord", 1700, 2900), ("coin", 17, 33), ("ear", 50, 80)):
        low_mm, high_mm = tree.find(name).prior().interval(0.5)[0]
        assert low < low_mm < high_mm < high


def test_a_label_that_names_a_variant_has_its_size(tree):
    saddle = tree.find("saddle_(on_an_animal)", "lvis_v1")
    assert (saddle.node_id, saddle.stated.name) == ("saddle.n.01", "saddle of a horse")
    assert tree.find("saddlebag", "lvis_v1").stated is None


def test_names_of_the_tree_and_of_label_lists_keep_their_node(tree):
    names = {form for form, _ in tree.names()}
    labels = {label.label for name in vocabularies() for label in vocabulary(name)}
    for text in sorted(names | labels):
        meaning = tree.stated_meaning(text)
        if meaning is not None:
            match = tree._resolver.match(text)
            assert match is None or match.node_id == meaning.node.node_id, text


def test_a_variant_that_states_one_axis_keeps_the_relation_of_the_others(tree):
    small, large = (tree.find(f"{size} mm traffic cone").prior() for size in (300, 1000))
    assert small.tier == large.tier == "measured"
    assert small.quantile(0.5)[2] == pytest.approx(300, rel=0.01)
    assert small.quantile(0.5)[0] < large.quantile(0.5)[0]
    assert np.linalg.eigvalsh(small.covariances[0] + small.shared_covariance).min() > 0


def test_the_region_selects_the_variants_of_a_norm(tree):
    plate = tree.find("license plate")
    assert plate.prior(where="usa").quantile(0.5) == pytest.approx([304.8, 152.4], rel=0.01)
    assert plate.prior(where="france").quantile(0.5) == pytest.approx([520, 110], rel=0.01)
    assert plate.prior(where="usa").note == "US: 12 by 6 inches"
    assert "nothing known" in plate.prior(where="kenya").note


def test_variants_of_a_name(tree):
    assert tree.variants("vinyl record") == tree.find("phonograph record").variants
    assert tree.variants("chair") == ()
    assert "LP" in tree


def test_an_older_release_has_the_variants():
    assert medians(metric_tree.open("2.0.0").find("LP"))["length"] == pytest.approx(301, rel=0.01)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([ROW.format(name="a", aliases="", length="0,1")], "length_mm"),
        ([ROW.format(name="a", aliases="", length="10,20")], "length"),
        ([ROW.format(name="a", aliases="", length=",")], "sizes"),
        ([ROW.format(name="", aliases="", length="10,1")], "name"),
        ([ROW.format(name="a", aliases="", length="10,1")] * 2, "name"),
        ([ROW.format(name=name, aliases="x y", length="10,1") for name in "ab"], "aliases"),
    ],
)
def test_a_bad_variant_is_one_line_with_its_place(tmp_path: Path, rows, message):
    path = tmp_path / "variants.csv"
    path.write_text(HEADER + "".join(rows).replace(",,,,,,ISO", ",,,,,ISO"), encoding="utf-8")
    with pytest.raises(BadVariant, match=message) as error:
        variants(path)
    assert "\n" not in str(error.value)
    assert f"{path}:{1 + len(rows)}" in str(error.value)


def test_rules_state_axes_that_their_node_has(tree):
    for rule in stated_size_rules():
        dims = tree.node(rule.node_id).dims
        axes = {part.split()[0] for part in rule.axes.split("; ")}
        assert dims[0] == EXTENTS[0] or axes <= set(dims), rule


@pytest.mark.parametrize(("tolerance", "sd"), [(1.0, 0.001), (1.645, 0.001), (3.29, 0.002)])
def test_a_variant_has_a_standard_deviation_of_at_least_a_thousandth(tolerance: float, sd: float) -> None:
    texts = dict.fromkeys(("node_id", "name", "document", "clause", "source"), "a")
    one = Variant(**texts, written="2026-01-01", length_mm=1000.0, length_tolerance_mm=tolerance)
    assert one.stated.sizes == {"length": (1000.0, pytest.approx(sd))}


def test_a_size_of_another_axis_changes_nothing(tree):
    height = tree.find("chair").prior(("height",))
    assert StatedSize("90 cm", {"length": (900.0, 0.01)}).of(height, False) is height


def test_every_name_of_a_variant_is_found_and_other_names_need_no_table(tree, monkeypatch):
    rows = [row for of_node in variants().values() for row in of_node if tree.has_node(row.node_id)]
    aliases = [alias for row in rows for alias in row.aliases.split("; ") if alias]
    assert {tree.stated_meaning(alias).how for alias in aliases} == {"variant"}
    assert tree.stated_meaning("Olympic barbells").how == "variant"
    monkeypatch.delattr("metric_tree.variants.named_variant")
    assert tree.stated_meaning("swivel chairs") is None


def test_the_mode_of_a_category_with_a_norm_is_its_most_frequent_size(tree):
    """A record of 250 mm, the median of equal weights, is no LP."""
    shares = {row.node_id: [one for one in norms() if one.node_id == row.node_id] for row in norms() if row.share}
    for node_id, rows in shares.items():
        prior = tree.node(default_catalogue().leaf_of(node_id)).prior()
        assert sorted(prior.weights) == pytest.approx(sorted(row.share for row in rows), abs=1e-3)
        mode = np.exp(prior.means[np.argmax(prior.weights)])
        top = max(row.share for row in rows)
        stated = [sorted(filter(None, row.typical)) for row in rows if row.share == top]
        assert any(set(np.round(mode, 1)) <= set(np.round(one, 1)) for one in stated), node_id
        if node_id in {"phonograph_record.n.01", "license_plate.n.01", "brick.n.01", "mt:wheelie_bin"}:
            sizes = np.array([sorted(filter(None, row.typical)) for row in rows])
            medians = prior.quantile(0.5)
            assert max(np.abs(np.log(sizes / mm)).min() for mm in medians) < 0.03
