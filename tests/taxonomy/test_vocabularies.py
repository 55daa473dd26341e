"""Label lists: each label means a node of the catalogue, and no trap of the lists' own synsets is fallen for."""

import re

import pytest

import metric_tree
from taxonomy.catalogue import default_catalogue
from taxonomy.label_lists import STUFF, UnknownLabel, labelled_node, vocabularies, vocabulary

NODES = {category.node_id for category in default_catalogue().categories}


@pytest.mark.parametrize("name", vocabularies())
def test_labels_lead_to_nodes_or_say_why_not(name):
    for label in vocabulary(name):
        assert label.node_id is None or label.node_id in NODES, label
        assert label.reason, label


@pytest.mark.parametrize("name", ["coco_80", "nuscenes_det10", "sunrgbd_10", "omni3d_50", "waymo_4", "argoverse2_30"])
def test_detectors_lists_are_complete(name):
    assert [label.label for label in vocabulary(name) if label.node_id is None] == []


@pytest.mark.parametrize(
    ("list_name", "label", "node_id"),
    [
        ("coco_80", "mouse", "mouse.n.04"),
        ("coco_80", "keyboard", "computer_keyboard.n.01"),
        ("coco_80", "chair", "chair.n.01"),
        ("coco_80", "Potted_Plant", "houseplant.n.01"),
        ("openimages_601", "Mouse", "mouse.n.01"),
        ("scannet200", "mattress", "mattress.n.01"),
        ("scannet200", "toilet", "toilet.n.02"),
        ("lvis_v1", "stop_sign", "mt:stop_sign"),
        ("kitti_8", "Car", "car.n.01"),
        ("nuscenes_32", "movable_object.trafficcone", "mt:traffic_cone"),
        ("ade20k_150", "coffee", "coffee_table.n.01"),
        ("ade20k_150", "chest of drawers, chest, bureau, dresser", "chest_of_drawers.n.01"),
        ("ade20k_150", "screen door, screen", "screen.n.04"),
    ],
)
def test_a_label_is_read_as_its_list_means_it(list_name, label, node_id):
    assert labelled_node(label, list_name) == node_id


def test_stuff_needs_no_prior():
    sky = next(label for label in vocabulary("ade20k_150") if label.label == "sky")
    assert not sky.needs_prior
    assert sky.reason == STUFF
    with pytest.raises(UnknownLabel, match="has no size of its own: stuff"):
        labelled_node("sky", "ade20k_150")


def test_void_labels_name_no_object():
    assert [label.label for label in vocabulary("kitti_8") if not label.needs_prior] == ["Misc"]
    assert [x.label for x in vocabulary("nuscenes_32") if x.needs_prior and x.node_id is None] == []


def test_an_id_that_is_gone_gives_way_to_its_successor(tmp_path):
    (tmp_path / "vocabularies").mkdir()
    (tmp_path / "successors.csv").write_text("node_id,successor,reason,reviewer\nmt:old,chair.n.01,r,r\n")
    rows = "list,label,node_id,reason\nl,a,mt:old,name\nl,b,sofa.n.01,name\nl,c,,void\n"
    (tmp_path / "vocabularies" / "l.csv").write_text(rows)
    assert [label.node_id for label in vocabulary("l", tmp_path)] == ["chair.n.01", "sofa.n.01", None]


def test_a_label_without_a_node_is_not_said_to_lack_a_size():
    with pytest.raises(UnknownLabel, match="'gargle' of lvis_v1 names nothing that the tree has a node for; nearest: "):
        labelled_node("gargle", "lvis_v1")


def test_every_label_has_a_node_or_an_unknown_label_with_the_reason_or_suggestions():
    tree, nearest = metric_tree.open(), []
    for name in vocabularies():
        for label in vocabulary(name):
            if label.node_id is not None and tree.has_node(label.node_id):
                continue
            try:
                tree.find(label.label, name)  # a category that the release lacks is the one above it
                continue
            except UnknownLabel as error:
                message = str(error)
            assert " has no size of its own: " in message or "; nearest: " in message or " no category for " in message
            assert not re.search(r"\.n\.\d\d|mt:", message)
            nearest += [message] if "; nearest: " in message else []
    assert len(nearest) > 400


def test_labels_near_an_unknown_one_are_named():
    with pytest.raises(UnknownLabel, match=r"'sofa': no label of coco_80; nearest: couch$"):
        labelled_node("sofa", "coco_80", lambda _: ("sofa.n.01",))
    with pytest.raises(UnknownLabel, match=r"nearest: bow_\(weapon\), bow_\(decorative_ribbons\)$"):
        labelled_node("bow", "lvis_v1")
    with pytest.raises(UnknownLabel, match=r"nearest: bicycle"):
        labelled_node("bicicle", "coco_80")


def test_unknown_names_are_named():
    with pytest.raises(UnknownLabel, match="'unicorn': no label of coco_80"):
        labelled_node("unicorn", "coco_80")
    with pytest.raises(UnknownLabel, match="vocabulary: expected one of ade20k_150"):
        vocabulary("nonesuch")


def test_a_label_without_a_category_in_the_release_is_an_unknown_label_with_suggestions():
    tree, messages = metric_tree.open("3.0.0"), []
    for name in ("things_1854", "matterport_1659", "lvis_v1", "imagenet_1k"):
        labels = [label for label in vocabulary(name) if label.node_id and not tree.has_node(label.node_id)]
        for label in labels[:20]:
            try:
                tree.find(label.label, name)
            except UnknownLabel as error:
                messages.append(str(error))
    assert len(messages) > 20
    assert all(" this release has no category for the label" in text for text in messages)
    assert sum("did you mean" in text for text in messages) > len(messages) / 3
