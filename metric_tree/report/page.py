"""A readable page about a release: what it holds, how well detectors' words are covered, what to look at, what changed.

Every section is a table or a figure made by a pure function of the tree; `page` puts them together. The page is one
file, so that it can be mailed, archived and read in ten years; all that its one script does is to search a table.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from metric_base.errors import InputError
from metric_tree.checks.finding import Finding
from metric_tree.checks.release_files import CODES, findings
from metric_tree.prior import Prior
from metric_tree.report.changes import (
    SIZE_QUANTILES,
    SPREAD_QUANTILES,
    Change,
    changes,
    label,
    largest_changes,
    removed_nodes,
    size_and_spread,
    source_changes,
)
from metric_tree.report.figures import coverage_figure, size_figure
from metric_tree.report.html import Linked, paragraph, plain, search_table, table, whole_page
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
from metric_tree.tree import Node, NoPrior, Tree
from taxonomy.label_lists import vocabularies

__all__ = ["page"]

#: Rows of a table in which a person looks for the worst.
MAX_SHOWN_ROWS = 20

#: Kinds of errors with which there is nothing to count: of the tree, of priors.
BREAKING = frozenset({"E2", "E4"})

#: Findings of one code that are shown: enough to see what it is about.
MAX_EXAMPLES = 5


def page(tree: Tree, against: Tree | None = None) -> str:
    """The page as HTML.

    Raises
    ------
    InputError
        The release's tree or its priors break the format, so that nothing can be counted in it.
    """
    noticed = findings(tree.release.directory)
    if (broken := next((one for one in noticed if one.code[:2] in BREAKING), None)) is not None:
        raise InputError(
            f"{tree.release.directory}: {broken.code}: {broken.subject}: {broken.message} (metric-tree validate)"
        )
    lists = [coverage(tree, name) for name in vocabularies()]
    sections = [
        ("Find a category", _categories(tree)),
        ("What it holds", _holdings(tree)),
        ("Where it comes from", _sources(tree)),
        ("Words of detectors", _coverage(lists)),
        ("Sizes of typical categories", size_figure(typical_nodes(tree)) + paragraph(_SIZE_NOTE, note=True)),
        ("What to look at", _findings(tree, noticed)),
        *([(f"What changed since {label(against)}", _changes(tree, against, lists))] if against else []),
    ]
    note = f"Release of {tree.release.manifest['created']}; {len(tree):,} categories on five levels."
    return whole_page(f"{tree.name} {label(tree)}", note, sections)


def _categories(tree: Tree) -> str:
    """All categories with their medians, to be searched by their names and aliases."""
    head = ("category", "id", "path", "items", "tier", "median, mm")
    rows = [
        (
            " ".join((node.name, node.node_id, *node.aliases)),
            (node.name, node.node_id, " > ".join(node.path[1:-1]), node.n_items, *_tier_and_median(node)),
        )
        for node in sorted(tree, key=lambda node: node.name.casefold())
    ]
    return search_table("categories", "a name, an alias or an id", head, rows)


def _tier_and_median(node: Node) -> tuple[str, str]:
    """What the size rests on, and the size."""
    try:
        prior: Prior = node.prior()
    except NoPrior:
        return "", ""
    return prior.tier, " x ".join(f"{size:.3g}" if size < 100 else f"{size:.0f}" for size in prior.quantile(0.5))


_SIZE_NOTE = (
    "Density of the prior over log size; a band for each dimension that the category uses by default. Steps: the items "
    f"whose rows the release may ship, where there are {MIN_ITEMS} or more; their number stands behind that of all "
    "items. They are fewer than those of the fit, from other sources, and need not follow the band."
)

_EVIDENCE = {
    "any": "any but norms and ranges",
    "physical": "product, measured, standard, museum",
    "strong": "product, measured, standard",
}


def _holdings(tree: Tree) -> str:
    realms = [node for node in tree if node.level == 2]
    leaves = Counter(node.path[1] for node in tree if not node.children and node.n_items)
    rows = [(node.name, leaves[node.name], node.n_items) for node in sorted(realms, key=lambda n: -n.n_items)]
    evidence = tree.release.manifest.get("evidence") or {}
    by_kind = [
        (_EVIDENCE.get(name, name), own["items"], *(own[f"leaves_{least}"] for least in (1, 10, 30)))
        for name, own in evidence.items()
    ]
    head = ("leaves by the kind of their items", "items", "with 1 item", "with 10", "with 30")
    return (
        table(("level", "nodes", "with 1 item", "with 10", "with 30"), level_counts(tree))
        + (table(head, by_kind) if by_kind else "")
        + table(("realm", "leaves with items", "items"), rows)
    )


def _sources(tree: Tree) -> str:
    urls = {record["title"]: str(record.get("url") or "") for record in tree.release.manifest["sources"]}
    rows = [(Linked(title, urls[title]), *rest) for title, *rest in source_counts(tree)]
    n, year, region = known_shares(tree)
    known = f"Of the {n:,} items whose rows ship {year:.0%} know their year and {region:.0%} their region."
    return table(("source", "kind", "licence", "items of the fit", "rows shipped"), rows) + paragraph(known)


def _coverage(lists: Sequence[Coverage]) -> str:
    rows = [(c.name, c.labels, _share(c.enough, c), _share(c.real, c), _share(c.any, c)) for c in lists]
    head = ("list", "labels that need a prior", f"{MIN_ITEMS}+ real items", "any real item", "any prior")
    shares = [(c.name, c.enough / c.labels, c.real / c.labels, c.any / c.labels) for c in lists if c.labels]
    return coverage_figure(shares) + table(head, rows)


def _share(count: int, whole: Coverage) -> str:
    return f"{count} ({count / whole.labels:.0%})" if whole.labels else "–"


def _findings(tree: Tree, all_findings: Sequence[Finding]) -> str:
    counts = Counter(finding.code for finding in all_findings)
    examples = [f for code in sorted(counts) for f in [f for f in all_findings if f.code == code][:MAX_EXAMPLES]]
    checked = (
        table(("code", "what it means", "findings"), [(c, CODES.get(c, ""), n) for c, n in sorted(counts.items())])
        + paragraph(f"The first {MAX_EXAMPLES} of each code; metric-tree validate prints all of them:")
        + table(("code", "where", "finding"), [(f.code, f.subject, f.message) for f in examples])
        if counts
        else paragraph("The checks find nothing.")
    )
    differing = [(*row[:3], f"{row[3]:.0f} %") for row in disagreements(tree)[:MAX_SHOWN_ROWS]]
    several = mixed_leaves(tree)
    return (
        "<h3>Findings of the checks</h3>\n"
        + checked
        + "<h3>Sources that differ most about a category</h3>\n"
        + paragraph(
            "Differ by: one standard deviation between sources, in the dimension where it is largest.", note=True
        )
        + table(("category", "sources", "items", "differ by"), differing)
        + "<h3>Categories that look like two kinds of object</h3>\n"
        + paragraph(
            f"{len(several)} leaves, of which the {min(MAX_SHOWN_ROWS, len(several))} with most items:", note=True
        )
        + table(("category", "items", "parts, by geometric mean size"), several[:MAX_SHOWN_ROWS])
    )


def _changes(tree: Tree, before: Tree, lists: Sequence[Coverage]) -> str:
    lost, new = removed_nodes(tree, before), removed_nodes(before, tree)
    all_changes = changes(tree, before)
    counts = [
        ("nodes", len(before), len(tree)),
        ("leaves with items", *(sum(not n.children and n.n_items > 0 for n in one) for one in (before, tree))),
        ("items of the fit", before.root.n_items, tree.root.n_items),
        ("sources", *(len(one.release.manifest["sources"]) for one in (before, tree))),
    ]
    then = {name: coverage(before, name) for name in vocabularies()}
    words = [
        (c.name, *(text for field in ("enough", "real", "any") for text in _both(then[c.name], c, field)))
        for c in lists
        if any(getattr(c, field) != getattr(then[c.name], field) for field in ("enough", "real", "any"))
    ]
    head = ("list", f"{MIN_ITEMS}+ items before", "now", "any item before", "now", "any prior before", "now")
    return (
        table(("", "before", "now"), counts)
        + paragraph(f"{len(new):,} categories are new{_some(new)}; {len(lost):,} are gone{_some(lost)}.")
        + _if_any("Items of the fit by source", ("source", "before", "now"), source_changes(tree, before))
        + _if_any("Words of detectors", head, words)
        + _if_any("How far the priors of the nodes of both differ", _moves_head(), _moves(all_changes))
        + paragraph(_MOVED_NOTE, note=True)
        + _if_any(
            f"Sizes that changed most, of nodes with {MIN_ITEMS} items or more in both",
            ("category", "items before", "now", "dimensions", "tier", "medians before, mm", "now", "size", "width"),
            [_change(change) for change in largest_changes(all_changes, MAX_SHOWN_ROWS, MIN_ITEMS)],
        )
    )


def _if_any(title: str, head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    return f"<h3>{plain(title)}</h3>\n{table(head, rows)}" if rows else ""


def _both(then: Coverage, now: Coverage, field: str) -> tuple[str, str]:
    return _share(getattr(then, field), then), _share(getattr(now, field), now)


_MOVED_NOTE = (
    "Size: |change of ln median| as a factor less one; width: change of the standard deviation of ln size; both are "
    "means over the dimensions of a node, and a column is a quantile over the nodes of a level."
)


def _moves_head() -> tuple[str, ...]:
    sizes, widths = (f"size {q:.0%}" for q in SIZE_QUANTILES), (f"width {q:.0%}" for q in SPREAD_QUANTILES)
    return ("level", "nodes", *sizes, *widths)


def _moves(all_changes: Sequence[Change]) -> list[tuple[object, ...]]:
    return [
        (level, n, *(f"{np.expm1(s):.1%}" for s in sizes), *(f"{np.expm1(w):+.1%}" for w in widths))
        for level, n, sizes, widths in size_and_spread(all_changes)
    ]


def _change(change: Change) -> tuple[object, ...]:
    then, now = (" x ".join(f"{size:.0f}" for size in sizes) for sizes in (change.then_mm, change.now_mm))
    path = " > ".join(change.node.path[1:]) or change.node.name
    moved = (f"{np.expm1(value):+.0%}" for value in (change.size, change.spread))
    return (
        path,
        change.before.n_items,
        change.node.n_items,
        " x ".join(change.dims),
        change.node.tier or "",
        then,
        now,
        *moved,
    )


def _some(nodes: Sequence[Node]) -> str:
    names = [node.name for node in nodes[:MAX_SHOWN_ROWS]]
    return f" ({', '.join(names)}{', ...' if len(nodes) > MAX_SHOWN_ROWS else ''})" if names else ""
