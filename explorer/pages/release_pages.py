"""Pages about a whole release: home, tree, about, compare, scale, sources, label lists and changes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from html import escape
from typing import Any

import numpy as np
from markupsafe import Markup

from explorer.catalogue import MEANINGS, ReleaseCatalogue
from explorer.charts.axis import length_text, svg
from explorer.everyday_sizes import all_axes_text
from explorer.pages.templating import main_dimension, page_bytes, web_address
from explorer.responses import medians, shown_name, vocabulary_response
from explorer.urls import page_of, slug
from metric_base.arrays import IntArray
from metric_tree.axes import DIMENSIONS
from metric_tree.node import Node
from metric_tree.prior import MEDIAN
from metric_tree.reports.diff import MovedPrior, ReleaseDiff, label, release_diff
from metric_tree.tiers import TIERS
from metric_tree.tree import Tree

_MOVED_HEAD = ("category", "dimension", "median before", "now", "median", "interval", "items that moved it")
#: Maximum number of rows of a table of changes.
MAX_ROWS = 200
#: Minimum number of rows of a source in a category to compare its sizes with the prior.
MIN_OFFSET_ROWS = 3
#: Categories of the home page, if the release has them.
TYPICAL = (
    "chair.n.01", "door.n.01", "mug.n.04", "car.n.01", "person.n.01", "bicycle.n.01", "bottle.n.01", "desk.n.01",
)  # fmt: skip
#: Size of the icicle chart in pixels, and its columns.
WIDTH, HEIGHT, LEVELS = 1000, 1400, 5
#: Minimum height of a node in pixels; smaller nodes are listed in the outline only.
MIN_NODE_HEIGHT_PX = 2.2
#: Minimum height of a node with its name, and width of a letter, in pixels.
MIN_NAMED_HEIGHT_PX, LETTER_WIDTH_PX = 11, 6.3
#: Minimum height in pixels of a node whose name is also legible on a phone, where the chart is a third as large.
MIN_LARGE_HEIGHT_PX = 32


def change_tables(
    diff: ReleaseDiff, link: Callable[[str], object]
) -> list[tuple[str, tuple[str, ...], list[tuple[Any, ...]], int]]:
    """Return title, head, first `MAX_ROWS` rows and number of rows of each table of changes that is not empty.

    `link` returns the cell of a node id. Both sizes of a row have the unit and the decimals of the smaller one.
    """

    def moved(one: MovedPrior) -> tuple[object, ...]:
        blame = ", ".join(f"{n:+} {source}" for source, n in list(one.blame.items())[:4]) or "no shipped item"
        sizes = (length_text(mm, min(one.before_mm, one.after_mm)) for mm in (one.before_mm, one.after_mm))
        return (link(one.node), one.dim, *sizes, f"{one.median:+.0%}", f"{one.spread:+.0%}", blame)

    counts = ("Categories", f"{diff.nodes_before:,}", f"{diff.nodes_after:,}")
    share = ("Priors that moved", "", f"{len(diff.priors):,} ({diff.share_moved:.0%} of those in both)")
    tables: list[tuple[str, tuple[str, ...], list[tuple[Any, ...]]]] = [
        ("Summary", ("count", "before", "now"), [counts, share]),
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
    return [(title, head, rows[:MAX_ROWS], len(rows)) for title, head, rows in tables if rows]


def change_page(catalogue: ReleaseCatalogue, other: Tree) -> bytes:
    """Return the page of the changes from another release to this one."""

    def link(node_id: str) -> object:
        node = catalogue.nodes.get(node_id)
        return Markup('<a href="../{}">{}</a>').format(page_of(node_id), node.name) if node is not None else node_id

    return page_bytes(
        catalogue,
        "changes.html",
        "../",
        f"What changed from {label(other)}",
        before=label(other),
        after=label(catalogue.tree),
        tables=change_tables(release_diff(other, catalogue.tree), link),
    )


def sources_page(catalogue: ReleaseCatalogue) -> bytes:
    """Return the page of all sources, the largest first."""
    rows = sorted(catalogue.sources.values(), key=lambda row: -int(row.get("n_fit") or 0))
    shown = [{"kind": "", "n_fit": 0, "n_rows": 0, "licence": "", **row} for row in rows]
    return page_bytes(catalogue, "sources.html", "../", "Sources", rows=shown)


def source_page(catalogue: ReleaseCatalogue, source_id: str) -> bytes:
    """Return the page of a source: its categories, and its sizes compared with the priors."""
    empty = {"kind": "", "licence": "", "attribution": "", "noncommercial": False, "withheld": False}
    source = {**empty, "n_fit": 0, "n_rows": 0, "url": "", **catalogue.sources[source_id]}
    rows = catalogue.rows_by_source.get(source_id, np.zeros(0, dtype=int))
    names = np.array(catalogue.published(rows)["node_id"].to_pylist(), dtype=object)
    classes, offsets = [], []
    for node_id, n in Counter(names.tolist()).most_common():
        node = catalogue.nodes[node_id]
        offset = median_offset(catalogue, node, rows[names == node_id]) if n >= MIN_OFFSET_ROWS else None
        if offset is not None:
            offsets.append(offset)
        classes.append(
            {"name": node.name, "href": page_of(node_id), "tier": catalogue.tier(node), "n": n, "off": offset}
        )
    distance = ""
    if offsets:
        count = f"{len(offsets)} categor{'y' if len(offsets) == 1 else 'ies'}"
        median = float(np.median(np.abs(offsets)))
        distance = f"Over {count} its median size is {median:.0%} from the category's in the middle."
    return page_bytes(
        catalogue,
        "source.html",
        "../",
        source["title"],
        source=source,
        url=web_address(source["url"]),
        classes=classes,
        distance=distance,
    )


def median_offset(catalogue: ReleaseCatalogue, node: Node, rows: IntArray) -> float | None:
    """Return the ratio of the median size of rows to that of the prior, minus 1, as geometric mean over dimensions.

    Dimensions with fewer than `MIN_OFFSET_ROWS` sizes are ignored; None if none is left.
    """
    dims = catalogue.dims(node)
    sizes = catalogue.sizes[rows][:, [DIMENSIONS.index(dim) for dim in dims]]
    known = [k for k in range(len(dims)) if (~np.isnan(sizes[:, k])).sum() >= MIN_OFFSET_ROWS]
    if not known:
        return None
    ratios = np.nanmedian(sizes[:, known], axis=0) / catalogue.quantiles(node)[MEDIAN][known]
    return round(float(np.exp(np.log(ratios).mean()) - 1), 4)


def vocabularies_page(catalogue: ReleaseCatalogue) -> bytes:
    """Return the page of all label lists with the tiers of their labels."""
    rows = []
    for name, labels in catalogue.vocabularies.items():
        nodes = [catalogue.nodes[label.node_id] for label in labels if label.node_id in catalogue.nodes]
        tiers = Counter(catalogue.tier(node) for node in nodes)
        counts = [tiers.get(tier, 0) for tier in TIERS]
        rows.append({"name": name, "labels": len(labels), "sized": len(nodes), "tiers": counts})
    return page_bytes(catalogue, "vocabularies.html", "../", "Labels", rows=rows)


def vocabulary_page(catalogue: ReleaseCatalogue, name: str) -> bytes:
    """Return the page of a label list: node, tier and size of each label."""
    labels = vocabulary_response(catalogue, name).labels
    medians_mm = [sizes[main_dimension(sizes)]["0.5"] for row in labels if (sizes := row.quantiles_mm)]
    return page_bytes(catalogue, "vocabulary.html", "../", name, name=name, labels=labels, medians=medians_mm)


def home_page(catalogue: ReleaseCatalogue) -> bytes:
    """Return the home page."""
    nodes = [
        catalogue.nodes[node_id]
        for node_id in TYPICAL
        if node_id in catalogue.nodes and catalogue.dims(catalogue.nodes[node_id])
    ]
    counts = Counter(catalogue.tier(node) for node in catalogue.nodes.values())
    return page_bytes(
        catalogue,
        "home.html",
        "",
        "How large are things?",
        counts=catalogue.tree.release.manifest["counts"],
        example=slug((nodes or [catalogue.tree.root])[0].node_id),
        cards=[(node, shown_name(node), all_axes_text(node, medians(catalogue, node))) for node in nodes],
        realms=sorted(catalogue.tree.root.children, key=lambda node: -node.n_items),
        tier_rows=[
            (tier, meaning, counts[tier]) for tier, meaning in MEANINGS.items() if tier in TIERS or counts[tier]
        ],
        releases=[(tree.version, label(tree), catalogue.relative_root(tree)) for tree in catalogue.others],
    )


def tree_page(catalogue: ReleaseCatalogue) -> bytes:
    """Return the page with the outline of the tree and its icicle chart."""
    root = catalogue.tree.root
    areas = Markup(icicle(root, catalogue.tier))
    return page_bytes(catalogue, "tree.html", "", "The tree", top=root, tier=catalogue.tier, areas=areas)


def icicle(root: Node, tier: Callable[[Node], str]) -> str:
    """Return the icicle chart of a tree as SVG; each area is a link to its node.

    A column is a level, the height of an area is the fraction of the items, its colour is the tier.
    """
    title = "The tree: five columns for five levels; a node's height is its share of the items, its colour the tier"
    drawing = svg(WIDTH, HEIGHT, title, "".join(_areas(root, 0.0, HEIGHT, tier)), "icicle")
    return drawing.replace('role="img"', 'role="group"', 1)  # its links are read one by one


def _areas(node: Node, top: float, bottom: float, tier: Callable[[Node], str]) -> Iterator[str]:
    height = bottom - top
    if height < MIN_NODE_HEIGHT_PX:
        return
    column = WIDTH / LEVELS
    x, kind = (node.level - 1) * column, tier(node)
    said = f"{node.name}, {kind}, {node.n_items:,} items"
    shown = node.name
    if len(node.name) * LETTER_WIDTH_PX >= column - 10:
        shown = f"{node.name[: int(column / LETTER_WIDTH_PX) - 3]}…"
    kind_of_text = ' class="large"' if height >= MIN_LARGE_HEIGHT_PX else ""
    text = f'<text{kind_of_text} x="{x + 5:.0f}" y="{top + min(height / 2 + 4, 14):.1f}">{escape(shown)}</text>'
    yield (
        f'<a href="{escape(page_of(node.node_id))}"><rect class="tier-{kind}" x="{x:.0f}" y="{top:.1f}" '
        f'width="{column - 1:.0f}" height="{max(height - 0.7, 0.5):.1f}"/><title>{escape(said)}</title>'
        f"{text if height >= MIN_NAMED_HEIGHT_PX else ''}</a>"
    )
    children = sorted(node.children, key=lambda one: -one.n_items)
    total = sum(child.n_items for child in children)
    for child in children:
        share = height * child.n_items / total if total else 0
        yield from _areas(child, top, top + share, tier)
        top += share
