"""The JSON record of a category with its prior, `metric-tree/query/1`."""

from __future__ import annotations

from typing import Any

from metric_tree.context import Where
from metric_tree.node import Node
from metric_tree.prior import ARRAYS, QUANTILES, Prior
from metric_tree.reports.description import is_heterogeneous, node_sentence, shipped_evidence
from metric_tree.variants import Variant


def node_record(node: Node, dims: tuple[str, ...] | None = None, where: Where | None = None) -> dict[str, Any]:
    """Return the record of a node, with `prior` null if it has no prior and no `dims` are requested.

    Raises
    ------
    NoPrior
        No prior has the requested dimensions.
    """
    prior = node.prior(dims, where) if node.prior_dims or dims is not None else None
    record: dict[str, Any] = {
        "schema": "metric-tree/query/1",
        "tree": {"name": node.tree.name, "version": node.tree.version},
        "node": node.node_id,
        "name": node.name,
        "path": list(node.path),
        "level": node.level,
        "pose": node.pose,
        "height_is": node.height_is,
        "unknown_axes": node.unknown_axes,
        "n_items": node.n_items,
        "children": [child.node_id for child in node.children],
        "dims": list(prior.dims) if prior else list(node.dims),
        "tier": prior.tier if prior else None,
        "tier_evidence": prior.evidence.record() if prior and prior.evidence else None,
        "norm": prior.norm if prior else None,
        "where": prior.note if prior else None,
        "contexts": {"regions": list(node.contexts.regions), "years": list(node.contexts.years)},
        "sentence": node_sentence(node, node.name.partition(" (")[0], prior) if prior else None,
        "mixed": is_heterogeneous(node, prior) if prior else None,
        "shipped": shipped_evidence(node),
        "stated": node.stated.name if node.stated else None,
        "variants": [_variant_record(variant) for variant in node.variants],
        "plain_state": node.plain_state,
        "states_mm": {name: quantiles_mm(state) for name, state in node.states.items()},
        "quantiles_mm": None,
        "prior": None,
    }
    if prior is not None:
        record["quantiles_mm"] = quantiles_mm(prior)
        fields = ("family", *ARRAYS, "n", "n_sources", "share_by_kind", "borrowed")
        row = prior.row() | {"share_by_kind": prior.share_by_kind}
        record["prior"] = {name: row[name] for name in fields}
    return record


def _variant_record(variant: Variant) -> dict[str, Any]:
    """Return a variant with the size and the tolerance in mm of each axis."""
    sizes = {axis: {"mm": mm, "tolerance_mm": tolerance} for axis, (mm, tolerance) in variant.sizes.items()}
    fields = ("name", "aliases", "region", "years", "share", "document", "clause")
    return {name: getattr(variant, name) for name in fields} | {"sizes": sizes}


def quantiles_mm(prior: Prior) -> dict[str, dict[str, float]]:
    """Return `QUANTILES` of a prior in mm, rounded to 0.01, by dimension and probability."""
    table = prior.quantiles(QUANTILES).T
    return {
        dim: {f"{q:g}": round(float(value), 2) for q, value in zip(QUANTILES, row, strict=True)}
        for dim, row in zip(prior.dims, table, strict=True)
    }
