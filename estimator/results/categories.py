"""What a category name means in the tree, read as detectors mean it: a `mouse` is a device."""

from __future__ import annotations

from dataclasses import dataclass

from metric_base.faults import InputFault
from metric_tree.prior import Prior
from metric_tree.tree import Node, Tree
from taxonomy.label_lists import label_of

__all__ = ["DETECTOR_LISTS", "Meaning", "meanings"]

#: Label lists in the order in which a name is looked up: the most used detectors first.
DETECTOR_LISTS = (
    "coco_80",
    "lvis_v1",
    "openimages_601",
    "objects365_v2",
    "ade20k_150",
    "scannet200",
    "omni3d_50",
    "sunrgbd_10",
    "nuscenes_32",
    "kitti_8",
    "cityscapes_35",
    "waymo_4",
    "argoverse2_30",
    "mapillary_vistas_66",
    "things_1854",
    "matterport_1659",
    "imagenet_1k",
)


@dataclass(frozen=True, slots=True, eq=False)
class Meaning:
    """The node of a category name and its prior, or the reason why there is none."""

    node: Node | None
    prior: Prior | None
    reason: str | None = None


def meanings(tree: Tree, names: set[str], dims: tuple[str, ...] | None = None) -> dict[str, Meaning]:
    """What each name means. With `dims` the prior is over these alone, else over the node's own.

    A name that no node bears, or several alike, or a node without such a prior, has a reason instead: it is listed,
    not fatal.
    """
    return {name: _meaning(tree, name, dims) for name in sorted(names)}


def _meaning(tree: Tree, name: str, dims: tuple[str, ...] | None) -> Meaning:
    try:
        node = _node(tree, name)
    except InputFault as fault:
        return Meaning(None, None, str(fault))
    try:
        return Meaning(node, node.prior(dims))
    except InputFault as fault:
        return Meaning(node, None, str(fault))


def _node(tree: Tree, name: str) -> Node:
    for vocabulary in DETECTOR_LISTS:
        try:
            label = label_of(name, vocabulary)
            if label is not None and label.node_id is not None:
                return tree.node(label.node_id)
        except InputFault:  # the list is not at hand, or the node is not in this release
            continue
    return tree.find(name)
