"""A readable page about a release: what it holds, how well detectors' words are covered, what to look at, what changed.

Every section is a table or a figure made by a pure function of the tree; `page` puts them together. The page is one
file, so that it can be mailed, archived and read in ten years; all that its one script does is to search a table.

Figures of the report as inline SVG.

Tables and frame of the report's page: plain HTML, and one script of a few lines for its search box.

A page for an hour of proofreading: the most used nodes that rest on little, with a form for better ranges.

What the reader saves are rows of `data/curated/ranges.csv` under the reader's name; a person's row outranks a program's
(`metric_tree.curated.sizes`). The page is one file and sends nothing.
"""

from __future__ import annotations

import io
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from crawler.items import STATED_KINDS
from metric_base.errors import InputError
from metric_base.escaping import visible
from metric_tree.axes import AXES, EXTENTS
from metric_tree.checks.finding import Finding
from metric_tree.checks.release_files import CODES, findings
from metric_tree.curated.sizes import curated_ranges
from metric_tree.node import Node, NoPrior
from metric_tree.prior import INTERVAL_QUANTILES, Prior
from metric_tree.reports.diff import (
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
from metric_tree.tiers import TIERS, tier_words
from metric_tree.tree import Tree
from taxonomy.label_lists import vocabularies
from taxonomy.words.senses import node_uses

#: One colour per axis, told apart by people who see no red and green too (Okabe and Ito 2008).
_COLOURS = {"length": "#0072B2", "width": "#E69F00", "height": "#009E73"}
_EXTENT_COLOURS = dict(zip(EXTENTS, _COLOURS.values(), strict=True))
#: Panels side by side.
_COLUMNS = 3
#: Items from which a histogram says more than a list of them would.
_ENOUGH = 10
#: A histogram may stand so far above the highest density; beyond, it would press the densities flat.
_HEADROOM = 1.6
#: Share of the prior left out at each end of a panel's axis.
_TAIL = 0.005
_STYLE = """
body { font: 16px/1.5 Georgia, serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222 }
h1, h2 { font-weight: normal } h2 { margin-top: 2.5rem; border-bottom: 1px solid #ccc }
h3 { font-weight: normal; font-size: 1.1rem; margin: 1.5rem 0 0 } a { color: #0060a0 }
nav { font-size: 14px } nav a { margin-right: 1rem } div.table { overflow-x: auto }
table { border-collapse: collapse; font: 14px/1.4 system-ui, sans-serif; margin: .6rem 0 1rem }
td, th { padding: .15rem .9rem .15rem 0; text-align: left; vertical-align: top } th { border-bottom: 1px solid #888 }
tr:nth-child(odd) td { background: #f7f7f5 } td.n, th.n { text-align: right; white-space: nowrap }
p.note { color: #555 } svg { max-width: 100%; height: auto }
input[type=search] { font: inherit; width: 100%; max-width: 30rem; padding: .3rem .5rem; box-sizing: border-box }
div.search { max-height: 26rem; overflow: auto }
"""
#: Hides the rows that lack a word of what is typed. Without scripts the table is whole.
_SEARCH = """
for (const box of document.querySelectorAll("input[type=search]")) {
  const rows = [...document.getElementById(box.dataset.table).querySelectorAll("tr")].slice(1)
  const count = document.getElementById(box.dataset.table + "-count")
  box.addEventListener("input", () => {
    const words = box.value.toLowerCase().split(/\\s+/).filter(Boolean)
    let shown = 0
    for (const row of rows) {
      const text = row.dataset.words
      row.hidden = !words.every(word => text.includes(word))
      shown += !row.hidden
    }
    count.textContent = shown + " of " + rows.length
  })
}
"""
#: A cell that begins with a number is one: `70 (59%)`, `-39 %`.
_NUMBER = re.compile(r"^[-+]?[\d.,]+( ?%)?( \(\d+%\))?$")
#: Rows of a table in which a person looks for the worst.
MAX_SHOWN_ROWS = 20
#: Kinds of errors with which there is nothing to count: of the tree, of priors.
BREAKING = frozenset({"E2", "E4"})
#: Findings of one code that are shown: enough to see what it is about.
MAX_EXAMPLES = 5
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
_MOVED_NOTE = (
    "Size: |change of ln median| as a factor less one; width: change of the standard deviation of ln size; both are "
    "means over the dimensions of a node, and a column is a quantile over the nodes of a level."
)
#: What a size that needs no proofreading rests on.
SOUND = ("norm", "measured")
#: The quantiles that a range is: nine of ten lie between the outer two.

_ENDS = ("low", "typical", "high")
_SCRIPT = """
const fields = [...document.querySelectorAll("tr[data-node]")]
const quoted = text => '"' + text.replaceAll('"', '""') + '"'
document.getElementById("save").addEventListener("click", () => {
  const name = document.getElementById("reviewer").value.trim()
  if (!name || name.startsWith("program")) { alert("Your name comes first."); return }
  const day = new Date().toISOString().slice(0, 10)
  const lines = fields.filter(row => row.querySelector("select").value).map(row => {
    const cells = [...row.querySelectorAll("input[type=number]")].map(cell => cell.value)
    const why = row.querySelector("input[type=text]").value || row.querySelector("select").value
    return [row.dataset.node, ...cells, quoted(why), quoted(name), day].join(",")
  })
  const link = document.createElement("a")
  link.href = URL.createObjectURL(new Blob([lines.join("\\n") + "\\n"], { type: "text/csv" }))
  link.download = "ranges-" + day + ".csv"
  link.click()
})
"""


def size_figure(nodes: Sequence[Node]) -> str:
    """Densities of the priors over log size, one panel for each node, with the shipped items as histograms."""
    if not nodes:
        return "<p>No typical category has a prior.</p>"
    from matplotlib.figure import Figure

    rows = -(-len(nodes) // _COLUMNS)
    figure = Figure(figsize=(11, 2.5 * rows), layout="constrained")
    panels = np.atleast_1d(figure.subplots(rows, _COLUMNS)).ravel()
    for panel, node in zip(panels, nodes, strict=False):
        _panel(panel, node)
    for panel in panels[len(nodes) :]:
        panel.set_axis_off()
    return _svg(figure)


def _panel(panel: Any, node: Node) -> None:
    import pyarrow as pa
    import pyarrow.compute as pc
    from matplotlib.ticker import LogLocator, NullLocator

    dims = _dims(node)
    items = node.items()
    items = items.filter(pc.invert(pc.is_in(items["kind"], pa.array(STATED_KINDS, pa.string()))))  # a range is no item
    highest, shown = 0.0, 0
    for dim in dims:
        colour = {**_COLOURS, **_EXTENT_COLOURS}[dim]
        prior = node.prior((dim,))
        low, high = (float(prior.quantile(q)[0]) for q in (_TAIL, 1 - _TAIL))
        grid = np.geomspace(low, high, 200)
        density = np.exp(prior.log_density(grid[:, None]))  # over ln mm
        panel.plot(grid, density, color=colour, label=dim)
        panel.fill_between(grid, density, color=colour, alpha=0.15)
        highest = max(highest, float(density.max()))
        if f"{dim}_mm" in items.column_names:
            sizes = np.array([v for v in items[f"{dim}_mm"].to_pylist() if v], dtype=float)
            shown = max(shown, len(sizes))
            if len(sizes) >= _ENOUGH:
                edges = np.geomspace(low, high, 30)
                counts, _ = np.histogram(sizes, edges)
                panel.stairs(counts / len(sizes) / np.diff(np.log(edges)), edges, color=colour, alpha=0.5)
    panel.set_xscale("log")
    panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    panel.xaxis.set_major_formatter("{x:g}")
    panel.xaxis.set_minor_locator(NullLocator())
    panel.set_yticks([])
    panel.set_ylim(0, _HEADROOM * highest)
    few = "" if shown < _ENOUGH else f", {shown:,} shown"
    panel.set_title(f"{visible(node.name)}: {node.n_items:,} items{few}", fontsize=11)
    panel.tick_params(labelsize=9)
    panel.legend(fontsize=8, frameon=False, handlelength=1)
    panel.set_xlabel("mm", fontsize=9, labelpad=0)
    for side in ("top", "left", "right"):
        panel.spines[side].set_visible(False)


def _dims(node: Node) -> tuple[str, ...]:
    """The default dimensions where they have a prior, else those of the node's widest row."""
    widest = max(node.prior_dims, key=len)
    return tuple(dim for dim in node.dims if dim in widest) or widest


def coverage_figure(shares: Sequence[tuple[str, float, float, float]]) -> str:
    """Bars of the share of each label list with a prior: from enough real items, from any, and at all."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import PercentFormatter

    figure = Figure(figsize=(11, 0.32 * len(shares) + 0.8), layout="constrained")
    panel = figure.subplots()
    rows = np.arange(len(shares))[::-1]
    for column, colour, name in (
        (3, "#ccd5dd", "any prior"),
        (2, "#7fb3d5", "any real item"),
        (1, "#0072B2", "10+ real items"),
    ):
        panel.barh(rows, [share[column] for share in shares], color=colour, label=name)
    panel.set_yticks(rows, [str(share[0]) for share in shares], fontsize=10)
    panel.set_xlim(0, 1)
    panel.margins(y=0.01)
    panel.xaxis.set_major_formatter(PercentFormatter(1.0))
    panel.tick_params(axis="x", labelsize=10)
    panel.tick_params(axis="y", length=0)
    for side in ("top", "left", "right"):
        panel.spines[side].set_visible(False)
    panel.legend(fontsize=9, frameon=False, ncols=3, loc="lower right", bbox_to_anchor=(1, 1))
    return _svg(figure)


def _svg(figure: Any) -> str:
    """The figure as an SVG element, the same for the same figure."""
    import matplotlib as mpl

    buffer = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "metric-tree", "svg.fonttype": "path"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


@dataclass(frozen=True, slots=True)
class Linked:
    """A cell whose text leads to an address."""

    text: str
    url: str


def plain(text: object) -> str:
    """Text as HTML: no markup, and no characters that hide or turn round what stands beside them."""
    return escape(visible(str(text)))


def whole_page(title: str, note: str, sections: Iterable[tuple[str, str]]) -> str:
    """The page: a title, a note below it, sections of HTML with their titles and links to them."""
    parts = list(sections)
    links = "".join(f'<a href="#s{n}">{plain(name)}</a> ' for n, (name, _) in enumerate(parts))
    body = "\n".join(f"<h2 id=s{n}>{plain(name)}</h2>\n{content}" for n, (name, content) in enumerate(parts))
    return (
        '<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width">\n'
        f"<title>{plain(title)}</title>\n<style>{_STYLE}</style>\n"
        f"<h1>{plain(title)}</h1>\n<p class=note>{plain(note)}</p>\n<nav>{links}</nav>\n{body}\n"
        f"<script>{_SEARCH}</script>\n</html>\n"
    )


def paragraph(text: str, note: bool = False) -> str:
    """A paragraph of plain text."""
    return f"<p{' class=note' if note else ''}>{plain(text)}</p>\n"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table; a column stands to the right where all of its cells are numbers."""
    cells = [list(row) for row in rows]
    numeric = [bool(cells) and all(_NUMBER.match(_text(row[n])) for row in cells) for n in range(len(head))]
    lines = [_line(head, "th", numeric), *(_line(row, "td", numeric) for row in cells)]
    return "<div class=table><table>\n" + "\n".join(lines) + "\n</table></div>\n"


def search_table(name: str, label: str, head: Sequence[str], rows: Sequence[tuple[str, Sequence[object]]]) -> str:
    """A table with a box above it that leaves the rows whose words hold all that is typed.

    Parameters
    ----------
    name : id of the table in the page.
    label : what the box is for.
    head : titles of the columns.
    rows : words to search in, and cells, of each row.
    """
    numeric = [bool(rows) and all(_NUMBER.match(_text(cells[n])) for _, cells in rows) for n in range(len(head))]
    lines = [_line(head, "th", numeric), *(_line(cells, "td", numeric, words) for words, cells in rows)]
    return (
        f'<p><input type=search data-table={name} aria-label="{plain(label)}" placeholder="{plain(label)}"> '
        f"<span id={name}-count>{len(rows)}</span></p>\n"
        f"<div class=search><table id={name}>\n" + "\n".join(lines) + "\n</table></div>\n"
    )


def _line(cells: Iterable[object], tag: str, numeric: Sequence[bool], words: str | None = None) -> str:
    marks = (" class=n" if number else "" for number in numeric)
    start = "<tr>" if words is None else f'<tr data-words="{plain(words.lower())}">'
    return start + "".join(f"<{tag}{mark}>{_cell(c)}</{tag}>" for c, mark in zip(cells, marks, strict=True)) + "</tr>"


def _cell(cell: object) -> str:
    if isinstance(cell, Linked) and cell.url.startswith("https://"):
        return f'<a href="{plain(cell.url)}">{plain(cell.text)}</a>'
    return plain(_text(cell))


def _text(cell: object) -> str:
    if isinstance(cell, Linked):
        return str(cell.text)
    return f"{cell:,}" if isinstance(cell, int) else str(cell)


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


def thin_nodes(tree: Tree, limit: int) -> list[Node]:
    """The `limit` most used leaves that rest on few items or less, the thinnest evidence first."""
    uses = node_uses()
    thin = [node for node in tree.leaves() if node.prior_dims and node.tier not in SOUND and _use(node, uses)]
    used = sorted(thin, key=lambda node: (-_use(node, uses), node.node_id))[:limit]
    return sorted(used, key=lambda node: (-TIERS.index(node.tier or TIERS[-1]), -_use(node, uses), node.node_id))


def proofreading_page(tree: Tree, limit: int) -> str:
    """The page (HTML) for the `limit` most used nodes with thin evidence."""
    nodes = thin_nodes(tree, limit)
    note = (
        f"{len(nodes)} of the most used categories whose size rests on few items or less, the thinnest evidence first."
        " Sizes are in mm in the ordinary pose: nine of ten objects lie between low and high. Say of each whether it is"
        " right, and correct the numbers where it is not. What you save are rows to append to data/curated/ranges.csv."
    )
    head = "".join(f"<th>{plain(axis)} {end}</th>" for axis in AXES for end in _ENDS)
    table = (
        f"<table><tr><th>category</th><th>rests on</th>{head}<th>it is</th><th>why</th></tr>"
        f"{''.join(map(_row, nodes))}</table>"
    )
    name = '<p><label>Your name: <input id="reviewer"></label> <button id="save">Save as CSV</button></p>'
    content = f'{name}<div class="table">{table}</div><script>{_SCRIPT}</script>'
    return whole_page(f"{tree.name} {tree.version}: an hour of proofreading", note, [("Sizes", content)])


def _row(node: Node) -> str:
    prior = node.prior(node.prior_dims[0])
    evidence = prior.evidence
    counts = f"{evidence.rows:.0f} items of {evidence.sources} sources, {evidence.models} models" if evidence else ""
    cells = "".join(
        f'<td><input type="number" step="any" min="0" size="7" value="{value}" aria-label="{axis} {end}"></td>'
        for axis, values in zip(AXES, _ranges(node), strict=True)
        for end, value in zip(_ENDS, values, strict=True)
    )
    choices = '<option value=""></option>' + "".join(f"<option>{word}</option>" for word in ("right", "corrected"))
    return (
        f'<tr data-node="{plain(node.node_id)}"><td>{plain(node.name)}<br><small>{plain(" > ".join(node.path[1:-1]))}'
        f"</small></td><td>{plain(tier_words(node.tier or TIERS[-1]))}<br><small>{plain(counts)}</small></td>{cells}"
        f'<td><select aria-label="verdict">{choices}</select></td><td><input type="text" aria-label="why"></td></tr>'
    )


def _ranges(node: Node) -> Sequence[tuple[str, ...]]:
    """Low, typical and high of length, width and height as text; empty where the node has no such axis.

    A range that was written is shown as it was: the published interval is wider, as written ranges turned out too
    narrow, and a reader's word is a range again.
    """
    written = next((one for one in curated_ranges() if one.node_id == node.node_id), None)
    if written is not None:
        ends = zip(written.low, written.typical, written.high, strict=True)
        return [tuple("" if end is None else f"{end:.4g}" for end in axis) for axis in ends]
    prior = node.prior(node.prior_dims[0])
    quantiles = [prior.quantile(q) for q in INTERVAL_QUANTILES]
    names = AXES if prior.dims[0] in AXES else tuple(f"extent{number}" for number in (1, 2, 3))
    places = {dim: place for place, dim in enumerate(prior.dims)}
    return [
        tuple(f"{quantile[places[name]]:.4g}" for quantile in quantiles) if name in places else ("", "", "")
        for name in names
    ]


def _use(node: Node, uses: dict[str, float]) -> float:
    return uses.get(node.node_id, uses.get(node.node_id.removesuffix("/other"), 0.0))
