"""The pages about the whole release: home, the tree, about, compare, scale.

The page of what changed since another release.

The pages of sources and of label lists.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from explorer.catalogue import AXES, MEANINGS, ReleaseCatalogue
from explorer.charts.axis import length_text
from explorer.charts.icicle import icicle
from explorer.pages.templating import page_bytes, web_address
from explorer.responses import sentence, shown_name, vocabulary_response
from explorer.urls import page_of
from metric_base.arrays import IntArray
from metric_tree.node import Node
from metric_tree.prior import MEDIAN
from metric_tree.reports.diff import MovedPrior, label, release_diff
from metric_tree.tiers import TIERS
from metric_tree.tree import Tree

_MOVED_HEAD = ("category", "dimension", "median before", "now", "median", "interval", "items that moved it")
#: Rows of a table.
MOST_ROWS = 200
#: Fewest rows of a source in a category for a number of how far it lies from it.
LEAST_ROWS = 3
#: Categories of the home page, those that the release has.
TYPICAL = (
    "chair.n.01", "door.n.01", "mug.n.04", "car.n.01", "person.n.01", "bicycle.n.01", "bottle.n.01", "desk.n.01",
)  # fmt: skip
#: An example for the scale page: objects measured in a scene whose unit is 2 m.
EXAMPLE = {
    "schema": "metric-tree/objects/1",
    "objects": [
        {"id": "chair 1", "category": "chair", "dimensions": {"length": 0.27, "width": 0.26, "height": 0.45}},
        {"id": "table 2", "category": "dining table", "dimensions": {"height": 0.37}},
        {"id": "mug 3", "category": "mug", "dimensions": {"height": 0.049}},
        {"id": "bottle 4", "category": "bottle", "dimensions": {"height": 0.13}},
    ],
}


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


def sources_page(catalogue: ReleaseCatalogue) -> bytes:
    """All sources, the largest first."""
    rows = sorted(catalogue.sources.values(), key=lambda row: -int(row.get("n_fit") or 0))
    shown = [{"kind": "", "n_fit": 0, "n_rows": 0, "licence": "", **row} for row in rows]
    return page_bytes(catalogue, "sources.html", "../", "Sources", rows=shown)


def source_page(catalogue: ReleaseCatalogue, source_id: str) -> bytes:
    """What a source is, its categories, and how far it lies from the others."""
    empty = {"kind": "", "licence": "", "attribution": "", "noncommercial": False, "withheld": False}
    source = {**empty, "n_fit": 0, "n_rows": 0, "url": "", **catalogue.sources[source_id]}
    rows = catalogue.rows_by_source.get(source_id, np.zeros(0, dtype=int))
    classes = _classes(catalogue, rows)
    return page_bytes(
        catalogue,
        "source.html",
        "../",
        source["title"],
        source=source,
        url=web_address(source["url"]),
        classes=classes,
        distance=_distance([row["off"] for row in classes if row["off"] is not None]),
    )


def vocabularies_page(catalogue: ReleaseCatalogue) -> bytes:
    """All label lists with the tiers of their labels."""
    rows = []
    for name, labels in catalogue.vocabularies.items():
        nodes = [catalogue.nodes[label.node_id] for label in labels if label.node_id in catalogue.nodes]
        tiers = Counter(catalogue.tier(node) for node in nodes)
        counts = [tiers.get(tier, 0) for tier in TIERS]
        rows.append({"name": name, "labels": len(labels), "sized": len(nodes), "tiers": counts})
    return page_bytes(catalogue, "vocabularies.html", "../", "Labels", rows=rows)


def vocabulary_page(catalogue: ReleaseCatalogue, name: str) -> bytes:
    """Each label of a list, its node, its tier and its size."""
    labels = vocabulary_response(catalogue, name).labels
    return page_bytes(catalogue, "vocabulary.html", "../", name, name=name, labels=labels)


def _classes(catalogue: ReleaseCatalogue, rows: IntArray) -> list[dict[str, Any]]:
    """The nodes of a source's rows, those of most rows first."""
    names = np.array(catalogue.items["node_id"].take(rows).to_pylist(), dtype=object)
    found = []
    for node_id, n in Counter(names.tolist()).most_common():
        node = catalogue.nodes[node_id]
        off = _off(catalogue, node, rows[names == node_id]) if n >= LEAST_ROWS else None
        tier = catalogue.tier(node)
        found.append({"name": node.name, "href": page_of(node_id), "tier": tier, "n": n, "off": off})
    return found


