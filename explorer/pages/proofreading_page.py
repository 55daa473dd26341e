"""A form for proofreading: the most used nodes with little evidence, and fields for better ranges.

The reader saves rows of `data/curated/ranges.csv` under the reader's name; they outrank those of a program
(`metric_tree.curated.sizes`). The page is one file and sends nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

from explorer.pages.report_page import report_html
from metric_tree.axes import AXES, EXTENTS
from metric_tree.curated.sizes import curated_ranges
from metric_tree.node import Node
from metric_tree.prior import INTERVAL_QUANTILES
from metric_tree.tiers import TIERS, tier_words
from metric_tree.tree import Tree
from taxonomy.words.senses import node_uses

#: Tiers that need no proofreading.
SOUND = ("norm", "measured")


def thin_nodes(tree: Tree, limit: int) -> list[Node]:
    """Return the `limit` most used leaves with a tier of `few` or less, those with the least evidence first."""
    counts = node_uses()

    def uses(node: Node) -> float:
        return counts.get(node.node_id, counts.get(node.node_id.removesuffix("/other"), 0.0))

    thin = [node for node in tree.leaves() if node.prior_dims and node.tier not in SOUND and uses(node)]
    used = sorted(thin, key=lambda node: (-uses(node), node.node_id))[:limit]
    return sorted(used, key=lambda node: (-TIERS.index(node.tier or TIERS[-1]), -uses(node), node.node_id))


def proofreading_page(tree: Tree, limit: int) -> str:
    """Return the page (HTML) for the `limit` most used nodes with little evidence."""
    rows = []
    for node in thin_nodes(tree, limit):
        used = node.prior(node.prior_dims[0]).evidence
        evidence = f"{used.rows:.0f} items of {used.sources} sources, {used.models} models" if used else ""
        tier = tier_words(node.tier or TIERS[-1])
        rows.append({"node": node, "tier": tier, "evidence": evidence, "ranges": range_texts(node)})
    note = (
        f"{len(rows)} of the most used categories whose size rests on few items or less, the thinnest evidence first."
        " Sizes are in mm in the ordinary pose: nine of ten objects lie between low and high. Say of each whether it is"
        " right, and correct the numbers where it is not. What you save are rows to append to data/curated/ranges.csv."
    )
    title = f"{tree.name} {tree.version}: an hour of proofreading"
    ends = ("low", "typical", "high")
    return report_html("proofreading.html", title, note, axes=AXES, ends=ends, rows=rows)


def range_texts(node: Node) -> Sequence[tuple[str, ...]]:
    """Return low, typical and high value of length, width and height in mm as text, empty for an axis without a prior.

    A written range is returned unchanged: the published interval is wider, because written ranges are on average too
    narrow, and the reader's correction is again a written range.
    """
    written = next((row for row in curated_ranges() if row.node_id == node.node_id), None)
    if written is not None:
        return [tuple("" if end is None else f"{end:.4g}" for end in span) for span in written.spans]
    prior = node.prior(node.prior_dims[0])
    quantiles = [prior.quantile(q) for q in INTERVAL_QUANTILES]
    names = AXES if prior.dims[0] in AXES else EXTENTS
    columns = {dim: column for column, dim in enumerate(prior.dims)}
    return [
        tuple(f"{quantile[columns[name]]:.4g}" for quantile in quantiles) if name in columns else ("", "", "")
        for name in names
    ]
