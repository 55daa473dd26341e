"""The page of a node.

Categories on one axis: a bar from the 5 % to the 95 % quantile and a mark at the median.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any
from urllib.parse import quote

import numpy as np
from markupsafe import Markup

from explorer.catalogue import AXES, ReleaseCatalogue
from explorer.charts.axis import LogAxis, length_text
from explorer.charts.distributions import KINDS, distribution, scatter
from explorer.charts.size_comparison import DrawnBox, size_comparison
from explorer.pages.templating import main_dimension, page_bytes, web_address
from explorer.responses import node_response, outside_links, shown_name
from explorer.urls import LISTED_LEVEL, MIN_PARQUET_ROWS, csv_of, json_of, page_of, parquet_of, prior_of, slug
from metric_base.arrays import FloatArray, IntArray
from metric_base.regions import region_of
from metric_tree.context import Where
from metric_tree.node import Node
from metric_tree.prior import INTERVAL_QUANTILES, QUANTILES, Prior

#: Maximum number of rows of a comparison of nodes.
MAX_ROWS = 9
#: Minimum fraction of the most frequent dimension's rows for a dimension to be the axis.
MIN_AXIS_FRACTION = 0.8
#: Maximum number of items in the page; the browser loads the others on demand.
MAX_ITEMS = 16
#: Images of a page, and pixels of the largest one's longest side; no image is drawn smaller than the least.
MAX_IMAGES, MAX_IMAGE_PX, MIN_IMAGE_PX = 12, 180, 12
#: Maximum number of steps of the slider of years.
MAX_YEAR_STEPS = 9
#: Minimum number of items for a scatter chart.
MIN_SCATTER_ITEMS = 5
ISSUES = "https://github.com/metric-tree/metric-tree/issues/new"


def multiples(catalogue: ReleaseCatalogue, nodes: Sequence[Node], beside: Node) -> dict[str, Any] | None:
    """The rows, the axis and how many nodes were left out; None where there is nothing to show.

    nodes : those with most items come first; beside : the node of the page, which is always among those shown, and
    whose main dimension is the axis's.
    """
    if not nodes:
        return None
    order = sorted(nodes, key=lambda node: (node is not beside, -node.n_items, node.name))
    shown = sorted(order[:MAX_ROWS], key=lambda node: (-node.n_items, node.name))
    dim = main_dimension(_common(catalogue, shown))
    spans: dict[str, tuple[float, float, float] | None] = {node.node_id: _span(catalogue, node, dim) for node in shown}
    known = [span for span in spans.values() if span is not None]
    if not known:
        return None
    axis = LogAxis(min(span[0] for span in known), max(span[2] for span in known) * 1.001, 0, 100)
    return {
        "dim": dim,
        "low": axis.low,
        "high": axis.high,
        "more": len(nodes) - len(shown),
        "href": page_of(beside.parent_id) if beside.parent_id else "",
        "rows": [_row(catalogue, node, spans[node.node_id], axis) for node in shown],
    }


def _common(catalogue: ReleaseCatalogue, nodes: Sequence[Node]) -> list[str]:
    """Dimensions by how many of the nodes have them, the height first among those of most."""
    counts: dict[str, int] = {}
    for node in nodes:
        for dim in catalogue.dims(node):
            counts[dim] = counts.get(dim, 0) + 1
    most = max(counts.values(), default=0)
    return [dim for dim, count in counts.items() if count >= MIN_AXIS_FRACTION * most]


def _span(catalogue: ReleaseCatalogue, node: Node, dim: str) -> tuple[float, float, float] | None:
    dims = catalogue.dims(node)
    if dim not in dims:
        return None
    table = catalogue.quantiles(node)
    low, middle, high = table[::2, dims.index(dim)]
    return float(low), float(middle), float(high)


def _row(
    catalogue: ReleaseCatalogue, node: Node, span: tuple[float, float, float] | None, axis: LogAxis
) -> dict[str, Any]:
    return {
        "node": node.node_id,
        "name": node.name,
        "href": f"{slug(node.node_id)}.html",
        "tier": catalogue.tier(node),
        "bar": None if span is None else [f"{axis.at(mm):.1f}" for mm in span],
        "median": None if span is None else span[1],
    }


def node_page(catalogue: ReleaseCatalogue, node: Node) -> bytes:
    """The page of a node."""
    answer = node_response(catalogue, node)
    prior, rows = catalogue.prior(node), catalogue.rows(node)
    sizes, kinds = catalogue.sizes[rows], catalogue.kinds[rows]
    table = catalogue.quantiles(node)
    plot, plot_dims = _scatter(prior, sizes, kinds) if prior else ("", "")
    siblings = node.parent.children if node.parent else ()
    return page_bytes(
        catalogue,
        "node.html",
        "../",
        node.name,
        description=answer.sentence,
        node=node,
        slug=slug(node.node_id),
        answer=answer,
        line=[
            {"name": name, "href": page_of(node_id)} for name, node_id in zip(answer.path, answer.path_ids, strict=True)
        ],
        evidence=_evidence(node, answer.n_sources),
        quantiles=QUANTILES,
        sizes=list(zip(answer.dims, table.T.tolist(), strict=True)),
        drawing=Markup(size_comparison(shown_name(node), _box(prior, table))) if prior else "",
        distributions=[
            (dim, Markup(_distribution(dim, prior, table[::2, place], sizes, kinds)))
            for place, dim in enumerate(prior.dims)
        ]
        if prior
        else [],
        scatter=Markup(plot) if plot else "",
        scatter_dims=plot_dims,
        kinds=[kind for kind in KINDS if (kinds == kind).any()],
        context=_context(node, prior) if prior else None,
        source_rows=[_source_row(catalogue, name, n) for name, n in answer.shipped["source"].items()],
        facts=_facts(catalogue, rows, answer.shipped["region"]),
        children=multiples(catalogue, node.children, node),
        siblings=multiples(catalogue, siblings, node) if len(siblings) > 1 else None,
        pictures=_pictures(catalogue, node),
        items=[_item(catalogue, row) for row in _spread(rows, sizes)],
        n_shipped=len(rows),
        listed=node.level >= LISTED_LEVEL,
        parquet=len(rows) >= MIN_PARQUET_ROWS,
        dims_code="(" + ", ".join(f'"{dim}"' for dim in answer.dims) + ("," if len(answer.dims) == 1 else "") + ")",
        json_href=json_of(node.node_id),
        prior_href=prior_of(node.node_id),
        csv_href=csv_of(node.node_id),
        parquet_href=parquet_of(node.node_id),
        outside=outside_links(catalogue, node),
        report_href=_report(catalogue, node),
    )


def _evidence(node: Node, n_sources: int) -> str:
    items = f"{node.n_items:,} item{'' if node.n_items == 1 else 's'}"
    sources = f"{n_sources} source{'' if n_sources == 1 else 's'}"
    return f"From {items} and {sources}." if node.n_items else f"From no real item, and {sources}."


def _distribution(dim: str, prior: Prior, interval: FloatArray, sizes: FloatArray, kinds: Any) -> str:
    column = sizes[:, AXES.index(dim)]
    known = ~np.isnan(column)
    return distribution(dim, prior.marginal((dim,)), interval, column[known], kinds[known])


def _scatter(prior: Prior, sizes: FloatArray, kinds: Any) -> tuple[str, str]:
    """Length against height where there are items with both, else the first two dimensions; and what was drawn."""
    dims = prior.dims
    pair = ("length", "height") if {"length", "height"} <= set(dims) else dims[:2]
    if len(pair) < 2:
        return "", ""
    columns = sizes[:, [AXES.index(dim) for dim in pair]]
    known = ~np.isnan(columns).any(axis=1)
    if known.sum() < MIN_SCATTER_ITEMS:
        return "", ""
    return scatter(prior.marginal(pair), columns[known], kinds[known]), f"{pair[0]} against {pair[1]}"


def _box(prior: Prior, table: FloatArray) -> DrawnBox:
    """What is drawn to scale: length across, height up and width deep; a dimension that is not known is another's."""
    spans = {dim: tuple(float(v) for v in table[::2, k]) for k, dim in enumerate(prior.dims)}
    names = list(spans)
    across = next((dim for dim in ("length", "extent1", "width", *names) if dim in spans), names[0])
    up = next(
        (dim for dim in ("height", "extent2", "width", "length", *names) if dim in spans and dim != across), across
    )
    deep = next((dim for dim in ("width", "extent3", *names) if dim in spans and dim not in {across, up}), None)
    triple = {dim: (v[0], v[1], v[2]) for dim, v in spans.items()}
    return DrawnBox(triple[across], triple[up], triple[deep] if deep else None, (across, up, deep or ""))


