"""The page of a category: its sizes with charts, evidence, related categories, images and items."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import quote

import numpy as np
from markupsafe import Markup

from explorer.catalogue import ReleaseCatalogue
from explorer.charts.axis import LogAxis
from explorer.charts.distributions import KINDS, distribution, scatter
from explorer.charts.size_comparison import DrawnBox, size_comparison
from explorer.everyday_sizes import axis_words, product_text
from explorer.pages.templating import main_dimension, page_bytes, web_address
from explorer.responses import node_response, outside_links, shown_name
from explorer.urls import page_of, slug
from metric_base.arrays import FloatArray, IntArray
from metric_base.regions import region_of
from metric_tree.axes import AXES, DIMENSIONS
from metric_tree.context import Where
from metric_tree.node import Node
from metric_tree.prior import INTERVAL_QUANTILES, MEDIAN, QUANTILES, Prior
from metric_tree.reports.stated_axes import axis_names

#: Maximum number of rows of a comparison of categories.
MAX_ROWS = 9
#: Minimum frequency of a dimension among the categories, relative to the most frequent one, to be the axis.
MIN_AXIS_FRACTION = 0.8
#: Maximum number of items in the page; the browser loads the others on demand.
MAX_ITEMS = 16
#: Maximum number of items that the browser loads on demand: a table of more rows takes seconds.
MAX_LOADED_ITEMS = 5000
#: Maximum number of images in the page.
MAX_IMAGES = 12
#: Longest side of the largest image in pixels.
MAX_IMAGE_PX = 180
#: Minimum longest side of an image in pixels.
MIN_IMAGE_PX = 12
#: Maximum length of the credit of an image in characters.
MAX_CREDIT_CHARS = 160
#: Maximum number of steps of the slider of years.
MAX_YEAR_STEPS = 9
#: Minimum number of items for a scatter chart.
MIN_SCATTER_ITEMS = 5
#: Minimum share of a kind of evidence in the prior whose items are in the charts; those of others do not agree with it.
MIN_DRAWN_SHARE = 0.01
#: Kinds of evidence of a range or a default, which is no item.
_JUDGED = ("judged", "default")
ISSUES = "https://github.com/metric-tree/metric-tree/issues/new"


def node_page(catalogue: ReleaseCatalogue, node: Node) -> bytes:
    """Return the page of a category."""
    answer = node_response(catalogue, node)
    prior, rows, names = catalogue.prior(node), catalogue.rows(node), axis_names(node)
    sizes, kinds = catalogue.sizes[rows], catalogue.kinds[rows]
    table = catalogue.quantiles(node)
    drawing, plot, plot_dims, distributions = "", "", "", []
    drawn_kinds: list[str] = []
    if prior is not None:
        shares = prior.share_by_kind
        drawn_kinds = [kind for kind in KINDS if kind not in _JUDGED and shares.get(kind, 0) >= MIN_DRAWN_SHARE]
        is_drawn = np.isin(kinds, drawn_kinds)
        drawing = size_comparison(shown_name(node), drawn_box(prior, table, names))
        for place, dim in enumerate(prior.dims):
            column = sizes[:, DIMENSIONS.index(dim)]
            known = ~np.isnan(column) & is_drawn
            is_norm = answer.tier == "norm"
            chart = distribution(dim, prior.marginal((dim,)), table[::2, place], column[known], kinds[known], is_norm)
            distributions.append((dim, Markup(chart)))
        # length against height if both exist, otherwise the first two dimensions
        pair = ("length", "height") if {"length", "height"} <= set(prior.dims) else prior.dims[:2]
        columns = sizes[:, [DIMENSIONS.index(dim) for dim in pair]]
        complete = ~np.isnan(columns).any(axis=1) & is_drawn
        if len(pair) == 2 and complete.sum() >= MIN_SCATTER_ITEMS:
            plot = scatter(prior.marginal(pair), columns[complete], kinds[complete])
            plot_dims = " against ".join(names.get(dim, dim) for dim in pair)
    source_rows = [
        {"title": name, "kind": "", "licence": "", **catalogue.sources.get(name, {}), "id": name, "n": n}
        for name, n in answer.shipped["source"].items()
    ]
    named = (name for name in node.sources if name not in answer.shipped["source"])
    withheld = [catalogue.sources[name] for name in named if catalogue.sources.get(name, {}).get("withheld")]
    n_unnamed = max(0, answer.n_sources - len(source_rows) - len(withheld))
    siblings = node.parent.children if node.parent else ()
    is_judged = np.isin(kinds, _JUDGED)
    is_listed = ~is_judged | is_judged.all()
    report = f"Node: {node.node_id}\nRelease: {catalogue.tree.version}\n\nWhat is wrong:\n\nA source:\n"
    return page_bytes(
        catalogue,
        "node.html",
        "../",
        node.name,
        description=answer.sentence,
        node=node,
        slug=slug(node.node_id),
        answer=answer,
        line=[(name, page_of(node_id)) for name, node_id in zip(answer.path, answer.path_ids, strict=True)],
        quantiles=QUANTILES,
        axis_words=axis_words(node),
        axis_names=names,
        sizes=list(zip(answer.dims, table.T.tolist(), strict=True)),
        drawing=Markup(drawing),
        distributions=distributions,
        scatter=Markup(plot),
        scatter_dims=plot_dims,
        kinds=[kind for kind in drawn_kinds if (kinds == kind).any()],
        omitted_kinds=sorted(set(kinds) - {*drawn_kinds, *_JUDGED}),
        context=context_table(node, prior) if prior is not None else None,
        source_rows=source_rows,
        withheld=withheld,
        n_unnamed=n_unnamed,
        n_sources=len(source_rows) + len(withheld) + n_unnamed,
        percents=whole_percents(answer.share_by_kind),
        years=[year for year in catalogue.published(rows)["year"].to_pylist() if year is not None],
        children=category_bars(catalogue, node.children, node),
        siblings=category_bars(catalogue, siblings, node) if len(siblings) > 1 else None,
        pictures=images_to_scale(catalogue, node),
        items=items_by_size(catalogue, rows[is_listed], sizes[is_listed]),
        n_listed=int(is_listed.sum()),
        max_loaded=MAX_LOADED_ITEMS,
        dims_code="(" + ", ".join(f'"{dim}"' for dim in answer.dims) + ("," if len(answer.dims) == 1 else "") + ")",
        outside=outside_links(catalogue, node),
        report_href=f"{ISSUES}?title={quote(f'{node.name}: ')}&body={quote(report)}",
    )


def whole_percents(shares: Mapping[str, float]) -> dict[str, int]:
    """Return shares as whole percentages that sum to 100 (largest remainders), empty without shares."""
    total = sum(shares.values())
    exact = {kind: 100 * share / total for kind, share in shares.items() if share}
    percents = dict.fromkeys(shares, 0) | {kind: int(value) for kind, value in exact.items()}
    for kind in sorted(exact, key=lambda kind: percents[kind] - exact[kind])[: 100 - sum(percents.values())]:
        percents[kind] += 1
    return percents


def category_bars(catalogue: ReleaseCatalogue, nodes: Sequence[Node], current: Node) -> dict[str, Any] | None:
    """Return a chart of categories on one axis: a bar from the 5 % to the 95 % quantile, and the median.

    Parameters
    ----------
    nodes : sequence of Node
        Categories; those with most items are shown, and `current` if it is one of them.
    current : Node
        The category of the page.

    Returns
    -------
    dict or None
        Rows (positions in percent), ends of the axis in mm, its dimension, and the number of omitted categories; None
        if no category has the dimension of the axis.
    """
    order = sorted(nodes, key=lambda node: (node is not current, -node.n_items, node.name))
    shown = sorted(order[:MAX_ROWS], key=lambda node: (-node.n_items, node.name))
    counts = Counter(dim for node in shown for dim in catalogue.dims(node))
    enough = MIN_AXIS_FRACTION * max(counts.values(), default=0)
    dim = main_dimension([dim for dim, count in counts.items() if count >= enough])
    spans: dict[str, list[float]] = {}
    for node in shown:
        if dim in (dims := catalogue.dims(node)):
            spans[node.node_id] = catalogue.quantiles(node)[::2, dims.index(dim)].tolist()
    if not spans:
        return None
    axis = LogAxis(min(low for low, *_ in spans.values()), max(high for *_, high in spans.values()) * 1.001, 0, 100)
    rows = []
    for node in shown:
        span = spans.get(node.node_id)
        rows.append(
            {
                "node": node.node_id,
                "name": node.name,
                "href": f"{slug(node.node_id)}.html",
                "tier": catalogue.tier(node),
                "bar": [f"{axis.at(mm):.1f}" for mm in span] if span else None,
                "median": span[1] if span else None,
            }
        )
    href = page_of(current.parent_id) if current.parent_id else ""
    dim = axis_names(current).get(dim, dim)
    return {"dim": dim, "low": axis.low, "high": axis.high, "more": len(nodes) - len(shown), "href": href, "rows": rows}


def drawn_box(prior: Prior, table: FloatArray, names: Mapping[str, str]) -> DrawnBox:
    """Return the box to draw: length or the first dimension across, height up, width deep.

    A dimension that the prior lacks is replaced by another one. `names` are those of `axis_names`.
    """
    spans: dict[str, tuple[float, float, float]] = {}
    for place, dim in enumerate(prior.dims):
        low, median, high = table[::2, place].tolist()
        spans[dim] = (low, median, high)
    across = next(dim for dim in ("length", "extent1", "width", *spans) if dim in spans)
    others = [dim for dim in spans if dim != across]
    up = next((dim for dim in ("height", "extent2", "width", *others) if dim in others), across)
    deep = next((dim for dim in ("width", "extent3", *others) if dim in others and dim != up), None)
    shown = (names.get(across, across), names.get(up, up), names.get(deep, deep) if deep else "")
    return DrawnBox(spans[across], spans[up], spans[deep] if deep else None, shown)


def context_table(node: Node, prior: Prior) -> dict[str, Any] | None:
    """Return quantiles in mm by region, country and year, None if no context of the node states one."""
    places, stated_years = node.contexts
    regions = {region_of(place) or place for place in places}
    if node.tree.context_model is None or not (regions or stated_years):
        return None
    years: list[int | None] = [None]
    if stated_years:
        first, last = min(stated_years), max(stated_years)
        steps = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
        step = next(step for step in steps if (last - first) / step < MAX_YEAR_STEPS - 1)
        years = [*range(int(first // step * step), int(math.ceil(last / step) * step) + 1, step)]
    table: dict[str, list[list[list[float]]]] = {}
    for region in ("world", *sorted(regions), *sorted({*places} - regions)):
        table[region] = []
        for year in years:
            where = Where(None if region == "world" else region, None if year is None else float(year))
            is_default = where.region is None and where.year is None
            rows = (prior if is_default else node.prior(prior.dims, where)).quantiles(INTERVAL_QUANTILES).T
            table[region].append([[float(f"{mm:.4g}") for mm in row] for row in rows])
    return {"regions": list(table), "years": years if stated_years else [], "table": table}


def images_to_scale(catalogue: ReleaseCatalogue, node: Node) -> list[dict[str, Any]]:
    """Return a cut-out image of each item, or of each model of a judged item, all drawn to the same scale.

    The first one is that of the item whose size is closest to the median of the category; the others follow in the
    order of the release.
    """
    found: dict[tuple[str, str | None], tuple[dict[str, Any], dict[str, Any], float]] = {}
    for image in catalogue.images(node):
        key, row = (image["item_id"], image.get("attribution")), catalogue.item_rows.get(image["item_id"])
        has_file = image["cutout_path"] or image["path"]
        if not has_file or row is None or key in found or len(found) >= 4 * MAX_IMAGES:
            continue
        (item,) = catalogue.items.slice(row, 1).to_pylist()
        if item["extents_mm"]:
            side_px, scale = max(image["width_px"], image["height_px"]), image["pixels_per_metre"]
            found[key] = (image, item, float(1000 * side_px / scale if scale else max(item["extents_mm"])))
    if not found:
        return []
    rows = list(found.values())
    median_mm = max(catalogue.quantiles(node)[MEDIAN], default=1.0)
    typical = min(rows, key=lambda row: abs(math.log(max(row[1]["extents_mm"]) / median_mm)))
    others = [row for row in rows if row is not typical]
    places = np.linspace(0, len(others) - 1, min(len(others), MAX_IMAGES - 1)).astype(int)
    chosen = [typical, *(others[place] for place in places)]
    max_mm = max(side_mm for *_, side_mm in chosen)
    images = []
    for image, item, side_mm in chosen:
        factor = max(side_mm / max_mm * MAX_IMAGE_PX, MIN_IMAGE_PX) / max(image["width_px"], image["height_px"])
        size = product_text(item["extents_mm"])
        if item["kind"] == "judged":  # a photograph of any such object
            size += ", a typical size and not that of this object"
        credit = image.get("attribution") or f"{item['source']} ({image['licence'] or 'no licence stated'})"
        images.append(
            {
                "path": image["cutout_path"] or image["path"],
                "title": item["title"] or item["item_id"],
                "width": max(1, round(image["width_px"] * factor)),
                "height": max(1, round(image["height_px"] * factor)),
                "size": size,
                "credit": credit if len(credit) < MAX_CREDIT_CHARS else credit[: MAX_CREDIT_CHARS - 3] + "…",
                "url": web_address(image["source_url"]),
            }
        )
    return images


def items_by_size(catalogue: ReleaseCatalogue, rows: IntArray, sizes: FloatArray) -> list[dict[str, Any]]:
    """Return at most `MAX_ITEMS` of the items (rows of the table) from the largest to the smallest, evenly by rank."""
    largest = np.nanmax(np.nan_to_num(sizes), axis=1) if len(rows) else np.zeros(0)
    order = np.argsort(-largest, kind="stable")
    items = []
    for row in rows[order[np.linspace(0, len(order) - 1, min(MAX_ITEMS, len(order))).astype(int)]]:
        (item,) = catalogue.items.slice(int(row), 1).to_pylist()
        shown: Sequence[float | None] = [item[f"{axis}_mm"] for axis in AXES]
        if is_sorted := not any(shown):
            shown = [*(item["extents_mm"] or ()), None, None, None][:3]
        title = (item["title"] or item["item_id"])[:90]
        items.append({**item, "sizes": shown, "is_sorted": is_sorted, "url": web_address(item["url"]), "title": title})
    return items
