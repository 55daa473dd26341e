"""The shipped catalogue, read whole: five levels, no orphan, no name twice, each place as rule or reader states."""

from collections import Counter

import pytest

from taxonomy.catalogue import OTHER, Catalogue, Leaf, SynsetTable, default_catalogue
from taxonomy.levels import BadLevels, InnerNode, Levels

CATALOGUE = default_catalogue()
CATEGORIES = CATALOGUE.categories
BY_ID = {category.node_id: category for category in CATEGORIES}


def test_every_path_has_five_nodes_and_leads_from_the_root():
    assert [c.node_id for c in CATEGORIES if c.parent_id is None] == ["entity.n.01"]
    for category in CATEGORIES:
        assert len(category.path) == category.level
        if category.parent_id is not None:
            assert BY_ID[category.parent_id].path == category.path[:-1]


def test_parents_stand_before_children():
    seen = {None}
    for category in CATEGORIES:
        assert category.parent_id in seen
        seen.add(category.node_id)


def test_no_id_and_no_name_of_a_leaf_occurs_twice():
    assert not [i for i, count in Counter(c.node_id for c in CATEGORIES).items() if count > 1]
    assert not [n for n, count in Counter(c.name.casefold() for c in CATEGORIES if c.level == 5).items() if count > 1]


def test_no_inner_node_is_barren_and_few_have_a_single_child():
    children = Counter(c.parent_id for c in CATEGORIES)
    inner = [c for c in CATEGORIES if c.level < 5]
    assert all(children[c.node_id] for c in inner)
    assert [c.node_id for c in inner if c.level < 4 and children[c.node_id] == 1] == []


def test_every_leaf_that_the_rule_placed_is_where_the_rule_puts_it():
    for leaf in CATALOGUE.leaves.values():
        if leaf.placed_by == "rule" and leaf.hypernym is None:
            synsets = (leaf.node_id, *BY_ID[leaf.node_id].hypernyms)
            claimants = (CATALOGUE.levels.claimant.get(synset) for synset in synsets)
            assert next(kind for kind in claimants if kind is not None) == leaf.parent_id, leaf


def test_successors_lead_to_a_node():
    for gone, successor in CATALOGUE.successors.items():
        assert gone not in BY_ID
        assert successor in BY_ID, gone


@pytest.mark.parametrize(
    ("concept", "leaf"),
    [
        ("swivel_chair.n.01", "swivel_chair.n.01"),
        ("chair.n.01", "chair.n.01" + OTHER),
        ("dog.n.01", "dog.n.01" + OTHER),
        ("bowl.n.01", "bowl.n.03" + OTHER),
        ("mt:dog_other", "dog.n.01" + OTHER),
        ("furniture.n.01", None),
        ("gravity.n.01", None),
    ],
)
def test_a_concept_has_the_leaf_that_a_reader_expects(concept, leaf):
    assert CATALOGUE.leaf_of(concept) == leaf


@pytest.mark.parametrize(
    ("node_id", "pose", "dims"),
    [
        ("person.n.01", "upright", ("height",)),
        ("computer_keyboard.n.01", "flat", ("length", "width")),
        ("chair.n.01", "upright", ("length", "width", "height")),
        ("car.n.01", "upright", ("length", "width", "height")),
        ("book.n.02", "flat", ("length", "width")),
        ("tennis_ball.n.01", "any", ("length", "width", "height")),
        ("oak.n.02", "upright", ("height",)),
    ],
)
def test_pose_and_default_dimensions(node_id, pose, dims):
    assert (BY_ID[node_id].pose, BY_ID[node_id].dims) == (pose, dims)


def test_what_lies_flat_is_told_by_its_plan():
    """Length and height are the two sides of a hanging object; the height of a flat object is its thickness."""
    hung = [c.node_id for c in BY_ID.values() if c.pose == "flat" and "height" in c.dims and len(c.dims) == 2]
    assert hung == []


def test_detectors_words_are_aliases():
    assert "cell phone" in BY_ID["cellular_telephone.n.01"].aliases
    assert "wine glass" in BY_ID["wineglass.n.01"].aliases


LEVELS = Levels(
    InnerNode(node_id=i, name=i, level=n, parent_id=p, pose="upright", dims=("height",), claims=c)
    for i, n, p, c in [
        ("entity.n.01", 1, None, ()),
        ("furniture.n.01", 2, "entity.n.01", ()),
        ("seat.n.03", 3, "furniture.n.01", ()),
        ("chair.n.01", 4, "seat.n.03", ("chair.n.01",)),
    ]
)
WORDS = SynsetTable(
    {"chair.n.01": ("seat.n.03",), "seat.n.03": ("furniture.n.01",), "throne.n.01": ("chair.n.01",)},
    {"throne.n.01": ("throne",)},
)


def test_leaves_of_one_name_say_what_kind_of_object_they_are():
    leaves = (
        Leaf(node_id="mt:a", name="swing", parent_id="chair.n.01"),
        Leaf(node_id="mt:b", name="swing (chair)", parent_id="chair.n.01"),
        Leaf(node_id="mt:c", name="Swing", parent_id="chair.n.01"),
    )
    names = [c.name for c in Catalogue(LEVELS, leaves, WORDS).categories if c.level == 5]
    assert names[0] == "swing (chair.n.01)"
    assert names[1] == "swing (chair)"


def test_a_leaf_under_no_kind_is_refused():
    with pytest.raises(BadLevels, match="expected a new id under a kind"):
        Catalogue(LEVELS, [Leaf(node_id="mt:a", name="a", parent_id="seat.n.03")], WORDS)