def _context(node: Node, prior: Prior) -> dict[str, Any] | None:
    """Quantiles by region and year, where the contexts of the prior state some; None where they do not."""
    regions = sorted(
        {region for one in prior.contexts if (region := region_of(one.region or "world")) and region != "world"}
    )
    years = [one.year for one in prior.contexts if one.year is not None]
    if node.tree.context_model is None or not (regions or years):
        return None
    steps = _year_steps(min(years), max(years)) if years else []
    asked: list[float | None] = [*steps] or [None]
    table: dict[str, list[list[list[float]]]] = {}
    for region in ("world", *regions):
        table[region] = []
        for year in asked:
            where = Where(None if region == "world" else region, year)
            plain = where.region is None and where.year is None
            moved = prior if plain else node.prior(prior.dims, where)
            rows = moved.quantiles(INTERVAL_QUANTILES).T
            table[region].append([[float(f"{mm:.4g}") for mm in row] for row in rows])
    return {"regions": list(table), "years": [round(year) for year in steps], "table": table}


def _year_steps(first: float, last: float) -> list[float]:
    """Round years from the first to the last."""
    step = next(
        step for step in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if (last - first) / step < MAX_YEAR_STEPS - 1
    )
    years = range(int(first // step * step), int(math.ceil(last / step) * step) + 1, step)
    return [float(year) for year in years]


def _source_row(catalogue: ReleaseCatalogue, name: str, n: int) -> dict[str, Any]:
    record = catalogue.sources.get(name, {})
    return {
        "id": name,
        "title": record.get("title", name),
        "kind": record.get("kind", ""),
        "licence": record.get("licence") or "none stated",
        "n": n,
    }


def _facts(catalogue: ReleaseCatalogue, rows: IntArray, regions: dict[str, int]) -> str:
    years = [year for year in catalogue.items["year"].take(rows).to_pylist() if year is not None]
    parts = []
    if years:
        parts.append(f"Years {min(years)} to {max(years)} ({len(years):,} items state one).")
    stated = {region: n for region, n in regions.items() if region != "unstated"}
    if stated:
        parts.append("Regions: " + ", ".join(f"{region} {n:,}" for region, n in stated.items()) + ".")
    return " ".join(parts)


def _spread(rows: IntArray, sizes: FloatArray) -> IntArray:
    """Rows of the items that a page shows: spread over the sizes, the largest first."""
    largest = np.nanmax(np.nan_to_num(sizes), axis=1) if len(rows) else np.zeros(0)
    order = np.argsort(-largest, kind="stable")
    chosen = np.linspace(0, len(order) - 1, min(MAX_ITEMS, len(order))).astype(int)
    spread: IntArray = rows[order[chosen]]
    return spread


def _item(catalogue: ReleaseCatalogue, row: int) -> dict[str, Any]:
    (item,) = catalogue.items.slice(int(row), 1).to_pylist()
    sizes: Sequence[float | None] = [item[f"{dim}_mm"] for dim in ("length", "width", "height")]
    if not any(sizes):
        sizes = [*(item["extents_mm"] or ()), None, None, None][:3]
    return {**item, "sizes": sizes, "url": web_address(item["url"]), "title": (item["title"] or item["item_id"])[:90]}


def _pictures(catalogue: ReleaseCatalogue, node: Node) -> list[dict[str, Any]]:
    """Cut-out images with their items' sizes, all to one scale."""
    found: list[tuple[dict[str, Any], dict[str, Any], str, float]] = []
    for image in catalogue.images(node):
        path, row = image["cutout_path"] or image["path"], catalogue.item_rows.get(image["item_id"])
        if path is None or row is None or len(found) >= 4 * MAX_IMAGES:
            continue
        (item,) = catalogue.items.slice(row, 1).to_pylist()
        if item["extents_mm"]:
            found.append((image, item, path, _longest_side_mm(image, item)))
    chosen = [found[k] for k in np.linspace(0, len(found) - 1, min(len(found), MAX_IMAGES)).astype(int)]
    largest = max((longest for *_, longest in chosen), default=1.0)
    return [_picture(image, item, path, longest / largest) for image, item, path, longest in chosen]


def _longest_side_mm(image: dict[str, Any], item: dict[str, Any]) -> float:
    """How long the longer side of an image is: by its own scale if it states one, else as long as the item."""
    side, scale = max(image["width_px"], image["height_px"]), image["pixels_per_metre"]
    return float(1000 * side / scale if scale else max(item["extents_mm"]))


def _picture(image: dict[str, Any], item: dict[str, Any], path: str, share: float) -> dict[str, Any]:
    side = max(image["width_px"], image["height_px"])
    pixels = max(share * MAX_IMAGE_PX, MIN_IMAGE_PX) / side
    credit = image.get("attribution") or f"{item['source']} ({image['licence'] or 'no licence stated'})"
    return {
        "path": path,
        "title": item["title"] or item["item_id"],
        "width": max(1, round(image["width_px"] * pixels)),
        "height": max(1, round(image["height_px"] * pixels)),
        "size": " × ".join(length_text(mm) for mm in item["extents_mm"]),
        "credit": credit if len(credit) < 160 else credit[:157] + "…",
        "url": web_address(image["source_url"]),
    }


def _report(catalogue: ReleaseCatalogue, node: Node) -> str:
    body = f"Node: {node.node_id}\nRelease: {catalogue.tree.version}\n\nWhat is wrong:\n\nA source:\n"
    return f"{ISSUES}?title={quote(f'{node.name}: ')}&body={quote(body)}"
