"""The true size of a model from its shape alone: the posterior of the factor on its stated size.

With x the ln of its stated extents and u the ln of the factor, p(u | x) is p(x + u) of the size model, normalised:
each component gives a Gaussian in u, weighted by what the proportions say (docs/explanation/posterior.md).

The true size of a model's file whose category is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_tree.tree import Tree
from models3d.asset import AXES, AssetBody, Up, merge_bodies
from models3d.formats import read_asset, read_boxes
from models3d.size_check.category import category_of_words, named_category
from models3d.size_check.hypotheses import ordered_sizes
from models3d.size_check.size_model import SizeModel, extents_text, node_model, node_tier

#: Mass of the interval of a true size.
LEVEL = 0.9
#: Steps of the grid of ln factor over the components' range, and how many sds of each it covers.
GRID_STEPS, GRID_SD = 4001, 6.0


@dataclass(frozen=True, slots=True)
class TrueSize:
    """The factor on the stated size with its interval, (low, median, high), and the height that follows in metres."""

    factor: tuple[float, float, float]
    height_m: tuple[float, float, float]
    level: float = LEVEL


def true_size(body: AssetBody, up: Up | None, model: SizeModel, level: float = LEVEL) -> TrueSize:
    """The posterior of the factor for one body; the vertical extent is that of the stated up axis, y where none is."""
    low, median, high = _quantiles([_components(body, up, model)], level)
    vertical = float(body.extents_m[AXES.index(up or "y")])
    heights = [float(f"{vertical * factor:.4g}") for factor in (low, median, high)]
    return TrueSize((low, median, high), (heights[0], heights[1], heights[2]), level)


def factor_of_bodies(
    bodies: list[tuple[AssetBody, Up | None, SizeModel]], level: float = LEVEL
) -> tuple[float, float, float]:
    """The factor that several bodies of one scene have in common: low, median, high."""
    return _quantiles([_components(body, up, model) for body, up, model in bodies], level)


def _components(body: AssetBody, up: Up | None, model: SizeModel) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weights, means and sds, (k,) each, of the posterior of ln factor."""
    return model.shift_components(ordered_sizes(body.extents_m, up or "y", model.is_sorted))


def _quantiles(posteriors: list[tuple[FloatArray, FloatArray, FloatArray]], level: float) -> tuple[float, float, float]:
    """Quantiles of exp(u) under the product of mixtures of Gaussians in u, each (weights, means, sds) of (k,)."""
    low = min(float((means - GRID_SD * sds).min()) for _, means, sds in posteriors)
    high = max(float((means + GRID_SD * sds).max()) for _, means, sds in posteriors)
    grid = np.linspace(low, high, GRID_STEPS)  # (g,)
    log_density = np.zeros_like(grid)
    for weights, means, sds in posteriors:
        z = (grid[:, None] - means) / sds
        density = (weights / (sds * math.sqrt(2 * math.pi)) * np.exp(-(z**2) / 2)).sum(axis=1)
        log_density += np.log(density + 1e-300)
    mass = np.exp(log_density - log_density.max())
    share = np.cumsum(mass) / mass.sum()
    at = [float(np.exp(np.interp(q, share, grid))) for q in ((1 - level) / 2, 0.5, (1 + level) / 2)]
    return at[0], at[1], at[2]


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
    body = merge_bodies(asset.bodies, path.stem)
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
