"""The tiers of evidence in words (docs/reference/tiers.md)."""

from __future__ import annotations

from metric_tree.tiers import TIERS

__all__ = ["MEANINGS", "TIERS", "UNKNOWN"]

#: Of a node without a prior.
UNKNOWN = "unknown"

#: Tier to what it means, the best first.
MEANINGS = {
    "norm": "a published norm fixes it",
    "measured": "many real items of several sources",
    "few": "few real items, or a single source",
    "models": "3-D models and museum pieces",
    "borrowed": "most of it comes from the categories around it",
    "judged": "a language model's range; nothing was measured",
    UNKNOWN: "nothing is known of its size",
}
