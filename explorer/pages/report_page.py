"""Self-contained page about a release: its content, the coverage of label lists, findings, and changes.

The page is one HTML file with inline figures and a script for its search field, so it can be mailed and archived.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from markupsafe import Markup

from explorer.charts.distributions import distribution
from explorer.pages.release_pages import change_tables
from explorer.pages.templating import environment, link_html
from metric_base.errors import InputError
from metric_tree.checks.release_files import CODES, findings
from metric_tree.node import Node, NoPrior
from metric_tree.prior import INTERVAL_QUANTILES
from metric_tree.reports import summary
from metric_tree.reports.diff import label, release_diff
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
        found = f"{broken.code}: {broken.subject}: {broken.message}"
        raise InputError(f"{tree.release.directory}: {found} (metric-tree validate)")
    # 1. Content of the release.
    nodes = sorted(tree, key=lambda node: node.name.casefold())
    categories = [
        (node.name, node.node_id, " > ".join(node.path[1:-1]), node.n_items, *_tier_and_median(node)) for node in nodes
    ]
    name_of = {node.node_id: node.name for node in nodes}
    leaves = Counter(node.path[1] for node in tree if not node.children and node.n_items)
    realms = sorted((node for node in tree if node.level == 2), key=lambda node: -node.n_items)
    evidence = tree.release.manifest.get("evidence") or {}
    urls = {record["title"]: record.get("url") for record in tree.release.manifest["sources"]}
    lists = [summary.coverage(tree, name) for name in vocabularies()]
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
        levels=summary.level_counts(tree),
        kinds=[
            (_EVIDENCE.get(name, name), group["items"], *(group[f"leaves_{least}"] for least in (1, 10, 30)))
            for name, group in evidence.items()
        ],
        realms=[(node.name, leaves[node.name], node.n_items) for node in realms],
        sources=[(link_html(title, urls[title]), *rest) for title, *rest in summary.source_counts(tree)],
        known=summary.known_shares(tree),
        min_items=summary.MIN_ITEMS,
        coverage=[
            (row.name, row.labels, _share(row.enough, row), _share(row.real, row), _share(row.any, row))
            for row in lists
        ],
        figures=[figure for node in summary.typical_nodes(tree) for figure in size_figures(node)],
        finding_counts=[(code, CODES.get(code, ""), n) for code, n in sorted(counts.items())],
        finding_examples=[(finding.code, finding.subject, finding.message) for finding in examples],
        max_examples=MAX_EXAMPLES,
        max_rows=MAX_SHOWN_ROWS,
        differing=[(*row[:3], f"{row[3]:.0f} %") for row in summary.disagreements(tree)[:MAX_SHOWN_ROWS]],
        mixed=summary.mixed_leaves(tree),
        changes=change_tables(release_diff(against, tree), lambda one: name_of.get(one, one)) if against else [],
    )


def _tier_and_median(node: Node) -> tuple[str, str]:
    try:
        prior = node.prior()
    except NoPrior:
        return "", ""
    return prior.tier, " x ".join(f"{size:.3g}" if size < 100 else f"{size:.0f}" for size in prior.quantile(0.5))


def _share(count: int, total: summary.Coverage) -> str:
    return f"{count} ({count / total.labels:.0%})" if total.labels else "–"


def size_figures(node: Node) -> list[tuple[str, Markup]]:
    """Return caption and chart of each dimension of the widest prior of a node, with the sizes of published items."""
    prior, items = node.prior(max(node.prior_dims, key=len)), node.items()
    intervals, kinds = prior.quantiles(INTERVAL_QUANTILES), np.array(items["kind"].to_pylist(), dtype=object)
    figures = []
    for place, dim in enumerate(prior.dims):
        stated = items[f"{dim}_mm"].to_pylist() if f"{dim}_mm" in items.column_names else [None] * len(kinds)
        sizes = np.array([mm or np.nan for mm in stated], dtype=float)
        known = ~np.isnan(sizes)
        interval, is_norm = intervals[:, place], node.tier == "norm"
        chart = distribution(dim, prior.marginal((dim,)), interval, sizes[known], kinds[known], is_norm)
        figures.append((f"{node.name}: {dim}", Markup(chart)))
    return figures
