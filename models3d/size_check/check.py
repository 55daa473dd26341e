"""Check whether the objects of a 3-D model file have their true size, or a wrong unit, scale or orientation.

The result has a verdict, its probability and the correction factor.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any, Literal

from metric_tree.axes import AXES
from metric_tree.node import Node
from metric_tree.tree import Tree, open_tree
from models3d.asset import Asset, AssetBody, Up, merge_bodies
from models3d.formats import read_asset
from models3d.size_check.category import NamedCategory, category_of_texts, is_miniature, named_category
from models3d.size_check.hypotheses import CHANCE, NAMED_MINIATURE, TOY_CHANCE, ScaleHypothesis, ScaleKind, hypotheses
from models3d.size_check.size_model import extents_text, node_model
from models3d.size_check.true_size import TrueSize, true_size

SCHEMA = "metric-tree/asset/1"
Verdict = Literal["right", "wrong unit", "arbitrary scale", "turned", "stretched", "miniature", "not known"]
#: Minimum probability that the scale is wrong, summed over all wrong scales, for such a verdict. It was chosen on half
#: of the categories so that fewer than one correct model in thirty has this verdict (docs/evidence/model-sizes.md).
MIN_WRONG = 0.6
#: Minimum probability of another orientation for the verdict `turned`. It is high because an open laptop or a book on
#: edge has the extents of a turned object, although its size is right.
MIN_ROTATED = 0.8
#: Minimum probability of a stretched side for the verdict `stretched`. Thin objects and open lids are not stretched.
MIN_STRETCHED = 0.95
#: Categories of which toys are common.
TOY_CATEGORIES = frozenset({"vehicle.n.01", "animal.n.01", "craft.n.02"})
#: Maximum number of objects of a scene that are compared with each other.
MAX_OBJECTS = 200
#: Minimum probability of a hypothesis in the JSON record.
MIN_LISTED_PROBABILITY = 0.01
VERDICTS: dict[ScaleKind, Verdict] = {
    "right": "right", "unit": "wrong unit", "arbitrary": "arbitrary scale", "miniature": "miniature",
    "stretched": "stretched", "unlike": "not known",
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class AssetCheck:
    """Verdict on one object of a file."""

    file: str
    #: Name of the object.
    body: str
    category: NamedCategory
    #: Evidence tier of the sizes of the category.
    tier: str | None
    #: Extents along x, y, z in metres according to the file.
    extents_m: tuple[float, float, float]
    verdict: Verdict
    #: Factor that corrects the size; None if the size is not wrong, or the factor is unknown.
    factor: float | None
    #: Probability of the verdict.
    probability: float
    #: All explanations of the extents, sorted by probability.
    hypotheses: tuple[ScaleHypothesis, ...]
    #: Posterior of the true size, whatever the verdict is.
    true_size: TrueSize | None
    up: Up | None = None
    #: Reason why there is no verdict.
    reason: str | None = None

    @property
    def is_wrong(self) -> bool:
        """True if the verdict is an error of scale or orientation."""
        return self.verdict not in ("right", "not known")

    def to_json(self) -> dict[str, Any]:
        """Return the record of `metric-tree/asset/1`."""
        listed = []
        for hypothesis in self.hypotheses:
            if hypothesis.probability < MIN_LISTED_PROBABILITY:
                continue
            record: dict[str, Any] = {
                "what": hypothesis.kind,
                "factor": hypothesis.factor,
                "up": hypothesis.up,
                "probability": round(hypothesis.probability, 4),
            }
            if hypothesis.axis is not None:
                record["axis"] = AXES[hypothesis.axis]
            listed.append(record)
        height = self.true_size.height_m if self.true_size else None
        return {
            "schema": SCHEMA,
            "file": self.file,
            "body": self.body,
            "category": self.category.node.node_id if self.category.node else None,
            "category_from": self.category.source,
            "category_share": round(self.category.fraction, 3),
            "others": list(self.category.others),
            "tier": self.tier,
            "extents_m": [float(f"{extent:.6g}") for extent in self.extents_m],
            "verdict": self.verdict,
            "factor": None if self.factor is None else float(f"{self.factor:.6g}"),
            "probability": round(self.probability, 4),
            "hypotheses": listed,
            "true_height_m": None if height is None else dict(zip(("low", "median", "high"), height, strict=True)),
            "reason": self.reason,
        }


def check_asset(path: Path | str, category: str | None = None, tree: Tree | None = None) -> tuple[AssetCheck, ...]:
    """Check whether the objects of a model file have their true size.

    Parameters
    ----------
    path : Path or str
        File in one of the formats of `models3d.formats.SUFFIXES`.
    category : str, optional
        Category of the model; by default, the texts of the file determine it.
    tree : Tree, optional
        By default, the shipped release.

    Returns
    -------
    tuple of AssetCheck
        One verdict per object. With `category`, the file is one object.

    Raises
    ------
    InputError
        The file cannot be read, or `category` is not a name of the tree.

    Examples
    --------
    >>> import models3d
    >>> (check,) = models3d.check_asset("data/models/rocking_horse.glb", category="rocking horse")
    >>> check.verdict
    'right'
    """
    return check_bodies(read_asset(Path(path)), tree or open_tree(), category)


def check_bodies(asset: Asset, tree: Tree, category: str | None = None) -> tuple[AssetCheck, ...]:
    """Check each object of a file; with `category`, the file is one object of this category.

    Raises
    ------
    metric_tree.tree.UnknownName
        `category` is not a name of the tree.
    """
    bodies: tuple[AssetBody, ...] = (merge_bodies(asset.bodies, asset.file.stem),)
    if category is not None:
        categories = [named_category(tree, category)]
    else:
        # The bodies are separate objects if each has a known category and they do not overlap.
        if len(asset.bodies) > 1 and None not in [category_of_texts(body.texts, tree).node for body in asset.bodies]:
            pairs = combinations(asset.bodies[:MAX_OBJECTS], 2)
            bodies = bodies if any(body.overlaps(other) for body, other in pairs) else asset.bodies
        categories = [category_of_texts((*body.texts, *asset.texts), tree) for body in bodies]
    return tuple(
        check_body(str(asset.file), body, asset, tree, body_category)
        for body, body_category in zip(bodies, categories, strict=True)
    )


def check_body(file: str, body: AssetBody, asset: Asset, tree: Tree, category: NamedCategory) -> AssetCheck:
    """Check an object of a file, which has this category."""
    x, y, z = (float(extent) for extent in body.extents_m)
    extents, node = (x, y, z), category.node
    tier = None if node is None else node.tier
    model = None if node is None else node_model(tree, node.node_id, category.is_broader)
    reason = None
    if node is None:
        candidates = f" ({', '.join(category.others)}?)" if category.others else ""
        reason = f"{category.source}{candidates}; specify it with --category"
    elif not max(extents) > 0:
        reason = "it has no extent"
    elif model is None:
        reason = f"no size of {node.name} is known"
    if node is None or model is None or reason is not None:
        return AssetCheck(file, body.name, category, tier, extents, "not known", None, 0.0, (), None, asset.up, reason)
    is_named = is_miniature((*body.texts, *asset.texts))
    explanations = hypotheses(body, asset.up, model, NAMED_MINIATURE if is_named else miniature_chance(node))
    verdict, factor, probability = verdict_of(explanations)
    size = true_size(body, asset.up, model)
    return AssetCheck(
        file, body.name, category, tier, extents, verdict, factor, probability, explanations, size, asset.up
    )


def miniature_chance(node: Node) -> float:
    """Return the prior probability that a model of a category is a miniature."""
    return TOY_CHANCE if TOY_CATEGORIES & {node.node_id, *node.hypernyms} else CHANCE["miniature"]


def verdict_of(explanations: Sequence[ScaleHypothesis]) -> tuple[Verdict, float | None, float]:
    """Return verdict, factor and probability from the posterior of all hypotheses."""
    by_factor: dict[tuple[ScaleKind, float | None], float] = defaultdict(float)
    for hypothesis in explanations:
        by_factor[hypothesis.kind, hypothesis.factor] += hypothesis.probability
    by_kind: dict[ScaleKind, float] = defaultdict(float)
    for (kind, _), probability in by_factor.items():
        by_kind[kind] += probability
    rotated = sum(row.probability for row in explanations if row.kind == "right" and row.is_rotated)
    wrong = 1 - by_kind["right"] - by_kind["unlike"]
    likeliest = max((kind for kind in by_kind if kind not in ("right", "unlike")), key=lambda kind: by_kind[kind])
    if wrong >= MIN_WRONG and (likeliest != "stretched" or by_kind[likeliest] >= MIN_STRETCHED):
        factors = [factor for kind, factor in by_factor if kind == likeliest]
        return VERDICTS[likeliest], max(factors, key=lambda factor: by_factor[(likeliest, factor)]), by_kind[likeliest]
    if rotated >= MIN_ROTATED:
        return "turned", None, rotated
    if by_kind["right"] >= max(by_kind["unlike"], wrong):
        return "right", 1.0, by_kind["right"]
    return "not known", None, max(by_kind["unlike"], wrong)


def verdict_line(check: AssetCheck) -> str:
    """Return the verdict in one line, with the category and the extents according to the file."""
    size = extents_text(check.extents_m)
    if check.category.node is None or check.reason:
        return f"{check.verdict}: {size}; {check.reason}"
    category = f"{check.category.node.name} (from {check.category.source}, {check.tier or 'tier not stated'})"
    if check.verdict == "right":
        return f"right (p = {check.probability:.2f}): {category}, {size}"
    height = check.true_size.height_m if check.true_size else None
    typical = f"; such objects are {height[0]:.3g} to {height[2]:.3g} m high" if height else ""
    factor = f"x {check.factor:.4g}, " if check.factor is not None else ""
    return f"{check.verdict} ({factor}p = {check.probability:.2f}): {category}, {size}{typical}"
