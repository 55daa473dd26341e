"""Self-contained page about a release: its content, the coverage of label lists, findings, and changes.

The page is one HTML file with inline figures and a script for its search field, so it can be mailed and archived.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from explorer.charts.report_figures import coverage_figure, size_figure
from explorer.pages.templating import Link, environment
from metric_base.errors import InputError
from metric_tree.checks.release_files import CODES, findings
from metric_tree.node import Node, NoPrior
from metric_tree.reports.diff import (
    SIZE_QUANTILES,
    SPREAD_QUANTILES,
    changes,
    label,
    largest_changes,
    removed_nodes,
    size_and_spread,
    source_changes,
)
from metric_tree.reports.summary import (
    MIN_ITEMS,
    Coverage,
    coverage,
    disagreements,
    known_shares,
    level_counts,
    mixed_leaves,
    source_counts,
    typical_nodes,
)
from metric_tree.tree import Tree
from taxonomy.label_lists import vocabularies

#: Maximum number of rows of a table that is sorted by importance.
MAX_SHOWN_ROWS = 20
#: First characters of the codes of errors in the tree or in the priors; such errors make all counts impossible.
BREAKING = frozenset({"E2", "E4"})
#: Maximum number of findings of one code that are shown.
MAX_EXAMPLES = 5
#: Descriptions of the groups of evidence in the manifest.
_EVIDENCE = {
    "any": "any but norms and ranges",
    "physical": "product, measured, standard, museum",
    "strong": "product, measured, standard",
}


def report_html(template: str, title: str, note: str, **values: Any) -> str:
    """Return a self-contained page: title, note, links to the sections of the template, and the sections."""
    return environment().get_template(template).render(title=title, note=note, **values)


def page(tree: Tree, against: Tree | None = None) -> str:
    """Return the page of a release as HTML, with the changes since another release if there is one.

    Raises
    ------
    InputError
        The tree or the priors of the release break the format, so that no count is possible.
    """
    all_findings = findings(tree.release.directory)
    if (broken := next((finding for finding in all_findings if finding.code[:2] in BREAKING), None)) is not None:
        raise InputError(
            f"{tree.release.directory}: {broken.code}: {broken.subject}: {broken.message} (metric-tree validate)"
        )
    # 1. Content of the release.
    nodes = sorted(tree, key=lambda node: node.name.casefold())
    categories = [
        (node.name, node.node_id, " > ".join(node.path[1:-1]), node.n_items, *_tier_and_median(node)) for node in nodes
    ]
    leaves = Counter(node.path[1] for node in tree if not node.children and node.n_items)
    realms = sorted((node for node in tree if node.level == 2), key=lambda node: -node.n_items)
    evidence = tree.release.manifest.get("evidence") or {}
    urls = {record["title"]: str(record.get("url") or "") for record in tree.release.manifest["sources"]}
    lists = [coverage(tree, name) for name in vocabularies()]
    # 2. Number of findings, and examples, by code.
    counts = Counter(finding.code for finding in all_findings)
    examples = [f for code in sorted(counts) for f in [f for f in all_findings if f.code == code][:MAX_EXAMPLES]]
    return report_html(
        "report.html",
        f"{tree.name} {label(tree)}",
        f"Release of {tree.release.manifest['created']}; {len(tree):,} categories on five levels.",
        against=label(against) if against else None,
        categories=categories,
        searched=[" ".join((node.name, node.node_id, *node.aliases)) for node in nodes],
        levels=level_counts(tree),
        kinds=[
            (_EVIDENCE.get(name, name), group["items"], *(group[f"leaves_{least}"] for least in (1, 10, 30)))
            for name, group in evidence.items()
        ],
        realms=[(node.name, leaves[node.name], node.n_items) for node in realms],
        sources=[(Link(title, urls[title]), *rest) for title, *rest in source_counts(tree)],
        known=known_shares(tree),
        min_items=MIN_ITEMS,
        coverage=[
            (row.name, row.labels, _share(row.enough, row), _share(row.real, row), _share(row.any, row))
            for row in lists
        ],
        coverage_figure=Markup(coverage_figure([row for row in lists if row.labels])),
        size_figure=Markup(size_figure(typical_nodes(tree))),
        finding_counts=[(code, CODES.get(code, ""), n) for code, n in sorted(counts.items())],
        finding_examples=[(finding.code, finding.subject, finding.message) for finding in examples],
        max_examples=MAX_EXAMPLES,
        max_rows=MAX_SHOWN_ROWS,
        differing=[(*row[:3], f"{row[3]:.0f} %") for row in disagreements(tree)[:MAX_SHOWN_ROWS]],
        mixed=mixed_leaves(tree),
        changed=_changed(tree, against, lists) if against else None,
    )


def _tier_and_median(node: Node) -> tuple[str, str]:
    try:
        prior = node.prior()
    except NoPrior:
        return "", ""
    return prior.tier, " x ".join(f"{size:.3g}" if size < 100 else f"{size:.0f}" for size in prior.quantile(0.5))


def _share(count: int, total: Coverage) -> str:
    return f"{count} ({count / total.labels:.0%})" if total.labels else "–"


def _changed(tree: Tree, before: Tree, lists: Sequence[Coverage]) -> dict[str, Any]:
    """Return the tables of the changes from another release to this one."""
    removed, added = removed_nodes(tree, before), removed_nodes(before, tree)
    all_changes = changes(tree, before)
    lists_before = {name: coverage(before, name) for name in vocabularies()}
    fields = ("enough", "real", "any")
    size_head = (f"size {q:.0%}" for q in SIZE_QUANTILES)
    return {
        "counts": [
            ("nodes", len(before), len(tree)),
            ("leaves with items", *(sum(not n.children and n.n_items > 0 for n in one) for one in (before, tree))),
            ("items of the fit", before.root.n_items, tree.root.n_items),
            ("sources", *(len(one.release.manifest["sources"]) for one in (before, tree))),
        ],
        "categories": f"{len(added):,} categories are new{_names(added)}; {len(removed):,} are gone{_names(removed)}.",
        "sources": source_changes(tree, before),
        "coverage": [
            (
                now.name,
                *(_share(getattr(row, field), row) for field in fields for row in (lists_before[now.name], now)),
            )
            for now in lists
            if any(getattr(now, field) != getattr(lists_before[now.name], field) for field in fields)
        ],
        "moves_head": ("level", "nodes", *size_head, *(f"width {q:.0%}" for q in SPREAD_QUANTILES)),
        "moves": [
            (level, n, *(f"{np.expm1(s):.1%}" for s in sizes), *(f"{np.expm1(w):+.1%}" for w in widths))
            for level, n, sizes, widths in size_and_spread(all_changes)
        ],
        "largest": [
            (
                " > ".join(change.node.path[1:]) or change.node.name,
                change.before.n_items,
                change.node.n_items,
                " x ".join(change.dims),
                change.node.tier or "",
                *(" x ".join(f"{size:.0f}" for size in sizes) for sizes in (change.then_mm, change.now_mm)),
                *(f"{np.expm1(value):+.0%}" for value in (change.size, change.spread)),
            )
            for change in largest_changes(all_changes, MAX_SHOWN_ROWS, MIN_ITEMS)
        ],
    }


def _names(nodes: Sequence[Node]) -> str:
    """Return the names of the first nodes in brackets, empty without nodes."""
    names = [node.name for node in nodes[:MAX_SHOWN_ROWS]]
    return f" ({', '.join(names)}{', ...' if len(nodes) > MAX_SHOWN_ROWS else ''})" if names else ""
