"""Estimate the true size of a model from its proportions: the posterior of the factor on the size of its file.

With x the ln of the extents of the file and u the ln of the factor, p(u | x) is p(x + u) of the size model, normalised:
each component gives a Gaussian in u, weighted by the evidence of the proportions (docs/explanation/posterior.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_base.statistics import mixture_log_density
from metric_tree.tree import Tree
from models3d.asset import AXES, Asset, AssetBody, Up, merge_bodies
from models3d.formats import read_boxes
from models3d.size_check.category import category_of_texts, named_category
from models3d.size_check.hypotheses import ordered_sizes
from models3d.size_check.size_model import SizeModel, extents_text, node_model

#: Probability of the interval of a true size.
LEVEL = 0.9
#: Number of grid points over ln factor.
N_GRID_POINTS = 4001
#: Range of the grid around each component, in its standard deviations.
GRID_SIGMAS = 6.0


@dataclass(frozen=True, slots=True)
class TrueSize:
    """Posterior of the size of an object, as (low, median, high) with the probability `LEVEL`."""

    #: Factor on the size of the file.
    factor: tuple[float, float, float]
    #: Height in metres.
    height_m: tuple[float, float, float]


def true_size(body: AssetBody, up: Up | None, model: SizeModel) -> TrueSize:
    """Return the posterior of the size of an object; without an up axis, y is vertical."""
    low, median, high, _ = common_factor([(body, up, model)])
    vertical = float(body.extents_m[AXES.index(up or "y")])
    heights = [float(f"{vertical * factor:.4g}") for factor in (low, median, high)]
    return TrueSize((low, median, high), (heights[0], heights[1], heights[2]))


def common_factor(
    bodies: Sequence[tuple[AssetBody, Up | None, SizeModel]],
    likelihood: Callable[[FloatArray], FloatArray] | None = None,
) -> tuple[float, float, float, float]:
    """Return (low, median, high) of the factor that several objects of a file have in common.

    The posterior of u is the product of the mixtures of Gaussians of the objects, computed on a grid, times the
    `likelihood` (n,) of u (n,) by other evidence, whose mean over the posterior of the objects is the fourth value.
    """
    posteriors = [
        model.shift_components(ordered_sizes(body.extents_m, up or "y", model.is_sorted)) for body, up, model in bodies
    ]
    lowest = min(float((means - GRID_SIGMAS * sds).min()) for _, means, sds in posteriors)
    highest = max(float((means + GRID_SIGMAS * sds).max()) for _, means, sds in posteriors)
    grid = np.linspace(lowest, highest, N_GRID_POINTS)
    log_density = np.zeros_like(grid)
    for weights, means, sds in posteriors:
        log_density += mixture_log_density(grid[:, None], weights, means[:, None], sds[:, None, None] ** 2)
    mass = np.exp(log_density - log_density.max())
    mean_likelihood = 1.0
    if likelihood is not None:
        weights = likelihood(grid)
        mean_likelihood = float(mass @ weights / mass.sum())
        mass *= weights
    cumulative = np.cumsum(mass) / mass.sum()
    low, median, high = (float(np.exp(np.interp(q, cumulative, grid))) for q in ((1 - LEVEL) / 2, 0.5, (1 + LEVEL) / 2))
    return low, median, high, mean_likelihood


@dataclass(frozen=True, slots=True)
class ModelSize:
    """True size of a file: factor and height in metres as (low, median, high), and the data that they are based on."""

    file: str
    category: str
    tier: str | None
    factor: tuple[float, float, float]
    height_m: tuple[float, float, float]
    reason: str

    def to_json(self) -> dict[str, Any]:
        """Return the record of `metric-tree/true-size/1`."""
        names = ("low", "median", "high")
        return {
            "schema": "metric-tree/true-size/1",
            "file": self.file,
            "category": self.category,
            "tier": self.tier,
            "level": LEVEL,
            "factor": dict(zip(names, (float(f"{factor:.6g}") for factor in self.factor), strict=True)),
            "true_height_m": dict(zip(names, self.height_m, strict=True)),
            "reason": self.reason,
        }


def model_true_size(asset: Asset, category: str, tree: Tree) -> ModelSize:
    """Estimate the true size of a model of a category from its proportions.

    Parameters
    ----------
    asset : Asset
        Content of the file, as read by `read_asset`.
    category : str
        Name of a category of the tree.
    tree : Tree

    Raises
    ------
    InputError
        The category is unknown, or has no size.
    """
    named = named_category(tree, category)
    assert named.node is not None  # `named_category` raises UnknownName otherwise
    model = node_model(tree, named.node.node_id, named.is_broader)
    if model is None:
        raise InputError(f"--category: expected a category with a known size; found {named.node.name}")
    body = merge_bodies(asset.bodies, asset.file.stem)
    size = true_size(body, asset.up, model)
    tier = named.node.tier
    extents = extents_text(body.extents_m.tolist())
    reason = f"{named.node.name} ({tier or 'tier not stated'}), {extents} according to the file"
    return ModelSize(str(asset.file), named.node.node_id, tier, size.factor, size.height_m, reason)


def boxes_true_size(table: Path, tree: Tree) -> ModelSize:
    """Estimate the common factor that converts the boxes in a table, all from the same scene, to metres.

    Parameters
    ----------
    table : Path
        Table of boxes, as for `read_boxes`. Objects whose name is not a category are ignored.
    tree : Tree

    Returns
    -------
    ModelSize
        The height is that of the tallest object.

    Raises
    ------
    InputError
        The table cannot be read, or names no category with a known size.
    """
    used, names, heights = [], [], []
    for asset in read_boxes(table):
        if isinstance(asset, InputError):
            raise asset
        (body,) = asset.bodies
        node = category_of_texts(body.texts, tree).node
        model = None if node is None else node_model(tree, node.node_id)
        if node is not None and model is not None:
            used.append((body, asset.up, model))
            names.append(node.name)
        heights.append(float(body.extents_m[AXES.index(asset.up or "y")]))
    if not used:
        raise InputError(f"{table}: category: expected names of objects whose size is known; found none")
    low, median, high, _ = common_factor(used)
    tallest, categories = max(heights), ", ".join(dict.fromkeys(names))
    reason = f"{len(used)} of {len(heights)} objects: {categories}"
    height = (low * tallest, median * tallest, high * tallest)
    return ModelSize(str(table), categories, None, (low, median, high), height, reason)
