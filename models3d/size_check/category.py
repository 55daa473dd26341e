"""Determine the category of a model from the texts of its file: title, nodes, meshes, file name, folder, materials."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from metric_base.errors import InputError
from metric_tree.node import Node
from metric_tree.tree import DETECTORS, Tree
from models3d.asset import NameText

#: Weight of a text by its source. Semantic labels are written for programs; a material rarely names the object.
SOURCE_WEIGHT = {
    "semantic": 1.0, "title": 0.9, "file name": 0.85, "robot": 0.85, "model": 0.85, "node": 0.6, "mesh": 0.6, "body":
    0.6, "extras": 0.5, "folder": 0.4, "material": 0.2,
}  # fmt: skip
#: Weight of a text from another source.
OTHER_WEIGHT = 0.3
#: Fraction of its weight that a repeated vote adds, because the names of many nodes are not independent.
REPEATED_FRACTION = 0.1
#: Weight of a category by the way in which the tree resolved the text; 1 for other ways.
RESOLUTION_WEIGHT = {"broader kind": 0.6, "modifier stripped": 0.85}
#: Factor of the weight for each word of a text that is ignored.
DROPPED_WORD_FACTOR = 0.7
#: Minimum fraction of the votes for the category.
MIN_VOTE_FRACTION = 0.55
#: Minimum weight of the strongest vote for the category; a material by itself does not reach it.
MIN_VOTE_WEIGHT = 0.3
#: Maximum number of texts of a file that are read, because files may have a million nodes.
MAX_TEXTS = 60
#: Maximum number of words of a text that are read.
MAX_TEXT_WORDS = 6
#: Maximum number of characters of a text that are read.
MAX_TEXT_CHARS = 120
#: Maximum number of other categories that are listed.
MAX_LISTED = 4

_SPLIT = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Za-z])(?=[0-9])|(?<=[0-9])(?=[A-Za-z])|[^A-Za-zÀ-ÿ0-9]+")
#: Words of files and tools that do not name an object.
_STOP_WORDS = frozenset(
    """
    a an the of and model models mesh meshes geometry geom object obj node root scene group default untitled
    polygon poly low high lowpoly highpoly lod final new old copy export exported asset assets collada dae gltf
    glb usd usda usdc usdz stl ply fbx material mat texture textured collision visual base link body part main
    world armature rig skeleton simplified scan scene0 mtl data files file shape surface residential retail
    bookstore small warehouse aws robomaker sketchfab cube sphere cylinder plane robot urdf sdf mjcf mujoco fixed chain
    """.split()  # noqa: SIM905 - a list of eighty words, one to a line, is a page
)
_MINIATURE = re.compile(
    r"\b(toy|toys|miniature|figurine|scale[ _-]?model|dollhouse|lego|1[:/](6|8|10|12|16|18|24|32|35|43|48|64|72|87))\b",
    re.I,
)


@dataclass(frozen=True, slots=True, eq=False)
class NamedCategory:
    """Category of a model, or the reason why it is unknown."""

    node: Node | None
    #: Source of the strongest text, `stated`, or the reason if `node` is None.
    source: str
    #: Fraction of the votes, 0 to 1.
    fraction: float
    #: True if the node is a broader category than the text.
    is_broader: bool = False
    #: Names of the categories with fewer votes, at most `MAX_LISTED`.
    others: tuple[str, ...] = ()


def named_category(tree: Tree, name: str) -> NamedCategory:
    """Return the category that the user specified by name.

    Raises
    ------
    metric_tree.tree.UnknownName
        No node, or more than one, has the name.
    """
    node = tree.find(name, DETECTORS)
    return NamedCategory(node, "stated", 1.0, tree.resolve(name, DETECTORS).how == "broader kind")


def category_of_texts(texts: Iterable[NameText], tree: Tree) -> NamedCategory:
    """Return the category that most texts of a model file name, or none if they disagree."""
    # 1. Each text votes for a node; repeated votes add little.
    votes: dict[str, float] = {}
    strongest: dict[str, tuple[float, str, bool]] = {}
    for text in list(dict.fromkeys(texts))[:MAX_TEXTS]:
        match = _node_of_text(text.text, tree)
        if match is None:
            continue
        node, weight, is_broader = match
        weight *= SOURCE_WEIGHT.get(text.source, OTHER_WEIGHT)
        smaller, larger = sorted((votes.get(node.node_id, 0.0), weight))
        votes[node.node_id] = larger + REPEATED_FRACTION * smaller
        if weight > strongest.get(node.node_id, (0.0, "", False))[0]:
            strongest[node.node_id] = (weight, text.source, is_broader)
    if not votes:
        return NamedCategory(None, "no text of the file names a category", 0.0)
    # 2. A vote for a broad category is also a vote for its subcategories: "chair" supports "dining chair".
    broader: dict[str, list[str]] = {}
    for node_id in votes:
        node = tree.node(node_id)
        ancestors = {*node.hypernyms, *(above.node_id for above in node.ancestors())}
        broader[node_id] = [other for other in votes if other in ancestors and other != node_id]
    absorbed = {other for others in broader.values() for other in others}
    totals = {k: vote + sum(votes[other] for other in broader[k]) for k, vote in votes.items() if k not in absorbed}
    # 3. The winner needs a majority of the votes and one strong vote.
    ranked = sorted(totals, key=lambda node_id: -totals[node_id])
    names = tuple(tree.node(node_id).name for node_id in ranked)
    fraction = totals[ranked[0]] / sum(totals.values())
    weight, source, is_broader = strongest[ranked[0]]
    if fraction < MIN_VOTE_FRACTION or weight < MIN_VOTE_WEIGHT:
        return NamedCategory(None, "the texts of the file disagree", fraction, others=names[:MAX_LISTED])
    return NamedCategory(tree.node(ranked[0]), source, fraction, is_broader, names[1 : MAX_LISTED + 1])


def is_miniature(texts: Iterable[NameText]) -> bool:
    """Return True if a text contains toy, miniature or a similar word, or the scale of a model, such as 1:24."""
    return any(_MINIATURE.search(text.text.replace("_", " ")) for text in texts)


def _node_of_text(text: str, tree: Tree) -> tuple[Node, float, bool] | None:
    """Return the node of the longest phrase of a text, its weight, and whether it is a broader category."""
    parts = [part for part in _SPLIT.split(text[:MAX_TEXT_CHARS]) if part]
    words = [part.lower() for part in parts if len(part) > 1 and not part.isdigit() and part.lower() not in _STOP_WORDS]
    words = words[-MAX_TEXT_WORDS:]
    for n_dropped in range(len(words)):
        for start in range(n_dropped, -1, -1):  # of phrases with equal length, the last one first
            phrase = " ".join(words[start : start + len(words) - n_dropped])
            try:
                match = tree.resolve(phrase, DETECTORS, advice=False)
            except InputError:
                continue
            if match.ambiguous:
                return None
            weight = RESOLUTION_WEIGHT.get(match.how, 1.0) * DROPPED_WORD_FACTOR**n_dropped
            return match.node, weight, match.how == "broader kind"
    return None
