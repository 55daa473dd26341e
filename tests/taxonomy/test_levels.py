"""The frozen levels' rules, the placing rule, and the cuts that propose levels."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.taxonomy.propose_levels import cut, explained, nested_cuts
from metric_base.errors import FieldError
from taxonomy.levels import BadLevels, InnerNode, Levels, frozen_levels, table_rows


def inner(node_id, level, parent=None, claims=()):
    return InnerNode(
        node_id=node_id, name=node_id, level=level, parent_id=parent, pose="upright", dims=("height",), claims=claims
    )


ROOT = inner("entity.n.01", 1)
FURNITURE = inner("furniture.n.01", 2, "entity.n.01")
SEAT = inner("seat.n.03", 3, "furniture.n.01")
CHAIR = inner("chair.n.01", 4, "seat.n.03", ("chair.n.01",))
OTHER_SEAT = inner("mt:seat_other", 4, "seat.n.03", ("mt:seat_other", "seat.n.03"))
NODES = (ROOT, FURNITURE, SEAT, CHAIR, OTHER_SEAT)


def test_a_synset_goes_to_the_nearest_kind_that_claims_a_hypernym():
    levels = Levels(NODES)
    assert levels.kind_of("swivel_chair.n.01", ("chair.n.01", "seat.n.03")) == "chair.n.01"
    assert levels.kind_of("pew.n.01", ("bench.n.01", "seat.n.03")) == "mt:seat_other"
    assert levels.kind_of("dog.n.01", ("animal.n.01",)) is None


def test_unspecified_items_of_a_family_hang_on_the_kind_that_claims_it():
    levels = Levels(NODES)
    assert levels.home_of("chair.n.01") == "chair.n.01"
    assert levels.home_of("seat.n.03") == "mt:seat_other"
    assert levels.home_of("mt:seat_other") is None
    assert levels.home_of("furniture.n.01") is None


@pytest.mark.parametrize(
    ("nodes", "message"),
    [
        ((ROOT, ROOT), "a new id"),
        ((ROOT, inner("other.n.01", 1)), "one root"),
        ((ROOT, inner("chair.n.01", 4, "entity.n.01")), "level: expected 2"),
        ((*NODES, inner("stool.n.01", 4, "seat.n.03", ("chair.n.01",))), "each once"),
        ((ROOT, inner("chair.n.01", 2, "nowhere.n.01")), "level: expected 1"),
    ],
)
def test_a_broken_rule_is_named(nodes, message):
    with pytest.raises(FieldError, match=message):
        Levels(nodes)


def test_a_bad_table_is_named_in_one_line(tmp_path):
    table = tmp_path / "levels.csv"
    table.write_text("node_id,name\nentity.n.01,entity\n")
    with pytest.raises(BadLevels, match=r"levels.csv: header: expected columns .*, found no claims, dims"):
        frozen_levels(table)
    table.write_text("node_id,name,level,parent_id,pose,dims,claims\nentity.n.01,entity,1,,sideways,LWH,\n")
    with pytest.raises(BadLevels, match=r"levels.csv:2: pose: expected one of"):
        frozen_levels(table)
    with pytest.raises(BadLevels, match="expected a table"):
        list(table_rows(tmp_path / "none.csv", ("a",)))


#: Leaves below six synsets in two groups, as WordNet might have them.
PATHS = {f"leaf{n}": ("root", f"realm{n % 2}", f"family{n % 4}", f"kind{n % 8}", f"leaf{n}") for n in range(24)}
SIZES = st.lists(st.floats(1, 9), min_size=24, max_size=24).map(
    lambda values: {f"leaf{n}": np.array([value]) for n, value in enumerate(values)}
)


@given(SIZES, st.floats(0.01, 5), st.randoms())
def test_a_cut_does_not_depend_on_the_order_of_the_input(sizes, price, random):
    shuffled = list(PATHS)
    random.shuffle(shuffled)
    again = cut({leaf: PATHS[leaf] for leaf in shuffled}, {leaf: sizes[leaf] for leaf in shuffled}, {}, price)
    assert again == cut(PATHS, sizes, {}, price)


@given(SIZES)
def test_cuts_for_rising_prices_are_nested_and_explain_less(sizes):
    fine, middle, coarse = nested_cuts(PATHS, sizes, {}, (0.1, 1.0, 10.0))
    for leaf, path in PATHS.items():
        assert path.index(coarse[leaf]) <= path.index(middle[leaf]) <= path.index(fine[leaf])
    shares = [explained(groups, sizes, {}) for groups in (fine, middle, coarse)]
    assert shares == sorted(shares, reverse=True) or np.allclose(shares, sorted(shares, reverse=True))
    assert all(-1e-9 <= share <= 1 + 1e-9 for share in shares)


def test_a_cut_separates_what_differs_in_size_and_not_what_does_not():
    sizes = {leaf: np.array([5.0 if "realm0" in path else 1.0]) for leaf, path in PATHS.items()}
    assert set(cut(PATHS, sizes, {}, 0.5).values()) == {"realm0", "realm1"}


def test_a_familiar_synset_is_preferred_at_equal_separation():
    sizes = {leaf: np.array([0.0]) for leaf in PATHS}
    assert set(cut(PATHS, sizes, {}, 1.0).values()) == {"root"}
    paths = {"a": ("root", "dull", "known", "a"), "b": ("root", "dull", "known", "b")}
    spread = {"a": np.array([0.0]), "b": np.array([0.0])}
    assert set(cut(paths, spread, {"known": 1.0}, 1.0).values()) == {"known"}
