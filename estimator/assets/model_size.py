"""The true size of a model's file whose category is known."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from estimator.assets.true_size import LEVEL, factor_of_bodies, true_size
from metric_base.errors import InputError
from metric_tree.tree import Tree
from models3d.asset import AXES, joined_body
from models3d.formats import read_asset, read_boxes
from models3d.size_check.category import category_of_words, named_category
from models3d.size_check.check import extents_text, node_model, node_tier

__all__ = ["ModelSize", "boxes_true_size", "model_true_size"]


@dataclass(frozen=True, slots=True)
class ModelSize:
    """What the stated size is to be multiplied by, and the height in metres: low, median, high; and the reason."""

    file: str
    category: str
    tier: str | None
    factor: tuple[float, float, float]
    height_m: tuple[float, float, float]
    reason: str

    def to_json(self) -> dict[str, Any]:
        """The record of the command."""
        names = ("low", "median", "high")
        return {
            "schema": "metric-tree/true-size/1",
            "file": self.file,
            "category": self.category,
            "tier": self.tier,
            "level": LEVEL,
            "factor": dict(zip(names, (float(f"{one:.6g}") for one in self.factor), strict=True)),
            "true_height_m": dict(zip(names, self.height_m, strict=True)),
            "reason": self.reason,
        }


def model_true_size(path: Path, category: str, tree: Tree) -> ModelSize:
    """The true size of a model as an object of a category, from its proportions and the category's sizes.

    Raises
    ------
    InputError
        The file cannot be read, the category is unknown, or no size of it is known.
    """
    asset = read_asset(path)
    named = named_category(tree, category)
    assert named.node is not None  # a stated category is a node, or an error
    model = node_model(tree, named.node.node_id, named.is_broader)
    if model is None:
        raise InputError(f"--category: expected a category with a known size; found {named.node.name}")
    body = joined_body(asset.bodies, path.stem)
    size = true_size(body, asset.up, model)
    tier = node_tier(named.node)
    reason = (
        f"{named.node.name} ({tier or 'tier not stated'}), {extents_text(body.extents_m.tolist())} as the file says"
    )
    return ModelSize(str(path), named.node.node_id, tier, size.factor, size.height_m, reason)


def boxes_true_size(table: Path, tree: Tree) -> ModelSize:
    """The one factor that brings the objects of a scene to metres, from a table of their boxes (`read_boxes`).

    Objects whose name is no category say nothing. The height is that of the tallest one.

    Raises
    ------
    InputError
        The table cannot be read, or names no category with a known size.
    """
    used, names, heights = [], [], []
    for asset in read_boxes(table):
        (body,) = asset.bodies
        node = category_of_words(body.words, tree).node
        model = None if node is None else node_model(tree, node.node_id)
        if node is not None and model is not None:
            used.append((body, asset.up, model))
            names.append(node.name)
        heights.append(float(body.extents_m[AXES.index(asset.up or "y")]))
    if not used:
        raise InputError(f"{table}: category: expected names of objects whose size is known; found none")
    low, median, high = factor_of_bodies(used)
    tallest = max(heights)
    reason = f"{len(used)} of {len(heights)} objects: {', '.join(dict.fromkeys(names))}"
    height = (low * tallest, median * tallest, high * tallest)
    return ModelSize(str(table), ", ".join(dict.fromkeys(names)), None, (low, median, high), height, reason)
