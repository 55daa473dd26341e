"""Figures of the report as inline SVG."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler.items import STATED_KINDS
from metric_base.escaping import visible
from metric_tree.axes import EXTENTS

if TYPE_CHECKING:
    from metric_tree.tree import Node

__all__ = ["coverage_figure", "size_figure"]

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
    for column, colour, label in (
        (3, "#ccd5dd", "any prior"),
        (2, "#7fb3d5", "any real item"),
        (1, "#0072B2", "10+ real items"),
    ):
        panel.barh(rows, [share[column] for share in shares], color=colour, label=label)
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
