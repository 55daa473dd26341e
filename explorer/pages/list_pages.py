"""The pages of sources and of label lists."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from explorer.content.answers import vocabulary_answer
from explorer.content.release_catalogue import AXES, ReleaseCatalogue
from explorer.content.tiers import TIERS
from explorer.pages.templating import page_bytes, web_address
from explorer.urls import page_of
from metric_base.arrays import IntArray
from metric_tree.prior import MEDIAN
from metric_tree.tree import Node

__all__ = ["source_page", "sources_page", "vocabularies_page", "vocabulary_page"]

#: Fewest rows of a source in a category for a number of how far it lies from it.
LEAST_ROWS = 3


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
    labels = vocabulary_answer(catalogue, name).labels
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
