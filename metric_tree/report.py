"""A readable page about a release: what it holds, how well detectors' words are covered, what to look at, what changed.

Every section is a table or a figure made by a pure function of the tree; `page` puts them together. The page is one
file without scripts, so that it can be mailed, archived and read in ten years.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from math import exp

import numpy as np

from metric_tree.checks import findings
from metric_tree.report_figures import coverage_figure, size_figure
from metric_tree.tree import Node, Tree, UnknownName
from taxonomy.vocabularies import Label, vocabularies, vocabulary

__all__ = [
    "ENOUGH",
    "Coverage",
    "changed_sizes",
    "coverage",
    "covered_items",
    "disagreements",
    "level_counts",
    "page",
    "source_counts",
    "typical_nodes",
]

#: Items from which a distribution can be told at all; the issue's own number.
ENOUGH = 10

#: Rows of a table in which the reader looks for the worst.
SHOWN = 20

#: Change of a median between releases that is worth a reader's eye: a third of the spread of an everyday class.
NOTABLE = 0.10

#: Categories of the figure, as in the paper's figure of size distributions, with others of everyday rooms and streets;
#: those that the release lacks are left out.
TYPICAL = (
    "chair.n.01",
    "sofa.n.01",
    "bed.n.01",
    "desk.n.01",
    "television_receiver.n.01",
    "laptop.n.01",
    "cellular_telephone.n.01",
    "computer_keyboard.n.01",
    "bottle.n.01",
    "book.n.02",
    "refrigerator.n.01",
    "person.n.01",
    "car.n.01",
    "bicycle.n.01",
    "oak.n.02",
)

_STYLE = """
body { font: 16px/1.5 Georgia, serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #222 }
h1, h2 { font-weight: normal } h2 { margin-top: 2.5rem; border-bottom: 1px solid #ccc }
table { border-collapse: collapse; font: 14px/1.4 system-ui, sans-serif; margin: 1rem 0 }
td, th { padding: .15rem .8rem .15rem 0; text-align: left; vertical-align: top } th { border-bottom: 1px solid #888 }
td.n, th.n { text-align: right } p.note { color: #555 } svg { max-width: 100%; height: auto }
"""


@dataclass(frozen=True, slots=True)
class Coverage:
    """Labels of a list that need a prior, and how many have one from at least `ENOUGH` real items, any, or at all."""

    name: str
    labels: int
    enough: int
    real: int
    any: int


def level_counts(tree: Tree) -> list[tuple[int, ...]]:
    """Level, nodes, nodes with 1, 10, 30 real items at or below them."""
    rows = []
    for level in sorted({node.level for node in tree}):
        items = [node.n_items for node in tree if node.level == level]
        rows.append((level, len(items), *(sum(count >= least for count in items) for least in (1, 10, 30))))
    return rows


def source_counts(tree: Tree) -> list[tuple[str, str, str, int, int]]:
    """Source, kind, licence, rows of the fit, rows shipped; most rows first."""
    rows = [
        (s["title"], s.get("kind", ""), s.get("licence") or "none", int(s.get("n_fit", 0)), int(s.get("n_rows", 0)))
        for s in tree.release.manifest["sources"]
    ]
    return sorted(rows, key=lambda row: (-row[3], row[0]))


def covered_items(tree: Tree, label: Label) -> int | None:
    """Real items of the label's node; None where it has no prior at all."""
    if label.node_id is None:
        return None
    try:
        node = tree.node(label.node_id)
    except UnknownName:
        return None
    return node.n_items if node.prior_dims else None


def coverage(tree: Tree, name: str, labels: Iterable[Label] | None = None) -> Coverage:
    """How much of a label list has a prior; walls, floors, skies and void labels need none."""
    needing = [label for label in (vocabulary(name) if labels is None else labels) if label.needs_prior]
    counts = [count for label in needing if (count := covered_items(tree, label)) is not None]
    return Coverage(name, len(needing), sum(n >= ENOUGH for n in counts), sum(n > 0 for n in counts), len(counts))


def typical_nodes(tree: Tree) -> list[Node]:
    """Those of the typical categories that the release has a prior for."""
    known = {node.node_id: node for node in tree}
    return [known[node_id] for node_id in TYPICAL if node_id in known and known[node_id].prior_dims]


def disagreements(tree: Tree) -> list[tuple[str, int, int, float]]:
    """Node, sources, items, and how far sources differ (per cent, one standard deviation); worst first.

    Leaves and kinds with items from at least three sources; the number is of the axis on which they differ most.
    """
    rows = []
    for node in tree:
        if node.level >= 4 and node.n_items >= ENOUGH:
            for dims in node.prior_dims[-1:]:
                prior = node.prior(dims)
                if prior.n_sources >= 3:
                    spread = float(np.sqrt(np.diag(prior.shared_covariance).max()))
                    rows.append((" > ".join(node.path[1:]), prior.n_sources, prior.n, 100 * (exp(spread) - 1)))
    return sorted(rows, key=lambda row: -row[3])[:SHOWN]


def changed_sizes(tree: Tree, before: Tree) -> list[tuple[str, str, float, float]]:
    """Node, dimension, median before and now in mm, where it moved by more than `NOTABLE`; largest change first."""
    rows = []
    known = {node.node_id: node for node in before}
    for node in tree:
        old = known.get(node.node_id)
        if old is not None and node.level >= 4 and min(node.n_items, old.n_items) >= ENOUGH:
            for dim, then, now in _medians(old, node):
                if abs(now / then - 1) > NOTABLE:
                    rows.append((node.name, dim, then, now))
    return sorted(rows, key=lambda row: -abs(np.log(row[3] / row[2])))[:SHOWN]


def _medians(old: Node, new: Node) -> list[tuple[str, float, float]]:
    shared = [dims for dims in new.prior_dims if dims in old.prior_dims][-1:]
    return [
        (dim, float(old.prior((dim,)).quantile(0.5)[0]), float(new.prior((dim,)).quantile(0.5)[0]))
        for dims in shared
        for dim in dims
    ]


def page(tree: Tree, against: Tree | None = None) -> str:
    """The page as HTML."""
    lists = [coverage(tree, name) for name in vocabularies()]
    sections = [
        ("What it holds", _holdings(tree)),
        ("Where it comes from", _sources(tree)),
        ("Words of detectors", _coverage(lists)),
        ("Sizes of typical categories", size_figure(typical_nodes(tree)) + _SIZE_NOTE),
        ("What to look at", _findings(tree)),
        *([(f"What changed since {escape(against.version)}", _changes(tree, against))] if against else []),
    ]
    body = "\n".join(f"<h2>{title}</h2>\n{content}" for title, content in sections)
    title = f"{escape(tree.name)} {escape(tree.version)}"
    created = escape(str(tree.release.manifest["created"]))
    return (
        f'<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n<title>{title}</title>\n<style>{_STYLE}</style>\n'
        f"<h1>{title}</h1>\n<p class=note>Release of {created}; {len(tree)} categories on five levels.</p>\n"
        f"{body}\n</html>\n"
    )


_SIZE_NOTE = (
    "<p class=note>Density of the prior over log size; a band for each dimension that the category uses by default. "
    "The histogram shows the items whose rows the release may ship.</p>"
)


def _holdings(tree: Tree) -> str:
    realms = [node for node in tree if node.level == 2]
    leaves = Counter(node.path[1] for node in tree if node.level == 5 and node.n_items)
    rows = [(node.name, leaves[node.name], node.n_items) for node in sorted(realms, key=lambda n: -n.n_items)]
    return _table(("level", "nodes", "with 1 item", "with 10", "with 30"), level_counts(tree)) + _table(
        ("realm", "leaves with items", "items"), rows
    )


def _sources(tree: Tree) -> str:
    return _table(("source", "kind", "licence", "items of the fit", "rows shipped"), source_counts(tree))


def _coverage(lists: Sequence[Coverage]) -> str:
    rows = [(c.name, c.labels, _share(c.enough, c), _share(c.real, c), _share(c.any, c)) for c in lists]
    head = ("list", "labels that need a prior", f"{ENOUGH}+ real items", "any real item", "any prior")
    shares = [(c.name, c.enough / c.labels, c.real / c.labels, c.any / c.labels) for c in lists if c.labels]
    return coverage_figure(shares) + _table(head, rows)


def _share(count: int, whole: Coverage) -> str:
    return f"{count} ({count / whole.labels:.0%})" if whole.labels else "–"


def _findings(tree: Tree) -> str:
    found = findings(tree.release.directory)
    counts = sorted(Counter(finding.code for finding in found).items())
    first = [(finding.code, finding.subject, finding.message) for finding in found[:SHOWN]]
    return (
        (_table(("code", "findings"), counts) if counts else "<p>The checks find nothing.</p>")
        + (_table(("code", "where", "finding"), first) if first else "")
        + "<p>Sources that differ most about a category, as one standard deviation between sources:</p>"
        + _table(
            ("category", "sources", "items", "differ by"),
            [(*row[:3], f"{row[3]:.0f} %") for row in disagreements(tree)],
        )
    )


def _changes(tree: Tree, before: Tree) -> str:
    old, new = {node.node_id for node in before}, {node.node_id for node in tree}
    sizes = [(name, dim, f"{then:.0f}", f"{now:.0f}") for name, dim, then, now in changed_sizes(tree, before)]
    return (
        _table(
            ("", "before", "now"),
            [
                ("nodes", len(old), len(new)),
                ("items of the fit", before.root.n_items, tree.root.n_items),
                ("sources", len(before.release.manifest["sources"]), len(tree.release.manifest["sources"])),
            ],
        )
        + f"<p>{len(new - old)} categories are new, {len(old - new)} are gone{_some(old - new)}.</p>"
        + (_table(("category", "dimension", "median before, mm", "now"), sizes) if sizes else "")
    )


def _some(ids: set[str]) -> str:
    return f": {escape(', '.join(sorted(ids)[:SHOWN]))}" if ids else ""


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [_row(head, "th")]
    lines += [_row(row, "td") for row in rows]
    return "<table>\n" + "\n".join(lines) + "\n</table>\n"


def _row(cells: Sequence[object], tag: str) -> str:
    return "<tr>" + "".join(f"<{tag}{_numeric(cell)}>{escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"


def _numeric(cell: object) -> str:
    return " class=n" if isinstance(cell, int | float) else ""
