"""The page of what changed since another release."""

from __future__ import annotations

from typing import Any

from markupsafe import Markup, escape

from explorer.content.release_catalogue import ReleaseCatalogue
from explorer.content.units import length_text
from explorer.pages.templating import page_bytes
from explorer.urls import page_of
from metric_tree.diff import MovedPrior, release_diff
from metric_tree.report.changes import label
from metric_tree.tree import Tree

__all__ = ["change_page"]

_MOVED_HEAD = ("category", "dimension", "median before", "now", "median", "interval", "items that moved it")

#: Rows of a table.
MOST_ROWS = 200


def change_page(catalogue: ReleaseCatalogue, other: Tree) -> bytes:
    """What changed from another release to this one."""
    diff = release_diff(other, catalogue.tree)

    def link(node_id: str) -> Any:
        node = catalogue.nodes.get(node_id)
        if node is None:
            return node_id
        return Markup('<a href="../{}">{}</a>').format(page_of(node_id), node.name)

    def moved(one: MovedPrior) -> tuple[object, ...]:
        blame = ", ".join(f"{n:+} {source}" for source, n in list(one.blame.items())[:4]) or "no shipped item"
        sizes = length_text(one.before_mm), length_text(one.after_mm)
        return (link(one.node), one.dim, *sizes, f"{one.median:+.0%}", f"{one.spread:+.0%}", blame)

    tables: list[tuple[str, tuple[str, ...], list[tuple[Any, ...]]]] = [
        ("Priors that moved", _MOVED_HEAD, [moved(one) for one in diff.priors]),
        ("Tiers", ("category", "before", "now"), [(link(n), *pair) for n, pair in diff.tiers.items()]),
        ("New categories", ("category",), [(link(node_id),) for node_id in diff.added]),
        (
            "Categories that are gone",
            ("category", "its items are now in"),
            [(node_id, link(diff.merged.get(node_id, "–"))) for node_id in diff.removed],
        ),
        (
            "Moved",
            ("category", "was below", "is below"),
            [(link(n), *(link(parent or "") for parent in pair)) for n, pair in diff.moved.items()],
        ),
        ("Renamed", ("was", "is"), list(diff.renamed.values())),
        ("Shipped items by source", ("source", "before", "now"), [(n, *pair) for n, pair in diff.items.items()]),
        ("Shipped items by licence", ("licence", "before", "now"), [(n, *pair) for n, pair in diff.licences.items()]),
    ]
    return page_bytes(
        catalogue,
        "changes.html",
        "../",
        f"What changed from {escape(label(other))}",
        before=label(other),
        after=label(catalogue.tree),
        summary=[
            ("Categories", f"{diff.nodes_before:,} before, {diff.nodes_after:,} now"),
            ("Priors that moved", f"{len(diff.priors):,} ({diff.share_moved:.0%} of those in both)"),
        ],
        tables=[(title, head, rows[:MOST_ROWS], len(rows)) for title, head, rows in tables if rows],
    )
