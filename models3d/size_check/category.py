"""What a file of a model shows, by its own words: title, nodes, meshes, file name, folder, materials."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from metric_base.errors import InputError
from metric_tree.node import Node
from metric_tree.tree import DETECTORS, Tree
from models3d.asset import NameText

#: How much a text counts, by where it is from: a semantic label is made to be read, a material rarely names the object.
SOURCE_WEIGHT = {
    "semantic": 1.0, "title": 0.9, "file name": 0.85, "robot": 0.85, "model": 0.85, "node": 0.6, "mesh": 0.6, "body":
    0.6, "extras": 0.5, "folder": 0.4, "material": 0.2,
}  # fmt: skip
OTHER_WEIGHT = 0.3
#: A second text that says the same adds this share of its weight: a hundred nodes are not a hundred opinions.
REPEATED_SHARE = 0.1
#: How far the tree's answer is to be believed, by how it was reached.
ANSWER_WEIGHT = {"broader kind": 0.6, "modifier stripped": 0.85}
#: Each word of a text that is left out at its beginning takes this share of its weight.
DROPPED_WEIGHT = 0.7
#: Least share of all weights for the category to be taken, and least weight: one material is no answer.
MIN_SHARE, MIN_WEIGHT = 0.55, 0.3
#: Texts of a file that are read, and words of a text: files with a million nodes are not read to the end.
MAX_TEXTS, MAX_TEXT_WORDS, MAX_TEXT_CHARS = 60, 6, 120
#: As many other readings as a doubtful answer lists.
LISTED = 4

_SPLIT = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Za-z])(?=[0-9])|(?<=[0-9])(?=[A-Za-z])|[^A-Za-zÀ-ÿ0-9]+")
#: Words of files and tools that name no object.
_EMPTY = frozenset(
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
    """A node, or None where the words do not say; how sure, where it is from, and the other readings."""

    node: Node | None
    source: str
    share: float
    is_broader: bool = False
    others: tuple[str, ...] = ()


def named_category(tree: Tree, name: str) -> NamedCategory:
    """The category that a person names.

    Raises
    ------
    metric_tree.tree.UnknownName
        No node has the name, or several have.
    """
    node = tree.find(name, DETECTORS)
    return NamedCategory(node, "stated", 1.0, tree.resolve(name, DETECTORS).how == "broader kind")


def category_of_words(words: Iterable[NameText], tree: Tree) -> NamedCategory:
    """The category that most of the words name, if they agree."""
    votes: dict[str, float] = {}
    best: dict[str, tuple[float, str, bool]] = {}
    for word in list(dict.fromkeys(words))[:MAX_TEXTS]:
        answer = _answer(word.text, tree)
        if answer is None:
            continue
        node, weight, broader = answer
        weight *= SOURCE_WEIGHT.get(word.source, OTHER_WEIGHT)
        first, second = sorted((votes.get(node.node_id, 0.0), weight))
        votes[node.node_id] = second + REPEATED_SHARE * first
        if weight > best.get(node.node_id, (0.0, "", False))[0]:
            best[node.node_id] = (weight, word.source, broader)
    return _winner(votes, best, tree)


def is_miniature(words: Iterable[NameText]) -> bool:
    """Whether the words call the object a toy or a miniature, or state a scale of models."""
    return any(_MINIATURE.search(word.text.replace("_", " ")) for word in words)


def _winner(votes: dict[str, float], best: dict[str, tuple[float, str, bool]], tree: Tree) -> NamedCategory:
    if not votes:
        return NamedCategory(None, "no word of the file names a category", 0.0)
    votes = _with_kin(votes, tree)
    total = sum(votes.values())
    ranked = sorted(votes, key=lambda node_id: -votes[node_id])
    first = ranked[0]
    share = votes[first] / total
    others = tuple(tree.node(node_id).name for node_id in ranked[1 : LISTED + 1])
    weight, source, broader = best[first]
    if share < MIN_SHARE or weight < MIN_WEIGHT:
        return NamedCategory(None, "its words do not agree", share, others=(tree.node(first).name, *others)[:LISTED])
    return NamedCategory(tree.node(first), source, share, broader, others)


def _answer(text: str, tree: Tree) -> tuple[Node, float, bool] | None:
    """The node of a text, how much the answer counts, and whether it is a broader kind."""
    parts = [part for part in _SPLIT.split(text[:MAX_TEXT_CHARS]) if part]
    words = [part.lower() for part in parts if len(part) > 1 and not part.isdigit() and part.lower() not in _EMPTY]
    words = words[-MAX_TEXT_WORDS:]
    for phrase, dropped in _phrases(words):
        try:
            meaning = tree.resolve(phrase, DETECTORS, advice=False)
        except InputError:
            continue
        if meaning.ambiguous:
            return None
        weight = ANSWER_WEIGHT.get(meaning.how, 1.0) * DROPPED_WEIGHT**dropped
        return meaning.node, weight, meaning.how == "broader kind"
    return None


def _phrases(words: list[str]) -> Iterator[tuple[str, int]]:
    """Runs of words, the longest first, of these the last first, with how many words each leaves out."""
    for dropped in range(len(words)):
        for start in range(dropped, -1, -1):
            yield " ".join(words[start : start + len(words) - dropped]), dropped


def _with_kin(votes: dict[str, float], tree: Tree) -> dict[str, float]:
    """The votes, those of a kind added to the kinds of it that have votes too: a dining chair is a chair."""
    above = {node_id: {*tree.node(node_id).hypernyms, *_parents(tree.node(node_id))} for node_id in votes}
    general = {kind for node_id in votes for kind in above[node_id] if kind in votes and kind != node_id}
    return {
        node_id: vote + sum(votes[kind] for kind in above[node_id] if kind in votes and kind != node_id)
        for node_id, vote in votes.items()
        if node_id not in general
    }


def _parents(node: Node) -> Iterator[str]:
    while node.parent is not None:
        node = node.parent
        yield node.node_id
