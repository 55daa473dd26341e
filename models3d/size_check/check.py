"""Whether a model is at true size: the verdict on each body of a file, with its probability and the reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any, Literal

from metric_tree.node import Node
from metric_tree.tree import Tree, open_tree
from models3d.asset import Asset, AssetBody, NameText, Up, merge_bodies
from models3d.formats import read_asset
from models3d.size_check.category import NamedCategory, category_of_words, is_miniature, named_category
from models3d.size_check.hypotheses import CHANCE, NAMED_MINIATURE, TOY_CHANCE, ScaleHypothesis, ScaleKind, hypotheses
from models3d.size_check.size_model import extents_text, node_model, node_tier
from models3d.size_check.true_size import TrueSize, true_size

SCHEMA = "metric-tree/asset/1"
Verdict = Literal["right", "wrong unit", "arbitrary scale", "turned", "stretched", "miniature", "not known"]
#: An object is called wrong from this probability of all that is wrong with a scale. On the half of the categories
#: that chose it, fewer than one right model in thirty is called wrong (docs/evidence/assets.md).
MIN_WRONG = 0.6
#: The same of an object that only lies on another side: an open laptop or a book on its edge is not wrong in size.
MIN_TURNED = 0.8
#: The same of one stretched side: thin objects and open lids are not stretched.
MIN_STRETCHED = 0.95
#: Kinds of which toys are common.
TOY_KINDS = frozenset({"vehicle.n.01", "animal.n.01", "craft.n.02"})
#: Bodies of a scene that are compared with each other.
MAX_OBJECTS = 200
#: Hypotheses of less probability are not listed.
LISTED_PROBABILITY = 0.01
VERDICTS: dict[ScaleKind, Verdict] = {
    "right": "right", "unit": "wrong unit", "arbitrary": "arbitrary scale", "miniature": "miniature",
    "stretched": "stretched", "unlike": "not known",
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class AssetCheck:
    """What is said of one body.

    file, body : which; category : its node and where that is from; tier : what the node's sizes rest on; extents_m :
    (3,) x, y, z as stated; verdict, factor, probability : what is wrong, what the stated size is to be multiplied by
    (None: nothing, or not known), and how sure; true_size : the object's size at its likeliest scale; reason : where
    nothing can be said.
    """

    file: str
    body: str
    category: NamedCategory
    tier: str | None
    extents_m: tuple[float, float, float]
    verdict: Verdict
    factor: float | None
    probability: float
    hypotheses: tuple[ScaleHypothesis, ...]
    true_size: TrueSize | None
    up: Up | None = None
    reason: str | None = None

    @property
    def is_wrong(self) -> bool:
        """Whether the file should be mended."""
        return self.verdict not in ("right", "not known")

    def to_json(self) -> dict[str, Any]:
        """The record of `metric-tree/asset/1`."""
        listed = [one for one in self.hypotheses if one.probability >= LISTED_PROBABILITY]
        height = self.true_size.height_m if self.true_size else None
        return {
            "schema": SCHEMA,
            "file": self.file,
            "body": self.body,
            "category": self.category.node.node_id if self.category.node else None,
            "category_from": self.category.source,
            "category_share": round(self.category.share, 3),
            "others": list(self.category.others),
            "tier": self.tier,
            "extents_m": [float(f"{extent:.6g}") for extent in self.extents_m],
            "verdict": self.verdict,
            "factor": None if self.factor is None else float(f"{self.factor:.6g}"),
            "probability": round(self.probability, 4),
            "hypotheses": [_hypothesis_json(one) for one in listed],
            "true_height_m": None if height is None else dict(zip(("low", "median", "high"), height, strict=True)),
            "reason": self.reason,
        }


def check_asset(path: Path | str, category: str | None = None, tree: Tree | None = None) -> tuple[AssetCheck, ...]:
    """Whether the objects of a model's file are at true size; `tree` is the shipped one by default.

    Raises
    ------
    InputError
        The file cannot be read, or `category` is no name of the tree.

    >>> import models3d
    >>> (check,) = models3d.check_asset("data/models/rocking_horse.glb", category="rocking horse")
    >>> check.verdict
    'right'
    """
    return check_bodies(read_asset(Path(path)), tree or open_tree(), category)


def check_bodies(asset: Asset, tree: Tree, category: str | None = None) -> tuple[AssetCheck, ...]:
    """The verdict on each body of a file; `category` names what they all are.

    Raises
    ------
    metric_tree.tree.UnknownName
        `category` is no name of the tree.
    """
    named = named_category(tree, category) if category is not None else None
    bodies = _objects(asset, tree) if named is None else (merge_bodies(asset.bodies, asset.file.stem),)
    return tuple(
        check_body(str(asset.file), body, asset, tree, named or category_of_words((*body.words, *asset.words), tree))
        for body in bodies
    )


def _objects(asset: Asset, tree: Tree) -> tuple[AssetBody, ...]:
    """The objects of a file: its bodies, if each names a category of its own and none is inside another; else one."""
    bodies = asset.bodies
    if len(bodies) > 1:
        nodes = [category_of_words(body.words, tree).node for body in bodies]
        apart = all(not one.overlaps(other) for one, other in combinations(bodies[:MAX_OBJECTS], 2))
        if None not in nodes and apart:
            return bodies
    return (merge_bodies(bodies, asset.file.stem),)


def check_body(file: str, body: AssetBody, asset: Asset, tree: Tree, category: NamedCategory) -> AssetCheck:
    """The verdict on one body as an object of a category."""
    x, y, z = (float(extent) for extent in body.extents_m)
    extents = (x, y, z)
    tier = None if category.node is None else node_tier(category.node)

    def unknown(reason: str) -> AssetCheck:
        return AssetCheck(file, body.name, category, tier, extents, "not known", None, 0.0, (), None, asset.up, reason)

    if category.node is None:
        meant = f" ({', '.join(category.others)}?)" if category.others else ""
        return unknown(f"{category.source}{meant}; name it with --category")
    if not max(extents) > 0:
        return unknown("it has no extent")
    model = node_model(tree, category.node.node_id, category.is_broader)
    if model is None:
        return unknown(f"no size of {category.node.name} is known")
    explanations = hypotheses(body, asset.up, model, _miniature_chance((*body.words, *asset.words), category.node))
    verdict, factor, probability = _verdict(explanations)
    size = true_size(body, asset.up, model)
    return AssetCheck(
        file, body.name, category, tier, extents, verdict, factor, probability, explanations, size, asset.up
    )


def _miniature_chance(words: Sequence[NameText], node: Node) -> float:
    if is_miniature(words):
        return NAMED_MINIATURE
    return TOY_CHANCE if TOY_KINDS & {node.node_id, *node.hypernyms} else CHANCE["miniature"]


def _verdict(explanations: Sequence[ScaleHypothesis]) -> tuple[Verdict, float | None, float]:
    """The verdict, its factor and its probability, from the posterior of all hypotheses."""
    chance: dict[tuple[ScaleKind, float | None], float] = {}
    for one in explanations:
        key = (one.what, one.factor)
        chance[key] = chance.get(key, 0.0) + one.probability
    kinds: dict[ScaleKind, float] = {}
    for (what, _), share in chance.items():
        kinds[what] = kinds.get(what, 0.0) + share
    turned = sum(one.probability for one in explanations if one.what == "right" and one.turned)
    wrong = 1 - kinds["right"] - kinds["unlike"]
    worst = max((what for what in kinds if what not in ("right", "unlike")), key=lambda what: kinds[what])
    if wrong >= MIN_WRONG and (worst != "stretched" or kinds[worst] >= MIN_STRETCHED):
        factor = max((key[1] or 0.0 for key in chance if key[0] == worst), key=lambda one: chance[(worst, one or None)])
        return VERDICTS[worst], factor or None, kinds[worst]
    if turned >= MIN_TURNED:
        return "turned", None, turned
    if kinds["right"] >= max(kinds["unlike"], wrong):
        return "right", 1.0, kinds["right"]
    return "not known", None, max(kinds["unlike"], wrong)


def _hypothesis_json(one: ScaleHypothesis) -> dict[str, Any]:
    row: dict[str, Any] = {
        "what": one.what,
        "factor": one.factor,
        "up": one.up,
        "probability": round(one.probability, 4),
    }
    return row if one.axis is None else {**row, "axis": ("length", "width", "height")[one.axis]}


def verdict_line(check: AssetCheck) -> str:
    """One line for a person: the verdict, what the object is taken for, and its size as stated."""
    size = extents_text(check.extents_m)
    if check.category.node is None or check.reason:
        return f"{check.verdict}: {size}; {check.reason}"
    what = f"{check.category.node.name} (from {check.category.source}, {check.tier or 'tier not stated'})"
    if check.verdict == "right":
        return f"right (p = {check.probability:.2f}): {what}, {size}"
    height = check.true_size.height_m if check.true_size else None
    likely = f"; such objects are {height[0]:.3g} to {height[2]:.3g} m high" if height else ""
    times = f"x {check.factor:.4g}, " if check.factor is not None else ""
    return f"{check.verdict} ({times}p = {check.probability:.2f}): {what}, {size}{likely}"
