"""What the reviewed label lists of detectors say about a word, weighed by how much a list is used."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from functools import cache

from taxonomy.label_lists import vocabularies, vocabulary
from taxonomy.naming.spelling import plain_fold

__all__ = ["DETECTOR_LISTS", "LABEL_WEIGHT", "LABEL_WEIGHT_ELSEWHERE", "label_votes", "listed_nodes"]

#: Label lists in the order in which a detector's word is looked up: the most used detectors first.
DETECTOR_LISTS = (
    "coco_80", "lvis_v1", "openimages_601", "objects365_v2", "ade20k_150", "scannet200", "omni3d_50", "sunrgbd_10",
    "nuscenes_32", "kitti_8", "cityscapes_35", "waymo_4", "argoverse2_30", "mapillary_vistas_66", "things_1854",
    "matterport_1659", "imagenet_1k",
)  # fmt: skip

#: Weight of a list's word; the four lists that most detectors are trained on, and any other.
LABEL_WEIGHT = {"coco_80": 3.0, "lvis_v1": 2.0, "openimages_601": 2.0, "objects365_v2": 2.0}
LABEL_WEIGHT_ELSEWHERE = 0.7


def label_votes(form: str) -> Mapping[str, float]:
    """Weight by node of a folded word."""
    return _votes().get(form, {})


def listed_nodes(text: str) -> tuple[str, ...]:
    """The nodes of a detector's label, that of the most used list first."""
    return tuple(_votes().get(plain_fold(text), {}))


@cache
def _votes() -> Mapping[str, dict[str, float]]:
    votes: defaultdict[str, dict[str, float]] = defaultdict(dict)
    disputed: set[str] = set()
    there = set(vocabularies())
    for name in (one for one in DETECTOR_LISTS if one in there):
        nodes = _nodes(name)
        disputed |= {form for form, meant in nodes.items() if len(meant) > 1}
        for form, meant in nodes.items():
            for node_id in sorted(meant):
                votes[form][node_id] = votes[form].get(node_id, 0.0) + LABEL_WEIGHT.get(name, LABEL_WEIGHT_ELSEWHERE)
    for form in disputed - _clear_words():
        votes[form] = dict.fromkeys(votes[form], LABEL_WEIGHT_ELSEWHERE)
    return dict(votes)


def _clear_words() -> set[str]:
    """Words of the two lists whose labels were chosen to be clear."""
    return {form for name in DETECTOR_LISTS[:2] for form in _nodes(name)}


@cache
def _nodes(name: str) -> Mapping[str, frozenset[str]]:
    """Nodes of each folded word of a list; two where it has the word twice and means two things (ImageNet's crane)."""
    nodes: defaultdict[str, set[str]] = defaultdict(set)
    if name in vocabularies():
        for label in vocabulary(name):
            if label.node_id is not None:
                nodes[plain_fold(label.label)].add(label.node_id)
    return {form: frozenset(meant) for form, meant in nodes.items()}