def _off(catalogue: ReleaseCatalogue, node: Node, rows: IntArray) -> float | None:
    """The median of rows over that of the prior, less one; the geometric mean over the dimensions that both have."""
    dims = catalogue.dims(node)
    sizes = catalogue.sizes[rows][:, [AXES.index(dim) for dim in dims]]
    known = [k for k in range(len(dims)) if (~np.isnan(sizes[:, k])).sum() >= LEAST_ROWS]
    if not known:
        return None
    ratios = np.nanmedian(sizes[:, known], axis=0) / catalogue.quantiles(node)[MEDIAN][known]
    return round(float(np.exp(np.log(ratios).mean()) - 1), 4)


def _distance(offs: list[float]) -> str:
    if not offs:
        return ""
    middle = float(np.median(np.abs(offs)))
    count = f"{len(offs)} categor{'y' if len(offs) == 1 else 'ies'}"
    return f"Over {count} its median size is {middle:.0%} from the category's in the middle."


def home_page(catalogue: ReleaseCatalogue) -> bytes:
    """The first page."""
    nodes = [catalogue.nodes[node_id] for node_id in TYPICAL if node_id in catalogue.nodes]
    counts = dict(catalogue.tier_counts())
    return page_bytes(
        catalogue,
        "home.html",
        "",
        "How large are things?",
        counts=catalogue.tree.release.manifest["counts"],
        cards=[
            {
                "name": shown_name(node),
                "href": page_of(node.node_id),
                "tier": catalogue.tier(node),
                "sentence": sentence(catalogue, node),
            }
            for node in nodes
        ],
        realms=[
            {"name": node.name, "href": page_of(node.node_id), "n_items": node.n_items}
            for node in sorted(catalogue.tree.root.children, key=lambda node: -node.n_items)
        ],
        tier_rows=[
            (tier, meaning, counts.get(tier, 0))
            for tier, meaning in MEANINGS.items()
            if tier in TIERS or counts.get(tier)
        ],
        releases=_releases(catalogue),
    )


def tree_page(catalogue: ReleaseCatalogue) -> bytes:
    """The outline of the five levels, and the tree as areas."""
    root = catalogue.tree.root
    areas = Markup(icicle(root, catalogue.tier))
    return page_bytes(catalogue, "tree.html", "", "The tree", top=root, tier=catalogue.tier, areas=areas)


def about_page(catalogue: ReleaseCatalogue) -> bytes:
    """What the sizes and the tiers mean."""
    return page_bytes(catalogue, "about.html", "", "About these sizes")


def compare_page(catalogue: ReleaseCatalogue) -> bytes:
    """Up to six nodes on one axis; the browser draws them from `assets/sizes.js`."""
    return page_bytes(catalogue, "compare.html", "", "Compare")


def scale_page(catalogue: ReleaseCatalogue) -> bytes:
    """Results and measured objects, read in the browser."""
    return page_bytes(catalogue, "scale.html", "", "The scale of a scene", example=EXAMPLE)


def _releases(catalogue: ReleaseCatalogue) -> list[dict[str, Any]]:
    here: dict[str, Any] = {"name": label(catalogue.tree), "href": "index.html", "changes": None}
    others = [
        {
            "name": label(tree),
            "href": f"{catalogue.relative_root(tree)}index.html",
            "changes": f"changes/{tree.version}.html",
        }
        for tree in catalogue.others
    ]
    return [here, *others]
