"""The tier of evidence of a prior, in words and in the order from the best."""

from __future__ import annotations

from metric_tree.prior import Prior
from metric_tree.tree import Node

__all__ = ["MEANINGS", "TIERS", "UNKNOWN", "node_tier", "prior_tier"]

#: Tier to what it means, the best first.
TIERS = {
    "norm": "a published norm or a survey fixes it",
    "measured": "many real items of several sources",
    "few": "few real items, or a single source",
    "models": "3-D models, not real items",
    "borrowed": "most of it comes from the category above",
    "judged": "a language model's range; nothing was measured",
}


#: Of a node without a prior.
UNKNOWN = "unknown"

MEANINGS = {**TIERS, UNKNOWN: "nothing is known of its size"}


def node_tier(node: Node, prior: Prior | None) -> str:
    """The tier of a node's default prior."""
    if prior is None:
        return UNKNOWN
    stated = getattr(node, "tier", None)
    return str(stated) if stated else prior_tier(prior)


def prior_tier(prior: Prior) -> str:
    """The tier of a prior; of a release that states none, from its kinds of evidence."""
    stated = getattr(prior, "tier", None)
    if stated:
        return str(stated)
    share = prior.share_by_kind
    real = sum(share.get(kind, 0.0) for kind in ("measured", "product", "museum"))
    if share.get("standard", 0.0) + share.get("statistic", 0.0) > 0.5:
        return "norm"
    if prior.borrowed > 0.5:
        return "borrowed"
    if real > 0.5:
        return "measured" if prior.n >= 30 and prior.n_sources >= 2 else "few"
    if share.get("asset", 0.0) + share.get("default", 0.0) > 0.5:
        return "models"
    return "judged"
